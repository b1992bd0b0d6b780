"""The fitted mass-spring law as energies of a scene: what a learned law is compared with in the same solver."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.mass_spring import GROUPS, MassSpringLaw, Springs, springs_of
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.scene.geometry import TINY
from drape.scene.mesh_batch import MeshBatch


class SpringEnergy(EnergyTerm):
    """``Σ_springs k/2 (l' - l_rest)² + c/(2 dt) (l' - l)² + Σ_vertices d/(2 dt) |x' - x|²`` [J].

    k, c and d are the constants, dampers and drag of :class:`MassSpringLaw` for one fabric. Dampers that the fit made
    negative count as 0: seen frame by frame, tension lags behind, which a step forward in time must not repeat.
    """

    name = "springs"

    def __init__(self, law: MassSpringLaw, fabric: int):
        super().__init__()
        constants = law.coefficients[fabric]
        count = len(GROUPS)
        self.register_buffer("constants", torch.cat([constants[:count], constants[count:].clamp(min=0.0)]))
        self._springs: tuple[MeshBatch, Springs] | None = None

    def _of(self, mesh: MeshBatch) -> Springs:
        if self._springs is None or self._springs[0] is not mesh:
            self._springs = mesh, springs_of(mesh)
        return self._springs[1]

    def _lengths(self, x: Tensor, step: Step) -> tuple[Tensor, Tensor]:
        first, second = self._of(step.mesh).ends.unbind(-1)
        vector = x[second] - x[first]
        return vector, (vector.square().sum(-1) + (TINY * step.mesh.length_scale.to(x)) ** 2).sqrt()

    def _constants(self, step: Step) -> tuple[Tensor, Tensor, Tensor]:
        springs, count, constants = self._of(step.mesh), len(GROUPS), self.constants.to(step.x.dtype)
        return constants[:count][springs.group], constants[count:-1][springs.group], constants[-1]

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        springs = self._of(step.mesh)
        stiffness, damper, drag = self._constants(step)
        _, length = self._lengths(x_next, step)
        _, before = self._lengths(step.x, step)
        stretched = 0.5 * stiffness * (length - springs.rest_lengths.to(length)).square()
        damped = (0.5 / step.dt) * damper * (length - before).square()
        moved = (0.5 / step.dt) * drag * (x_next - step.x).square().sum(-1)
        return step.sum_stencils(stretched + damped, springs.ends[:, 0]) + step.mesh.sum_vertices(moved)

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """``(k + c/dt) u uᵀ + max(tension, 0)/l (I - u uᵀ)`` on each spring, ``d/dt`` on each vertex."""
        springs = self._of(step.mesh)
        stiffness, damper, drag = self._constants(step)
        vector, length = self._lengths(x_next, step)
        _, before = self._lengths(step.x, step)
        damper = damper / step.dt
        tension = stiffness * (length - springs.rest_lengths.to(length)) + damper * (length - before)
        unit = vector / length[:, None]
        along = unit[:, :, None] * unit[:, None, :]
        identity = torch.eye(3, dtype=x_next.dtype, device=x_next.device)
        spread = (tension.clamp(min=0.0) / length)[:, None, None]
        block = (stiffness.clamp(min=0.0) + damper)[:, None, None] * along + spread * (identity - along)
        signs = torch.tensor([[1.0, -1.0], [-1.0, 1.0]], dtype=x_next.dtype, device=x_next.device)
        everyone = torch.arange(len(x_next), device=x_next.device)[:, None]
        vertex = (drag / step.dt * identity).expand(len(x_next), 3, 3)
        return [
            Stencils(springs.ends, signs[:, None, :, None] * block[:, None, :, None, :]),
            Stencils(everyone, vertex[:, None, :, None, :]),
        ]
