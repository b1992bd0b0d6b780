"""From embeddings of patches to a vector at each vertex."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from drape.nets.mlp import feed_forward
from drape.nets.segments import segment_sum

SMALL = 1e-3
"""Standard deviation of the initial weights of the last layer: an untrained decoder says almost nothing."""


class PatchDecoder(nn.Module):
    """The mean of what the candidate patches of a vertex say: ``W₃ mean(σ(W₂ σ(W₁ [relative, patch, own])))``.

    W₁ is the sum of three maps, so that what belongs to a patch or to a vertex alone is multiplied once.
    """

    def __init__(self, relative_size: int, patch_size: int, own_size: int, width: int):
        super().__init__()
        self.relative = nn.Linear(relative_size, width)
        self.patch = nn.Linear(patch_size, width, bias=False)
        self.own = nn.Linear(own_size, width, bias=False)
        self.hidden = nn.Sequential(nn.SiLU(), *feed_forward([width, width], last_activation=True))
        self.last = nn.Linear(width, 3)
        nn.init.normal_(self.last.weight, std=SMALL)
        nn.init.zeros_(self.last.bias)

    def forward(
        self,
        relative: Float[Tensor, "asked relative_size"],
        patches: Float[Tensor, "patches patch_size"],
        own: Float[Tensor, "vertices own_size"],
        candidates: Int[Tensor, "2 asked"],
    ) -> Float[Tensor, "vertices 3"]:
        """``candidates``: (vertex, patch) of each row of ``relative``, the state of the vertex as the patch sees it."""
        vertex, patch = candidates
        count = len(own)
        patches, own = self.patch(patches).index_select(0, patch), self.own(own).index_select(0, vertex)
        said = self.hidden(self.relative(relative) + patches + own)
        asked = torch.bincount(vertex, minlength=count).to(said.dtype)
        return self.last(segment_sum(said, vertex, count) / asked[:, None])
