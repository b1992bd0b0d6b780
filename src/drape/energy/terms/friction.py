"""The body drags the cloth along."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array
from drape.energy.terms import point_kernel
from drape.energy.terms.contact import Contact, Touch
from drape.energy.terms.point_stencils import point_stencils
from drape.errors import DrapeError
from drape.linalg.stencil_sum import Filled


class Friction(EnergyTerm):
    """``Σ μ N f(|u|)`` [J] with the tangential slip u [m] of each point in contact over the step.

    ``u`` is the part along the face of ``y' - c'`` of a point y of the cloth (:class:`SurfacePoints`), where c' is the
    place to which the body would carry it: the nearest point of the body moved to t + dt, with the offset of the point
    from it turned with the face. Cloth that
    moves with a translating and turning body has no slip. N is the force of the contact term at t (lagged by a step,
    as in IPC, Li et al. 2020), so friction exists only where there is contact. With ``e = slip_speed · dt``::

        f(u) = u²/e - u³/(3 e²)   up to e,     u - e/3   above

    so the force is ``μ N`` against the slip above e and falls smoothly to zero below: no direction is needed of a
    vertex at rest, which instead creeps at less than ``slip_speed``.

    HOOD's term (docs/sources.md, HOOD) mended: contact is told by the contact term instead of by a squared distance;
    the normal is that of the body instead of a fixed floor's, and N the contact force instead of the weight over such a
    floor; body and cloth move over the same step; no cosine of a zero vector is taken.

    Args:
        coefficient: μ.
        contact: the contact term of the same incremental potential.
        slip_speed: [m/s]

    Raises:
        DrapeError: a number that is not positive and finite.
    """

    name = "friction"
    stores = False

    def __init__(self, coefficient: float, contact: Contact, slip_speed: float = 1e-3):
        super().__init__()
        if not (0 < coefficient < math.inf and 0 < slip_speed < math.inf):
            raise DrapeError(
                f"energy term friction: coefficient {coefficient}, slip_speed {slip_speed} m/s; expected finite "
                "numbers above 0 (leave the term out of a scene without friction)"
            )
        self.contact = contact
        self.coefficient = coefficient
        self.slip_speed = slip_speed

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        touch, force = self.contact.pressed(step)
        return self._energy(_slip(x_next, touch), force, touch, step)

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        touch, force = self.contact.pressed(step)
        slip = _slip(x_next.detach(), touch)
        rate, _ = self._rates(slip, step.dt)
        pull = (self.coefficient * force * rate)[:, None] * slip
        gradient = touch.points.spread((pull[:, :, None] * touch.faces.end.tangents).sum(1))
        return self._energy(slip, force, touch, step), gradient

    def kernel(self, step: Step) -> Kernel | None:
        if step.x.device.type != "cpu":
            return None
        given = self._compiled(step)
        return lambda x: point_kernel.friction(x, *given)

    def _compiled(self, step: Step) -> tuple[point_kernel.Points, np.ndarray, float]:
        """Arrays of a step for the kernels."""
        touch, force = self.contact.pressed(step)
        return touch.compiled, array(self.coefficient * force), self.slip_speed * step.dt

    def _energy(self, slip: Float[Tensor, "pressed 2"], force: Tensor, touch: Touch, step: Step) -> Tensor:
        square, end = slip.square().sum(-1), self.slip_speed * step.dt
        # the root is taken only above e and the power below, so both have a derivative at every slip
        above = square.clamp(min=end**2).sqrt() - end / 3.0
        low = square.clamp(max=end**2)
        below = low / end - low.pow(1.5) / (3.0 * end**2)
        energy = self.coefficient * force * torch.where(square > end**2, above, below)
        return step.sum_stencils(energy, touch.points.first_vertex)

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils | Filled]:
        """``μ N Tᵀ (f'/|u| I + (f'' - f'/|u|) û ûᵀ) T``: exact; f'' is never negative."""
        touch, force = self.contact.pressed(step)
        rows = torch.arange(len(force), device=force.device)
        if x_next.device.type == "cpu":
            blocks = torch.from_numpy(point_kernel.friction_blocks(array(x_next), *self._compiled(step)))
            return point_stencils(touch.points, blocks.to(x_next.dtype), rows)
        slip = _slip(x_next.detach(), touch)
        rate, drop = self._rates(slip, step.dt)
        shortest = 1e-9 * self.slip_speed * step.dt
        unit = slip / slip.square().sum(-1, keepdim=True).sqrt().clamp(min=shortest)
        identity = torch.eye(2, dtype=slip.dtype, device=slip.device)
        plane = rate[:, None, None] * identity - drop[:, None, None] * unit[:, :, None] * unit[:, None, :]
        tangents = touch.faces.end.tangents
        blocks = (self.coefficient * force)[:, None, None] * (tangents.mT @ plane @ tangents)
        return point_stencils(touch.points, blocks, rows)

    def _rates(self, slip: Float[Tensor, "pressed 2"], dt: float) -> tuple[Tensor, Tensor]:
        """``f'/|u|`` and ``f'/|u| - f''`` [1/m]."""
        end = self.slip_speed * dt
        size = slip.square().sum(-1).sqrt()
        long = size.clamp(min=end)
        rate = torch.where(size > end, 1.0 / long, (2.0 - size / end) / end)
        return rate, torch.where(size > end, 1.0 / long, size / end**2)


def _slip(x_next: Float[Tensor, "vertices 3"], touch: Touch) -> Float[Tensor, "pressed 2"]:
    """Along the two tangents of the face at t + dt [m]; the offset at t is measured along those at t."""
    end = touch.faces.end
    return (end.tangents * (touch.points.at(x_next) - end.point)[:, None]).sum(-1) - touch.faces.along
