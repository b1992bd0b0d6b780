"""Rest state of an energy: whether the undeformed cloth is at its minimum and free of force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
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

    The rest state depends on the fabric alone, so each fabric is evaluated on the first cloth that is of it; overall
    is the mean over the fabrics, for the force the largest.
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
        window, mesh = step.window, step.window.mesh
        new = _first_of_each(window.fabric) & (self.edges[window.fabric] == 0)
        if not bool(new.any()):
            return
        rest = mesh.rest_positions
        at_rest = StepEnergies(step.energy, replace(window, x_prev=rest, x=rest, x_next=rest), training=False)
        edges = new[mesh.mesh_of_edge].nonzero().squeeze(1)
        energy = at_rest.potential.detach()[edges]
        fabric = window.fabric[mesh.mesh_of_edge[edges]]
        self.edges.index_add_(0, fabric, torch.ones_like(energy))
        self.energy.index_add_(0, fabric, energy.abs())
        self.above.index_add_(0, fabric, energy - lowest_energy(at_rest, edges, self.RANGE, self.POINTS))
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


def _first_of_each(fabric: Int[Tensor, " meshes"]) -> Bool[Tensor, " meshes"]:
    """Whether no mesh before it is of its fabric."""
    same = fabric[:, None] == fabric
    return same.long().argmax(1) == torch.arange(len(fabric), device=fabric.device)


def lowest_energy(
    step: StepEnergies, edges: Int[Tensor, " edges"], half_range: float, points: int
) -> Float[Tensor, " edges"]:
    """Minimum of φp [J] of each of ``edges`` as it is stretched by -half_range … half_range [m] from its state at t."""
    units = step.energy.potential
    deformation = units.inputs(step.current)[edges]
    stretch = torch.linspace(-half_range, half_range, points, dtype=deformation.dtype, device=deformation.device)
    stretched = deformation.repeat(points, 1)
    stretched[:, 0] += stretch.repeat_interleave(len(edges))
    energies = units.energies(stretched, step.attributes[edges].repeat(points, 1))
    return energies.detach().reshape(points, len(edges)).amin(0)
