"""EUNet: the energy of a cloth as a sum of learned energy units over its edges."""

from __future__ import annotations

from typing import NamedTuple, cast

from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.law.timing import Timing
from drape.energy.law.units import DissipationUnits, PotentialUnits
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh_batch import MeshBatch


class EdgeEnergies(NamedTuple):
    """Energies of the edges over one step [J], float64."""

    total: Float[Tensor, " edges"]
    """φp + φd: its gradient in the positions is minus the internal and damping force."""
    balance: Float[Tensor, " edges"]
    """φp at the end of the step plus the energy lost in it: what the energy balance counts."""


class EUNet(nn.Module):
    """Φ(x', x) = Σ_e φp(deformation of e at x') + Σ_e φd(motion of e from x to x') [J] (paper, eq. 1-3).

    Without ``dissipation`` the second sum does not exist: no parameters, no cost. With ``timing``, the forces that
    recorded frames show are those of φp at three of them.
    """

    def __init__(
        self, potential: PotentialUnits, dissipation: DissipationUnits | None = None, timing: Timing | None = None
    ):
        super().__init__()
        self.timing = timing
        units = {"potential": potential, "dissipation": dissipation}
        self.units = nn.ModuleDict({name: unit for name, unit in units.items() if unit is not None})

    @property
    def potential(self) -> PotentialUnits:
        return cast(PotentialUnits, self.units["potential"])

    @property
    def dissipation(self) -> DissipationUnits | None:
        return cast(DissipationUnits, self.units["dissipation"]) if "dissipation" in self.units else None

    @property
    def dissipates(self) -> bool:
        """Whether the energy has dissipation units."""
        return "dissipation" in self.units

    def inputs(self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float) -> dict[str, Tensor]:
        """Inputs of the units for the step from ``previous`` to ``geometry``, by the name of the unit."""
        inputs = {"potential": self.potential.inputs(geometry)}
        if self.dissipation is not None:
            inputs["dissipation"] = self.dissipation.inputs(geometry, previous, dt)
        return inputs

    def energies(
        self, inputs: dict[str, Tensor], attributes: Float[Tensor, "edges attributes"]
    ) -> EdgeEnergies:
        """Energies of the edges for what :meth:`inputs` returned."""
        potential = self.potential.energies(inputs["potential"], attributes)
        if self.dissipation is None:
            return EdgeEnergies(potential, potential)
        dissipation, lost = self.dissipation.energies(inputs["dissipation"], attributes)
        return EdgeEnergies(potential + dissipation, potential + lost)

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
        return mesh.sum_edges(self.energies(inputs, attributes[mesh.mesh_of_edge]).total)
