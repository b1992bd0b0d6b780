"""A learned law at another weight of its fabric: a law and all masses multiplied by one number move alike."""

from __future__ import annotations

import copy
import math

from jaxtyping import Float
from torch import Tensor

from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.law.edge_law import EdgeLaw, Slopes
from drape.energy.law.hinge_law import HingeLaw
from drape.errors import DrapeError
from drape.scene.material import Material


def learned_density(material: Material, face_area: float) -> float:
    """Areal density of the cloth that a law was learned from [kg/m²]: two faces for each inner vertex."""
    return material.mass_per_vertex / (2.0 * face_area)


def at_density(
    law: HingeLaw | EdgeLaw, material: Material, areal_density: float | None
) -> HingeLaw | EdgeLaw:
    """The law for a cloth of ``areal_density`` [kg/m²]; None: as it was learned.

    Energies [J], dampers and drags [kg/s] are multiplied by ``areal_density / learned_density``: in the equation of
    motion all forces then grow as the masses do, and the cloth moves as the one learned from.

    Raises:
        DrapeError: a density that is not positive.
    """
    if areal_density is None:
        return law
    if not (math.isfinite(areal_density) and areal_density > 0):
        raise DrapeError(f"energy.areal_density: found {areal_density}; expected kg/m2, more than 0, or null")
    times = areal_density / learned_density(material, law.face_area)
    if isinstance(law, BakedHinges):
        return _scaled_table(law, times)
    return ScaledHinges(law, times) if isinstance(law, HingeLaw) else ScaledEdges(law, times)


def _scaled_table(law: BakedHinges, times: float) -> BakedHinges:
    """Again a table, for which everything is compiled."""
    scaled = copy.deepcopy(law)
    scaled.plane = SplinePlane(times * law.plane.values, law.plane.first, law.plane.step)
    scaled.damper, scaled.drag = times * law.damper, times * law.drag
    return scaled


class ScaledHinges(HingeLaw):
    """``times φp`` of another law, and ``times`` its damping."""

    def __init__(self, law: HingeLaw, times: float):
        super().__init__(law.face_area, times * law.damper, times * law.drag)
        self.law, self.times = law, times

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        return self.times * self.law.potential(q)


class ScaledEdges(EdgeLaw):
    """``times φp`` and ``times φd`` of another law."""

    def __init__(self, law: EdgeLaw, times: float):
        super().__init__()
        self.law, self.times = law, times
        self.face_area, self.dt, self.bends, self.dissipates = law.face_area, law.dt, law.bends, law.dissipates

    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.times * self.law.potential(q, attributes)

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.times * self.law.drag(speed, attributes)

    def potential_slopes(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"], *, hessian: bool
    ) -> Slopes:
        slopes = self.law.potential_slopes(q, attributes, hessian=hessian)
        second = None if slopes.hessian is None else self.times * slopes.hessian
        return Slopes(self.times * slopes.energy, self.times * slopes.gradient, second)

    def drag_slopes(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        energy, slope = self.law.drag_slopes(speed, attributes)
        return self.times * energy, self.times * slope
