"""Rest state of an energy: whether the undeformed cloth is at its minimum and free of force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.metrics.fabric_metric import OVERALL, FabricMetric


class RestState(FabricMetric):
    """The learned energy at the rest positions of the cloth, all vertices at rest.

    * ``rest_energy_J``: mean over edges of |φp| at rest [J]. Only differences of φp are ever trained, so an energy
      that is not built to vanish there has an arbitrary number here.
    * ``rest_above_minimum_J``: mean over edges of φp at rest less the minimum of φp over Δl = -5…5 mm with the
      angles at rest [J]; 0 when the rest length is the most comfortable one (the paper's zero point, figure 4).
    * ``rest_force_N``: the largest |∂Φ/∂x| of any vertex at rest [N], dissipation included.

    The rest state depends on the fabric alone, so each fabric is evaluated in the first batch that has it; overall is
    the mean over the fabrics, for the force the largest.
    """

    RANGE = 5e-3
    """Half the range of Δl that is searched for the minimum [m]."""
    POINTS = 41
    edges: Tensor
    energy: Tensor
    above: Tensor
    force: Tensor

    def __init__(self, fabrics: Sequence[str]):
        super().__init__(fabrics)
        for name in ("edges", "energy", "above"):
            self.add_sum(name)
        zeros = torch.zeros(len(self.fabrics), dtype=torch.float64)
        self.add_state("force", zeros, dist_reduce_fx="max")

    def update(self, step: StepEnergies) -> None:
        window = step.window
        new = self.edges[window.fabric] == 0
        if not bool(new.any()):
            return
        rest = window.mesh.rest_positions
        at_rest = StepEnergies(step.energy, replace(window, x_prev=rest, x=rest, x_next=rest), training=False)
        mesh = window.mesh
        for name, per_edge in (
            ("energy", at_rest.potential.abs()),
            ("above", at_rest.potential - lowest_energy(at_rest, self.RANGE, self.POINTS)),
            ("edges", torch.ones_like(at_rest.potential)),
        ):
            state = getattr(self, name)
            state += self.per_fabric(window, mesh.sum_edges(per_edge) * new)
        force = at_rest.gradient.detach().norm(dim=-1).double()
        self.force = self.force.scatter_reduce(0, window.fabric[mesh.mesh_of_vertex], force, "amax")

    def compute(self) -> dict[str, float]:
        seen: Tensor = self.edges > 0
        names = [name for name, is_seen in zip(self.fabrics, seen.tolist(), strict=True) if is_seen]
        energy, above = (state[seen] / self.edges[seen] for state in (self.energy, self.above))
        result: dict[str, float] = {}
        for key, values, overall in (
            ("rest_energy_J", energy, energy.mean()),
            ("rest_above_minimum_J", above, above.mean()),
            ("rest_force_N", self.force[seen], self.force.max()),
        ):
            result |= {f"{key}/{name}": value for name, value in zip(names, values.tolist(), strict=True)}
            result |= {f"{key}/{OVERALL}": overall.item()} if names else {}
        return result


def lowest_energy(step: StepEnergies, half_range: float, points: int) -> Float[Tensor, " edges"]:
    """Minimum of φp [J] of each edge when it is stretched by -half_range … half_range [m] from its state at t."""
    units, mesh = step.energy.potential, step.window.mesh
    deformation = units.inputs(step.current)
    stretch = torch.linspace(-half_range, half_range, points, dtype=deformation.dtype, device=deformation.device)
    stretched = deformation.repeat(points, 1)
    stretched[:, 0] += stretch.repeat_interleave(mesh.num_edges)
    energies = units.energies(stretched, step.attributes.repeat(points, 1))
    return energies.reshape(points, mesh.num_edges).amin(0)
