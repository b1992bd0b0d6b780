"""The transformer of LayersNet (Shao et al. 2023) for one garment: patches that hear each other and a body."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.utils.parametrizations import orthogonal

from drape.errors import DrapeError
from drape.nets.mlp import feed_forward
from drape.nets.segments import segment_softmax, segment_sum

CLOSEST = 0.1
"""Distance between features of sender and receiver below which they count as equal: keeps 1/|r - s| and its gradient
bounded. Features are of the order of 1 for each number."""


class Interactions(NamedTuple):
    """Edges of attention: (receiver, sender) of each; receivers are patches."""

    mesh: Int[Tensor, "2 mesh_edges"]
    """From patches beside the receiver on the cloth."""
    world: Int[Tensor, "2 world_edges"]
    """From other patches near the receiver in space."""
    body: Int[Tensor, "2 body_edges"]
    """From faces of the body."""


class Streams(NamedTuple):
    """Features that a layer hands to the next one."""

    patches: Float[Tensor, "patches width"]
    """The patches' embeddings x."""
    receivers: Float[Tensor, "patches width"]
    """r of the patches."""
    senders: Float[Tensor, "tokens width"]
    """s of the patches, and after them of the faces of the body."""


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


class InteractionLayer(nn.Module):
    """Attention, norm, feed-forward of twice the width, norm, each with a residual (LayersNet, after TIE).

    In each of the heads, with q = W_q x, r += W_r x of the receiver and s += W_s x of a sender::

        σ = ½ √(|r - s|² + CLOSEST²)        logit = (q · s + q · r) / σ        message = softmax(logit) (s + r) / 2σ

    The softmax is over all senders of a receiver. The first half of the heads hears patches near in space and the body,
    the second half those beside it on the cloth. Messages from the body pass through :class:`BodyFrameMessages`.
    """

    def __init__(self, width: int, heads: int):
        super().__init__()
        self.size = width // heads
        self.near_heads = heads // 2
        self.query = nn.Linear(width, width)
        self.receiver = nn.Linear(width, width)
        self.sender = nn.Linear(width, width)
        self.body_frame = BodyFrameMessages(self.near_heads, self.size)
        self.out = nn.Linear(width, width)
        self.attention_norm = nn.LayerNorm(width)
        self.feed_forward = feed_forward([width, 2 * width, width])
        self.norm = nn.LayerNorm(width)

    def forward(
        self,
        streams: Streams,
        bodies: Float[Tensor, "bodies width"],
        frames: Float[Tensor, "bodies 3 3"],
        interactions: Interactions,
    ) -> Streams:
        """The streams after the layer; ``bodies`` and ``frames``: embeddings and axes of the faces of the body."""
        x, count = streams.patches, len(streams.patches)
        receivers = streams.receivers + self.receiver(x)
        senders = streams.senders + self.sender(torch.cat([x, bodies]))
        q, r, s = (self._heads(part) for part in (self.query(x), receivers, senders))
        space, cloth = slice(None, self.near_heads), slice(self.near_heads, None)
        body_receiver, body = interactions.body
        world = torch.cat([interactions.world, torch.stack([body_receiver, count + body])], 1)
        weight, edge = _attention(q[:, space], r[:, space], s[:, space], world)
        split = [interactions.world.shape[1], len(body)]
        if len(body):
            from_patches, from_body = edge.split(split)
            edge = torch.cat([from_patches, self.body_frame(from_body, frames.index_select(0, body))])
        heard = [segment_sum(weight[..., None] * edge, world[0], count)]
        weight, edge = _attention(q[:, cloth], r[:, cloth], s[:, cloth], interactions.mesh)
        heard.append(segment_sum(weight[..., None] * edge, interactions.mesh[0], count))
        x = self.attention_norm(x + self.out(torch.cat(heard, 1).flatten(1)))
        return Streams(self.norm(x + self.feed_forward(x)), receivers, senders)

    def _heads(self, rows: Float[Tensor, "rows width"]) -> Float[Tensor, "rows heads size"]:
        return rows.unflatten(-1, (-1, self.size))


def _attention(
    q: Float[Tensor, "patches heads size"],
    r: Float[Tensor, "patches heads size"],
    s: Float[Tensor, "tokens heads size"],
    edges: Int[Tensor, "2 edges"],
) -> tuple[Float[Tensor, "edges heads"], Float[Tensor, "edges heads size"]]:
    """Weight and value ``(s + r) / 2σ`` of each edge."""
    receiver, sender = edges
    count = len(q)
    q, r, s = q.index_select(0, receiver), r.index_select(0, receiver), s.index_select(0, sender)
    edge = (s + r) / ((r - s).square().sum(-1, keepdim=True) + CLOSEST**2).sqrt()
    return segment_softmax(2.0 * (q * edge).sum(-1), receiver, count), edge


class BodyFrameMessages(nn.Module):
    """``R Mᵀ Rᵀ f(R M Rᵀ m)``: into the frame M of the sender, a perceptron f, and back (LayersNet).

    Each of the heads has an f of its own.
    R (``size 3``) lifts a rotation of space to one of features. Its columns are orthonormal exactly, by construction,
    so LayersNet's soft penalty on RᵀR - I is not needed. With ``m = R v`` the map is equivariant: turn v and the
    frames, and the result turns with them. Only three numbers of a message pass, those along the columns of R.
    """

    def __init__(self, heads: int, size: int):
        super().__init__()
        self.lift = cast("nn.Linear", orthogonal(nn.Linear(3, size, bias=False)))
        self.first = _HeadwiseLinear(heads, size)
        self.second = _HeadwiseLinear(heads, size)

    def forward(
        self, messages: Float[Tensor, "edges heads size"], frames: Float[Tensor, "edges 3 3"]
    ) -> Float[Tensor, "edges heads size"]:
        """``frames``: the axes of the sender (tangent, tangent, normal), one in each row."""
        lift = self.lift.weight
        inside = (messages @ lift) @ frames.mT @ lift.T
        seen = self.second(nn.functional.silu(self.first(inside)))
        return (seen @ lift) @ frames @ lift.T


class _HeadwiseLinear(nn.Module):
    """A linear layer of its own for each of the heads."""

    def __init__(self, heads: int, size: int):
        super().__init__()
        bound = 1.0 / math.sqrt(size)
        self.weight = nn.Parameter(torch.empty(heads, size, size).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(heads, size).uniform_(-bound, bound))

    def forward(self, x: Float[Tensor, "edges heads size"]) -> Float[Tensor, "edges heads size"]:
        return (x.transpose(0, 1) @ self.weight).transpose(0, 1) + self.bias
