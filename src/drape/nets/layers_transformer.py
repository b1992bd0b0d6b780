"""The transformer of LayersNet (Shao et al. 2023) for one garment: patches that hear each other and a body."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from drape.errors import DrapeError
from drape.nets.interaction import InteractionLayer, Interactions, Streams
from drape.nets.mlp import feed_forward


class LayersTransformer(nn.Module):
    """Encoders of patches and of faces of a body, and interaction layers.

    Width 128, 8 heads, 4 layers, encoders of two linear layers as published (docs/sources.md, LayersNet), with SiLU for
    ReLU, which has a second derivative.

    Args:
        patch_size_in: numbers that describe a patch.
        body_size_in: numbers that describe a face of the body.
        width: of the embeddings.
        heads: half of them for space and body, half for the cloth.
        layers: interaction layers.

    Raises:
        DrapeError: no layer, an odd number of heads, or a width that is no multiple of it, or below 3 times it.
    """

    def __init__(self, patch_size_in: int, body_size_in: int, *, width: int = 128, heads: int = 8, layers: int = 4):
        super().__init__()
        if layers < 1 or heads < 2 or heads % 2 or width % heads or width < 3 * heads:
            raise DrapeError(
                f"LayersNet: width {width}, {heads} heads, {layers} layers; expected at least 1 layer, an even number "
                "of heads, and a width that is a multiple of it and at least 3 times as large"
            )
        self.width = width
        self.encode_patch = feed_forward([patch_size_in, width, width])
        self.encode_body = feed_forward([body_size_in, width, width])
        self.layers = nn.ModuleList(InteractionLayer(width, heads) for _ in range(layers))

    def forward(
        self,
        patches: Float[Tensor, "patches patch_size_in"],
        bodies: Float[Tensor, "bodies body_size_in"],
        frames: Float[Tensor, "bodies 3 3"],
        interactions: Interactions,
    ) -> Float[Tensor, "patches width"]:
        """Embeddings of the patches; ``frames``: (tangent, tangent, normal) of the faces of the body."""
        x, bodies = self.encode_patch(patches), self.encode_body(bodies)
        streams = Streams(x, x.new_zeros(x.shape), x.new_zeros(len(x) + len(bodies), self.width))
        for layer in self.layers:
            streams = layer(streams, bodies, frames, interactions)
        return streams.patches
