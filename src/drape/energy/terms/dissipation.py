"""The energy that the motion of a cloth dissipates by the law of its edges: Φd of EUNet."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.edge_law import EdgeLaw
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.geometry.corners import cross, dot
from drape.geometry.edge_geometry import TINY

SLOWEST = 1e-6
"""Speeds are rounded up by this [m/s], as in training."""


class Dissipation(EnergyTerm):
    """``Φd = dt/dt_law Σ_edges γ φd(|Δ midpoint| / dt)`` [J], γ the area of the faces at the edge (paper, eq. 3).

    The law was learned on steps of ``dt_law``; the energy that a drag takes from a given motion is proportional to its
    duration, so with the factor the force does not depend on the time step.
    """

    name = "dissipation"
    stores = False
    law: EdgeLaw

    def __init__(self, law: EdgeLaw):
        super().__init__(law)

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        _, speed = _motion(x_next, step)
        _, _, area = _areas(x_next, step)
        energy = _edge_sums(area, step) * self.law.drag(speed, step.attributes[step.mesh.mesh_of_edge])
        return step.sum_stencils(self._duration(step) * energy, step.mesh.edges[:, 0])

    def _duration(self, step: Step) -> float:
        return step.dt / self.law.dt

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        mesh, count, x_next = step.mesh, len(x_next), x_next.detach()
        motion, speed = _motion(x_next, step)
        sides, normal, area = _areas(x_next, step)
        density, slope = self.law.drag_slopes(speed, step.attributes[mesh.mesh_of_edge])
        density, slope = self._duration(step) * density, self._duration(step) * slope
        gamma = _edge_sums(area, step)
        energy = step.sum_stencils(gamma * density, mesh.edges[:, 0])
        pull = (0.5 / step.dt**2) * (gamma * slope / speed) * motion
        gradient = mesh.edge_corners.scatter(pull.expand(2, -1, -1).contiguous(), count)
        on_face = _face_sums(density, step) * (0.25 / area) * normal
        on_1, on_2 = cross(sides[1], on_face), cross(on_face, sides[0])
        return energy, gradient + mesh.face_corners.scatter(torch.stack([-(on_1 + on_2), on_1, on_2]), count)

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """``γ φd'/(4 dt² speed)`` on all pairs of ends: exact for a drag that grows with the square of the speed."""
        _, speed = _motion(x_next, step)
        _, _, area = _areas(x_next, step)
        _, slope = self.law.drag_slopes(speed, step.attributes[step.mesh.mesh_of_edge])
        stiffness = (0.25 / step.dt**2 * self._duration(step)) * _edge_sums(area, step) * slope.clamp(min=0.0) / speed
        identity = stiffness.new_zeros(2, 3, 2, 3)
        for axis in range(3):
            identity[:, axis, :, axis] = 1.0
        return [Stencils(step.mesh.edges, stiffness[:, None, None, None, None] * identity)]


def _motion(x_next: Tensor, step: Step) -> tuple[Tensor, Tensor]:
    """Displacements of the edge midpoints [m] and their speeds [m/s]."""
    ends = step.mesh.edge_corners.gather(x_next - step.x)
    motion = 0.5 * (ends[0] + ends[1])
    return motion, (dot(motion, motion) / step.dt**2 + SLOWEST**2).sqrt()


def _areas(x_next: Tensor, step: Step) -> tuple[tuple[Tensor, Tensor], Tensor, Tensor]:
    """Two sides of each face, their vector product and the area [m²]."""
    x0, x1, x2 = step.mesh.face_corners.gather(x_next)
    sides = x1 - x0, x2 - x0
    normal = cross(*sides)
    smallest = TINY * step.mesh.length_scale.to(x_next.dtype) ** 2
    return sides, normal, 0.5 * (dot(normal, normal) + smallest**2).sqrt()


def _edge_sums(area: Float[Tensor, " faces"], step: Step) -> Float[Tensor, " edges"]:
    first, second = area[step.mesh.edge_faces[:, 0]], area[step.mesh.edge_faces[:, 1]]
    return first + second.masked_fill(step.mesh.boundary, 0.0)


def _face_sums(density: Float[Tensor, " edges"], step: Step) -> Float[Tensor, " faces"]:
    total = density.new_zeros(len(step.mesh.faces))
    total = total.index_add(0, step.mesh.edge_faces[:, 0], density)
    return total.index_add(0, step.mesh.edge_faces[:, 1], density.masked_fill(step.mesh.boundary, 0.0))
