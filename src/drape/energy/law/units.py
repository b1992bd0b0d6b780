"""The two families of energy units that EUNet sums over the edges of a cloth."""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.law.deformation import Deformation
from drape.geometry.edge_geometry import EdgeGeometry


class PotentialUnits(nn.Module, ABC):
    """Elastic energy φp, stored in the deformation of an edge; evaluated in two steps, geometry and network.

    ``inputs`` is all that depends on the positions; ``energies`` all that depends on the parameters. Forces for
    training are taken through the small inputs, which is several times cheaper than through the positions.
    """

    def __init__(self, deformation: Deformation):
        super().__init__()
        self.deformation = deformation

    def inputs(self, geometry: EdgeGeometry) -> Float[Tensor, "... edges inputs"]:
        """Inputs of the units: deformation of the edges, float64."""
        return self.deformation(geometry)

    @abstractmethod
    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        """Energy of each edge [J], float64."""


class DissipationUnits(nn.Module, ABC):
    """φd: the energy of the step whose gradient is the damping force, and the energy that the step loses."""

    @abstractmethod
    def inputs(
        self, geometry: EdgeGeometry, previous: EdgeGeometry, dt: float
    ) -> Float[Tensor, "... edges inputs"]:
        """Inputs of the units for the step from ``previous`` to ``geometry`` of ``dt`` seconds, float64."""

    @abstractmethod
    def energies(
        self, inputs: Float[Tensor, "edges inputs"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        """φd of each edge [J] and the energy that the edge loses in the step [J], float64."""

