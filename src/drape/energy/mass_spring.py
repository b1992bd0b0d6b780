"""A mass-spring law fitted by least squares: what a learned energy has to beat (FINDINGS 2)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from drape.data.windows import Window
from drape.errors import DrapeError
from drape.scene.geometry import TINY, safe_norm
from drape.scene.mesh_batch import MeshBatch

GROUPS = ("straight", "diagonal", "across")
"""Mesh edges of the shortest kind, longer mesh edges, and the pairs of vertices opposite to an interior edge."""
COEFFICIENTS = (
    *(f"{group}_spring_N_per_m" for group in GROUPS),
    *(f"{group}_damper_kg_per_s" for group in GROUPS),
    "drag_kg_per_s",
)
STRAIGHT = 1.2
"""A mesh edge is straight up to this multiple of the shortest rest length of its mesh, else diagonal."""


class Springs(NamedTuple):
    """Pairs of vertices, the group of each (index into ``GROUPS``) and its rest length [m]."""

    ends: Int[Tensor, "springs 2"]
    group: Int[Tensor, " springs"]
    rest_lengths: Float[Tensor, " springs"]


def springs_of(mesh: MeshBatch) -> Springs:
    """The springs along all mesh edges, then those across the interior edges."""
    shortest = torch.full((mesh.num_meshes,), torch.inf, dtype=mesh.rest_lengths.dtype, device=mesh.edges.device)
    shortest = shortest.scatter_reduce(0, mesh.mesh_of_edge, mesh.rest_lengths, "amin")
    diagonal = mesh.rest_lengths > STRAIGHT * shortest[mesh.mesh_of_edge]
    interior = ~mesh.boundary
    corners = mesh.faces[mesh.edge_faces[interior]].sum(-1)
    opposite = corners - mesh.edges[interior].sum(-1, keepdim=True)
    rest = mesh.rest_positions[opposite]
    return Springs(
        ends=torch.cat([mesh.edges, opposite]),
        group=torch.cat([diagonal.long(), torch.full_like(opposite[:, 0], GROUPS.index("across"))]),
        rest_lengths=torch.cat([mesh.rest_lengths, (rest[:, 1] - rest[:, 0]).norm(dim=-1)]),
    )


class MassSpringLaw(nn.Module):
    """``f = Σ_springs (k_g (l - l_rest) + c_g dl/dt) u - c v`` on each vertex [N], seven coefficients per fabric.

    u points to the other end; the spring constant k_g [N/m] and the axial damper c_g [kg/s] belong to the group of
    the spring, the drag c [kg/s] to the vertices. Positions and velocities are those of the next frame (backward
    Euler). Air, substeps and the angular bending of the simulation are not in it, so it leaves a residual.
    """

    coefficients: Float[Tensor, "fabrics 7"]

    def __init__(self, coefficients: Float[Tensor, "fabrics 7"]):
        super().__init__()
        self.register_buffer("coefficients", coefficients)

    @classmethod
    def fit(cls, windows: Iterable[Window], num_fabrics: int) -> MassSpringLaw:
        """Least squares of the equation of motion ``f = m a - m g`` on the free vertices, one pass over ``windows``.

        The coefficients of a fabric of which there is no window are NaN.

        Raises:
            DrapeError: no windows, or nothing moves in them.
        """
        size = len(COEFFICIENTS)
        gram = torch.zeros(num_fabrics, size, size, dtype=torch.float64)
        moment = torch.zeros(num_fabrics, size, dtype=torch.float64)
        for window in windows:
            basis = force_basis(window) * window.free[:, None, None]
            per_vertex = (basis @ basis.mT).cpu(), (basis @ window.inertial_force[..., None])[..., 0].cpu()
            fabric = window.fabric[window.mesh.mesh_of_vertex].cpu()
            gram.index_add_(0, fabric, per_vertex[0])
            moment.index_add_(0, fabric, per_vertex[1])
        seen = gram.diagonal(dim1=-2, dim2=-1).amax(-1) > 0
        if not bool(seen.any()):
            raise DrapeError("mass-spring law: nothing moves in the training windows; expected moving cloth to fit it")
        return cls(_solve(gram, moment).masked_fill(~seen[:, None], torch.nan))

    def forward(self, window: Window) -> Float[Tensor, "vertices 3"]:
        """The force on each vertex at t+1 [N].

        Raises:
            DrapeError: a fabric that the law was not fitted on.
        """
        coefficients = self.coefficients[window.fabric]
        if bool(coefficients.isnan().any()):
            unknown = sorted(set(window.fabric[coefficients.isnan().any(-1)].tolist()))
            raise DrapeError(f"mass-spring law: not fitted on the fabrics number {unknown}; fit it on data with them")
        coefficients = coefficients[window.mesh.mesh_of_vertex]
        return (coefficients[:, None] @ force_basis(window))[:, 0]

    def force_residual(self, window: Window) -> Float[Tensor, "vertices 3"]:
        """``m a - m g - f`` at t+1 [N]; 0 at pins. The same as ``StepEnergies.force_residual`` is of an energy."""
        return (window.inertial_force - self(window)) * window.free[:, None]


def force_basis(window: Window) -> Float[Tensor, "vertices coefficients 3"]:
    """The force on each vertex for each coefficient being 1, the others 0."""
    springs, mesh = springs_of(window.mesh), window.mesh
    first, second = springs.ends.unbind(-1)
    vector = window.x_next[second] - window.x_next[first]
    length = safe_norm(vector, TINY * mesh.length_scale)
    direction = vector / length[:, None]
    v = window.v_next
    stretch = (length - springs.rest_lengths)[:, None] * direction
    rate = ((v[second] - v[first]) * direction).sum(-1, keepdim=True) * direction
    size = len(COEFFICIENTS)
    basis = window.x.new_zeros(mesh.num_vertices * size, 3)
    for column, pull in ((springs.group, stretch), (springs.group + len(GROUPS), rate)):
        basis.index_add_(0, first * size + column, pull)
        basis.index_add_(0, second * size + column, -pull)
    basis = basis.reshape(mesh.num_vertices, size, 3)
    basis[:, -1] = -v
    return basis


def _solve(gram: Float[Tensor, "fabrics n n"], moment: Float[Tensor, "fabrics n"]) -> Float[Tensor, "fabrics n"]:
    """Normal equations, each unknown scaled to 1; a coefficient that the data do not show is 0."""
    scale = gram.diagonal(dim1=-2, dim2=-1).sqrt()
    scale = torch.where(scale > 0, 1.0 / scale, 0.0)
    scaled = gram * scale[:, :, None] * scale[:, None, :]
    solution = torch.linalg.pinv(scaled, rtol=1e-12, hermitian=True) @ (moment * scale)[..., None]
    return solution[..., 0] * scale
