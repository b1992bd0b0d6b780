"""Which vertices the contrastive loss disturbs."""

from __future__ import annotations

import torch
from jaxtyping import Int
from torch import Tensor

from drape.scene.mesh_batch import MeshBatch

HOPS_APART = 4
"""Disturbed vertices are at least this far apart, so that every edge energy is changed by one of them at most."""


def disturbed_vertices(
    mesh: MeshBatch, allowed: Tensor, generator: torch.Generator | None = None
) -> Int[Tensor, " chosen"]:
    """A random maximal set of ``allowed`` vertices of which no two are closer than four edges (paper, after eq. 12).

    Luby's algorithm on the graph of the pairs at most three edges apart: random priorities, every vertex that beats
    all its rivals is chosen and its rivals leave, until none is left. About 6 % of a regular grid.
    """
    first, second = mesh.pairs_within(HOPS_APART - 1)
    undecided, chosen = allowed.clone(), torch.zeros_like(allowed)
    while bool(undecided.any()):
        priority = torch.rand(mesh.num_vertices, generator=generator, device="cpu").to(allowed.device)
        priority = priority.masked_fill(~undecided, -1.0)
        rival = torch.full_like(priority, -1.0).scatter_reduce(0, first, priority[second], "amax")
        winners = undecided & (priority > rival)
        chosen |= winners
        undecided &= ~winners
        undecided[first[winners[second]]] = False
    return chosen.nonzero().squeeze(-1)


def affected_edges(
    mesh: MeshBatch, vertices: Int[Tensor, " chosen"]
) -> tuple[Int[Tensor, " affected"], Int[Tensor, " affected"]]:
    """Edges whose energy the disturbed vertices can change, and for each the position in ``vertices`` of its cause.

    Moving a vertex turns the normals of its neighbours, so the edges with an end at the vertex or at a neighbour
    change (paper, appendix A.1). Four edges between disturbed vertices make the cause unique.
    """
    cause = torch.full((mesh.num_vertices,), -1, device=vertices.device)
    cause[vertices] = torch.arange(len(vertices), device=vertices.device)
    ends = cause[mesh.edges]
    ring = cause.clone()
    ring = ring.scatter_reduce(0, mesh.edges[:, 0], ends[:, 1], "amax")
    ring = ring.scatter_reduce(0, mesh.edges[:, 1], ends[:, 0], "amax")
    of_edge = ring[mesh.edges].amax(-1)
    affected = (of_edge >= 0).nonzero().squeeze(-1)
    return affected, of_edge[affected]
