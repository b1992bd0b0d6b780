"""EUNet: the energy of a cloth as a sum of learned energy units over its edges."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.units import DissipationUnits, PotentialUnits
from drape.scene.geometry import EdgeGeometry
from drape.scene.mesh_batch import MeshBatch


class EUNet(nn.Module):
    """Φ(x', x) = Σ_e φp(deformation of e at x') + Σ_e φd(motion of e from x to x') [J] (paper, eq. 1-3).

    Without ``dissipation`` the second sum does not exist: no parameters, no cost.
    """

    def __init__(self, potential: PotentialUnits, dissipation: DissipationUnits | None = None):
        super().__init__()
        units = {"potential": potential, "dissipation": dissipation}
        self.units = nn.ModuleDict({name: unit for name, unit in units.items() if unit is not None})

    @property
    def potential(self) -> PotentialUnits:
        return self.units["potential"]

    @property
    def dissipates(self) -> bool:
        """Whether the energy has dissipation units."""
        return "dissipation" in self.units

    def inputs(self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float) -> dict[str, Tensor]:
        """What the units see of the step from ``previous`` to ``geometry``, by the name of the unit."""
        inputs = {"potential": self.potential.inputs(geometry)}
        if self.dissipates:
            inputs["dissipation"] = self.units["dissipation"].inputs(geometry, previous, dt)
        return inputs

    def energies(
        self, inputs: dict[str, Tensor], attributes: Float[Tensor, "edges attributes"]
    ) -> dict[str, Float[Tensor, " edges"]]:
        """Energy of each edge [J], by the name of the unit."""
        return {name: self.units[name].energies(value, attributes) for name, value in inputs.items()}

    def forward(
        self,
        x_next: Float[Tensor, "vertices 3"],
        x: Float[Tensor, "vertices 3"],
        mesh: MeshBatch,
        attributes: Float[Tensor, "meshes attributes"],
        dt: float,
    ) -> Float[Tensor, " meshes"]:
        """Φ(x_next, x) of each mesh [J]; differentiable in both positions (use float64)."""
        inputs = self.inputs(EdgeGeometry(x_next, mesh), EdgeGeometry(x, mesh), dt)
        energies = self.energies(inputs, attributes[mesh.mesh_of_edge])
        return sum(mesh.sum_edges(energy) for energy in energies.values())
