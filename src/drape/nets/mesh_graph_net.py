"""Graph networks that pass messages along several named sets of edges: MeshGraphNet and its hierarchical kin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn.functional import linear

from drape.errors import DrapeError
from drape.geometry.fixed_size import counted

BLOCK = 8192
"""Edges whose messages are made at once on a CPU where no graph is kept: few enough for its cache."""


@dataclass(frozen=True, eq=False)
class EdgeSet:
    """Directed edges of one kind."""

    senders: Int[Tensor, " edges"]
    receivers: Int[Tensor, " edges"]
    features: Float[Tensor, "edges features"]
    level: Int[Tensor, " edges"] | None = None
    """The deepest level of a hierarchy that the receiver is in; for sets that a schedule names with ``@``."""
    there: Bool[Tensor, " edges"] | None = None
    """The edges that count, where their number may not depend on what is in them; None: all."""

    def __len__(self) -> int:
        return len(self.senders)

    def take(self, rows: Int[Tensor, " rows"]) -> EdgeSet:
        """Only some of the edges."""
        parts = (self.senders, self.receivers, self.features)
        return EdgeSet(*(part.index_select(0, rows) for part in parts))

    def from_level(self, level: int) -> Bool[Tensor, " edges"]:
        """Whether the receiver of an edge is in that level or a deeper one."""
        if self.level is None:
            raise DrapeError(f"edges: found no levels; expected some, as the schedule names level {level} of this set")
        return self.level >= level


class MeshGraphNet(nn.Module):
    """Encoder, message passing, decoder (Pfaff et al. 2021), with the edge sets of each step free to choose.

    One step, with ``[·]`` a concatenation and FFN two hidden layers with ReLU and a LayerNorm at the end:
    ``message = FFN([receiver, sender, edge])``, ``edge += message`` and ``node += FFN([node, Σ messages, …])`` with one
    sum for each edge set of the step. No weights are shared. Sets without edges cost nothing and count as zero sums.
    In the end nodes are decoded, and the edges of the sets ``answers``, one number for each (ours).

    Args:
        size_node: features of a node.
        sizes_edge: features of an edge of each set.
        size_out: numbers that are predicted for each node.
        width: of all layers.
        schedule: the edge sets of each step. ``name@2`` takes only the edges of the set with receivers of level 2 or
            deeper; the others of the set rest.
        answers: edge sets whose edges predict something too.

    Raises:
        DrapeError: a schedule without steps, with a set that there is not or that a step names twice, or without one
            that there is.
    """

    def __init__(
        self,
        size_node: int,
        sizes_edge: Mapping[str, int],
        size_out: int,
        *,
        width: int,
        schedule: Sequence[Sequence[str]],
        answers: Sequence[str] = (),
    ):
        super().__init__()
        parts = [[_Part.of(text) for text in step] for step in schedule]
        named = {part.name for step in parts for part in step}
        if any(len({part.name for part in step}) < len(step) for step in parts):
            raise DrapeError(f"mesh graph net: a step of the schedule {schedule} names an edge set twice; name it once")
        if not parts or named != set(sizes_edge):
            raise DrapeError(
                f"mesh graph net: the schedule names the edge sets {sorted(named)}, but the graph has "
                f"{sorted(sizes_edge)}; choose a schedule that uses each of them (more or fewer coarse levels?)"
            )
        self.node_encoder = nn.Sequential(nn.Linear(size_node, width), *_layers(width, width), nn.LayerNorm(width))
        self.edge_encoders = nn.ModuleDict(
            {
                name: nn.Sequential(nn.Linear(size, width), *_layers(width, width), nn.LayerNorm(width))
                for name, size in sizes_edge.items()
            }
        )
        self.steps = nn.ModuleList(_Step(width, step) for step in parts)
        self.parts = {part for step in parts for part in step}
        self.decoder = nn.Sequential(nn.Linear(width, width), *_layers(width, size_out))
        self.edge_decoders = nn.ModuleDict(
            {name: nn.Sequential(nn.Linear(width, width), *_layers(width, 1)) for name in answers}
        )

    def forward(
        self, nodes: Float[Tensor, "nodes node_features"], edges: Mapping[str, EdgeSet]
    ) -> tuple[Float[Tensor, "nodes size_out"], dict[str, Float[Tensor, " edges"]]]:
        """Predictions for all nodes and for the edges of ``answers``; ``edges`` may lack sets of the schedule."""
        nodes = self.node_encoder(nodes)
        edges = {
            name: replace(edge_set, features=self.edge_encoders[name](edge_set.features))
            for name, edge_set in edges.items()
            if len(edge_set)
        }
        asked = {part: _chosen(part, edges[part.name]) for part in self.parts if part.name in edges}
        chosen = {part: rows for part, rows in asked.items() if rows is not None}
        for step in self.steps:
            nodes, edges = step(nodes, edges, chosen)
        answers = {n: decode(edges[n].features)[:, 0] for n, decode in self.edge_decoders.items() if n in edges}
        return self.decoder(nodes), answers


class _Part(NamedTuple):
    """The edges of a set that take part in a step: those with receivers of this level or deeper."""

    name: str
    level: int

    @classmethod
    def of(cls, text: str) -> _Part:
        name, at, level = text.partition("@")
        if at and not level.isdecimal():
            raise DrapeError(
                f"mesh graph net: {text!r} in the schedule; expected an edge set, or one and a level: body@2"
            )
        return cls(name, int(level or 0))


def _chosen(part: _Part, edges: EdgeSet) -> Tensor | None:
    """Rows of the edges that take part, or a mask of them where their number is fixed; None: all."""
    if not part.level:
        return edges.there
    deep = edges.from_level(part.level)
    return deep.nonzero()[:, 0] if edges.there is None else deep & edges.there


class _Step(nn.Module):
    """One round of messages and the updates of edges and nodes that follow from them."""

    def __init__(self, width: int, parts: Sequence[_Part]):
        super().__init__()
        self.parts = tuple(parts)
        self.messages = nn.ModuleDict({part.name: _Message(width) for part in parts})
        self.first = nn.Linear((1 + len(parts)) * width, width)
        self.others = nn.Sequential(*_layers(width, width), nn.LayerNorm(width))

    def forward(
        self, nodes: Tensor, edges: dict[str, EdgeSet], chosen: dict[_Part, Tensor]
    ) -> tuple[Tensor, dict[str, EdgeSet]]:
        own, *of_sums = self.first.weight.split(nodes.shape[1], dim=1)
        hidden = linear(nodes, own, self.first.bias)
        for part, of_sum in zip(self.parts, of_sums, strict=True):
            if part.name not in edges:
                continue
            edge_set, some = edges[part.name], chosen.get(part)
            rows = None if some is None or some.dtype == torch.bool else some
            active = edge_set if rows is None else edge_set.take(rows)
            message = self.messages[part.name](nodes, active)
            if some is not None and rows is None:
                message = counted(message, some)
            received = nodes.new_zeros(nodes.shape).index_add(0, active.receivers, message)
            hidden += linear(received, of_sum)
            features = edge_set.features
            features = features + message if rows is None else features.index_add(0, rows, message)
            edges = edges | {part.name: replace(edge_set, features=features)}
        return nodes + self.others(hidden), edges


class _Message(nn.Module):
    """``FFN([receiver, sender, edge])``; the concatenation is never made.

    Its first layer is a sum of three products, two of which are taken for each node instead of for each edge, of which
    there are six times as many.
    """

    def __init__(self, width: int):
        super().__init__()
        self.first = nn.Linear(3 * width, width)
        self.others = nn.Sequential(*_layers(width, width), nn.LayerNorm(width))

    def forward(self, nodes: Tensor, edges: EdgeSet) -> Float[Tensor, "edges width"]:
        of_receiver, of_sender, of_edge = self.first.weight.split(nodes.shape[1], dim=1)
        many = len(edges) > len(nodes)
        ends = [
            (who, weight, linear(nodes, weight) if many else nodes)
            for who, weight in ((edges.receivers, of_receiver), (edges.senders, of_sender))
        ]

        def of(rows: slice) -> Tensor:
            hidden = linear(edges.features[rows], of_edge, self.first.bias)
            for who, weight, known in ends:
                seen = known.index_select(0, who[rows])
                hidden += seen if many else linear(seen, weight)
            return self.others(hidden)

        if torch.is_grad_enabled() or nodes.device.type != "cpu" or len(edges) <= BLOCK:
            return of(slice(None))
        message = torch.empty_like(edges.features)
        for first in range(0, len(edges), BLOCK):
            message[first : first + BLOCK] = of(slice(first, first + BLOCK))
        return message


def _layers(width: int, size_out: int) -> list[nn.Module]:
    """Layers after the first: the other hidden one and the output."""
    return [nn.ReLU(inplace=True), nn.Linear(width, width), nn.ReLU(inplace=True), nn.Linear(width, size_out)]


def flat_schedule(steps: int) -> list[list[str]]:
    """MeshGraphNet: every step passes messages along the mesh and from the body."""
    return [["mesh", "body"] for _ in range(steps)]


def hood_schedule(repeats: int = 3) -> list[list[str]]:
    """HOOD's way down to the second coarse level and up again, each of its five stages ``repeats`` times.

    HOOD, section 3.2, and docs/sources.md, HOOD.

    Where the mesh rests, the body speaks to the vertices of the finest level in use only (``body@level``).
    """
    stages = [
        ["mesh", "coarse_1", "body"],
        ["coarse_1", "coarse_2", "body@1"],
        ["coarse_2", "body@2"],
        ["coarse_1", "coarse_2", "body@1"],
        ["mesh", "coarse_1", "body"],
    ]
    return [list(stage) for stage in stages for _ in range(repeats)]
