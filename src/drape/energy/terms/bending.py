"""The bending energy of PHYS: hinges between neighbouring faces."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.energy.terms.per_mesh import PerMesh, everywhere, hold, of_pieces
from drape.errors import DrapeError
from drape.geometry.rest_shape import HingeShape


class _Bend(NamedTuple):
    shape: HingeShape
    seen: Float[Tensor, " hinges"]
    """s Δθ"""
    angle: Float[Tensor, " hinges"]
    """Δθ"""
    weight: Float[Tensor, " hinges"]
    """k / (4 (A1 + A2)) [N/m]"""


class Bending(EnergyTerm):
    """``Σ_hinges k l² / (4 (A1 + A2)) · (s Δθ)²/2`` [J] (docs/sources.md, HOOD).

    l is the length of the edge as it is now, A1 and A2 are the rest areas of its faces, Δθ is the change of the
    dihedral angle from the rest state (HOOD takes a flat one), s is 1 unless a face has lost 99 % of its area, see
    :meth:`HingeShape.change`. So an energy is half the square of ``r = l s Δθ``, and its gradient and Gauss-Newton
    Hessian come from ∂r/∂x, which stays bounded as l goes to zero.

    Args:
        stiffness: k [J]; one number, or one for each mesh of the batch. The default is HOOD's.

    Raises:
        DrapeError: a stiffness that is not positive.
    """

    name = "bending"
    stiffness: PerMesh

    def __init__(self, stiffness: PerMesh = 3.9625778e-05):
        super().__init__()
        if not everywhere(stiffness > 0):
            raise DrapeError(f"energy term bending: stiffness {stiffness} J; expected more than 0")
        hold(self, "stiffness", stiffness)

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        bend = self._bend(x_next, step)
        energies = 0.5 * bend.weight * (bend.shape.length * bend.seen).square()
        return step.sum_stencils(energies, step.mesh.rest_hinges.corners.vertices[:, 0])

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        bend = self._bend(x_next.detach(), step)
        bend = bend._replace(weight=bend.weight.detach())
        corners = step.mesh.rest_hinges.corners
        size = bend.shape.length * bend.seen
        pull = bend.weight * size
        gradient = corners.scatter(_slope(bend, pull), len(x_next))
        return step.sum_stencils(0.5 * pull * size, corners.vertices[:, 0]), gradient

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """``k / (4 (A1 + A2)) ∂r ∂rᵀ`` (Gauss-Newton): the Hessian where Δθ = 0."""
        bend = self._bend(x_next.detach(), step)
        bend = bend._replace(weight=bend.weight.detach())
        row = _slope(bend, bend.weight.sqrt())
        blocks = (row[:, None] * row).view(4, 3, 4, 3, -1)
        return [Stencils(step.mesh.rest_hinges.corners.vertices, blocks.permute(4, 0, 1, 2, 3))]

    def _bend(self, x: Float[Tensor, "vertices 3"], step: Step) -> _Bend:
        rest = step.mesh.rest_hinges
        shape = HingeShape(rest.corners.gather(x), rest.shape)
        seen, angle = shape.change(rest.angle)
        stiffness = of_pieces(self.stiffness, step, rest.corners.vertices[:, 0], x.dtype)
        return _Bend(shape, seen, angle, (stiffness / (4.0 * rest.area)).to(x.dtype))


def _slope(bend: _Bend, factor: Float[Tensor, " hinges"]) -> Float[Tensor, "12 hinges"]:
    """``factor ∂(l s Δθ)/∂x``."""
    shape = bend.shape
    stretch = (factor * bend.seen / shape.length) * shape.edge
    slopes = shape.change_slopes(factor * shape.length, bend.angle)
    slopes[0:3] -= stretch
    slopes[3:6] += stretch
    return slopes
