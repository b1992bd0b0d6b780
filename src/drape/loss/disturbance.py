"""The vertices that the contrastive loss disturbs."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from drape.geometry.mesh_batch import MeshBatch

HOPS_APART = 4
"""Disturbed vertices are at least this far apart, so that every edge energy is changed by one of them at most."""
ROUNDS = 8
"""Enough where nobody may ask whether all is decided: four sheets of 484 vertices are after three to five."""


def chosen_vertices(
    mesh: MeshBatch,
    allowed: Bool[Tensor, " vertices"],
    generator: torch.Generator | None = None,
    rounds: int | None = None,
) -> Bool[Tensor, " vertices"]:
    """A random maximal set of ``allowed`` vertices of which no two are closer than four edges (paper, after eq. 14).

    Luby's algorithm on the graph of the pairs at most three edges apart: random priorities, every vertex that beats
    all its rivals is chosen and its rivals leave, until none is left. About 6 % of a regular grid. With ``rounds``, so
    many, whether any is left or not.
    """
    first, second = mesh.pairs_within(HOPS_APART - 1)
    undecided, chosen = allowed, torch.zeros_like(allowed)
    for _ in range(rounds or mesh.num_vertices):
        if rounds is None and not bool(undecided.any()):
            break
        priority = torch.rand(mesh.num_vertices, generator=generator, device=allowed.device)
        priority = priority.masked_fill(~undecided, -1.0)
        rival = torch.full_like(priority, -1.0).scatter_reduce(0, first, priority[second], "amax")
        winners = undecided & (priority > rival)
        beaten = torch.zeros_like(priority).scatter_reduce(0, first, winners[second].to(priority.dtype), "amax") > 0
        chosen = chosen | winners
        undecided = undecided & ~(winners | beaten)
    return chosen


def disturbed_vertices(
    mesh: MeshBatch, allowed: Bool[Tensor, " vertices"], generator: torch.Generator | None = None
) -> Int[Tensor, " chosen"]:
    """The numbers of :func:`chosen_vertices`."""
    return chosen_vertices(mesh, allowed, generator).nonzero().squeeze(-1)


def causes(mesh: MeshBatch, position: Int[Tensor, " vertices"]) -> Int[Tensor, " edges"]:
    """For each edge the ``position`` of the disturbed vertex that can change its energy, -1 where none can.

    Moving a vertex turns the normals of its neighbours, so the edges with an end at the vertex or at a neighbour
    change (paper, appendix A.1). Four edges between disturbed vertices make the cause unique.

    Args:
        mesh: the cloths.
        position: -1 for vertices that are not disturbed.
    """
    ends = position[mesh.edges]
    ring = position.scatter_reduce(0, mesh.edges[:, 0], ends[:, 1], "amax")
    ring = ring.scatter_reduce(0, mesh.edges[:, 1], ends[:, 0], "amax")
    return ring[mesh.edges].amax(-1)


def affected_edges(
    mesh: MeshBatch, vertices: Int[Tensor, " chosen"]
) -> tuple[Int[Tensor, " affected"], Int[Tensor, " affected"]]:
    """Edges whose energy the disturbed vertices can change, and for each the place in ``vertices`` of its cause."""
    position = torch.full((mesh.num_vertices,), -1, device=vertices.device)
    position[vertices] = torch.arange(len(vertices), device=vertices.device)
    of_edge = causes(mesh, position)
    affected = (of_edge >= 0).nonzero().squeeze(-1)
    return affected, of_edge[affected]
