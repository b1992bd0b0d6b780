"""The kinds of garments: the tubes that each hangs in and the places where it ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from drape.garment import cuts
from drape.garment.anatomy import Anatomy
from drape.garment.blending import smooth_maximum, smooth_minimum
from drape.garment.loft import ROUNDED, Loft
from drape.garment.style import GarmentStyle

BLEND = 0.025
"""Width of the rounded corners where tubes meet [m]."""
LEG_GAP = 0.01
"""Half of the distance between the legs of trousers [m]."""
CLOSEST = 0.008
"""Distance to the body that is kept also where thighs nearly touch [m]."""
WAISTBAND = 0.007
"""Distance of a waistband from the body [m]."""

LOOPS = {"tshirt": 4, "top": 4, "jumpsuit": 5, "dress": 4, "skirt": 2, "trousers": 3}
"""Boundary loops: hems, collar, cuffs or armholes, waistband."""

Points = Float[np.ndarray, "*grid 3"]


@dataclass(frozen=True, eq=False)
class Pattern:
    """One garment for one body, before it has a mesh."""

    kind: str
    body: Anatomy
    style: GarmentStyle
    ease: float
    """The style's ease and what the mesh needs so that its flat faces stay clear of round limbs, too [m]."""

    @property
    def has_sleeves(self) -> bool:
        return self.kind in ("tshirt", "jumpsuit", "dress")

    @property
    def has_legs(self) -> bool:
        return self.kind in ("jumpsuit", "trousers")

    @property
    def has_waistband(self) -> bool:
        return self.kind in ("skirt", "trousers")

    @property
    def hem(self) -> float:
        """Height of the hem [m]."""
        high, low = (self.body.waist, self.body.crotch) if self.kind in ("tshirt", "top") else self._leg_range
        return high + self.style.length * (low - high)

    @property
    def _leg_range(self) -> tuple[float, float]:
        return self.body.crotch - 0.06 * self.body.scale, self.body.ankle + 0.02 * self.body.scale

    def box(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Corners of the space in which the garment lies [m]."""
        body, margin = self.body, 0.05
        widest = np.abs(self.trunk.centre).max(0) + self.trunk.half[self._heights > self.hem - margin].max(0)
        wide = max(widest[0], body.shoulder[0] + 0.05 * body.scale)
        if self.has_sleeves:
            wide = max(wide, body.shoulder[0] + self.style.sleeve * (body.wrist[0] - body.shoulder[0]) + 0.05)
        if self.has_legs:
            wide = max(wide, body.leg.half.max() + self.style.flare * 0.5 + body.leg.origin[0] + 0.1)
        deep = widest[1] + 0.02 + (0.1 if self.has_legs else 0.0)
        top = body.waist + margin if self.has_waistband else body.throat + margin
        low = np.array([-wide - margin, -deep - margin, self.hem - margin])
        return low, np.array([wide + margin, deep + margin, top])

    @cached_property
    def _heights(self) -> Float[np.ndarray, " sections"]:
        return self.body.armpit - self.trunk.along

    @cached_property
    def trunk(self) -> Loft:
        """The tube around the torso; of dress and skirt down to the hem."""
        loft = self.body.torso.wider(self.ease + 0.004)
        start = self.body.armpit - self.body.waist if self.has_waistband else 0.0
        hip = self.body.armpit - self.body.hip
        if self.has_legs:
            return loft.hanging(self.style.fit, start, hip).smoothed()
        loft = loft.hanging(self.style.fit, start)
        if self.kind not in ("dress", "skirt"):
            return loft.smoothed()
        return loft.hanging(0.0, hip).flared(hip - 0.05 * self.body.scale, self.style.flare).smoothed()

    def field(self, points: Points, distance: Float[np.ndarray, "*grid"]) -> Float[np.ndarray, "*grid"]:
        """Negative inside the cloth, positive outside [m]; ``distance`` is that to the body at ``points``."""
        field = distance - self._spacing(points)
        field = smooth_minimum(field, self._trunk_field(points), BLEND)
        if self.has_legs:
            field = smooth_minimum(field, self._legs(points), BLEND)
            field = np.minimum(np.maximum(field, self._between_legs(points)), distance - CLOSEST)
        return smooth_minimum(field, self._sleeves(points), BLEND) if self.has_sleeves else field

    def _trunk_field(self, points: Points) -> Float[np.ndarray, "*grid"]:
        trunk, z = self.trunk.distance(points), points[..., 2]
        if self.has_waistband:
            trunk = smooth_maximum(trunk, z - self.body.waist + 0.03 * self.body.scale, ROUNDED)
        if self.has_legs:
            trunk = smooth_maximum(trunk, self.body.crotch - 0.02 * self.body.scale - z, ROUNDED)
        return trunk

    def _between_legs(self, points: Points) -> Float[np.ndarray, "*grid"]:
        """Positive in a gap between the legs that closes in an arch below the crotch."""
        arch = np.maximum(points[..., 2] - self.body.crotch + 0.05 * self.body.scale, 0.0)
        return LEG_GAP - np.abs(points[..., 0]) - arch

    def _spacing(self, points: Points) -> Float[np.ndarray, "*grid"]:
        """Wanted distance to the body: the ease, less at a waistband."""
        if not self.has_waistband:
            return np.full(points.shape[:-1], self.ease)
        near = np.exp(-(((points[..., 2] - self.body.waist) / (0.04 * self.body.scale)) ** 2))
        return self.ease + (WAISTBAND - self.style.ease) * near

    def _legs(self, points: Points) -> Float[np.ndarray, "*grid"]:
        knee = self.body.hip - self.body.knee
        loft = self.body.leg.wider(self.ease + 0.002).hanging(self.style.fit, 0.3 * knee)
        return loft.flared(knee, self.style.flare).smoothed().distance(_mirrored(points))

    def _sleeves(self, points: Points) -> Float[np.ndarray, "*grid"]:
        start = 0.14 * self.body.scale
        loft = self.body.arm.wider(self.ease + 0.004).hanging(self.style.fit, start).beyond(start)
        return loft.distance(_mirrored(points))

    def ends(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Positive on the garment, zero on its boundary: the smallest of all its cuts [m]."""
        hem = cuts.above(points, self.hem)
        found: list[np.ndarray] = [hem]
        if self.kind == "tshirt":
            found = [np.maximum(hem, np.abs(points[:, 0]) - self.trunk.half[:, 0].max() - 0.03)]
        if self.has_waistband:
            found.append(cuts.below(points, self.body.waist))
        else:
            found.append(cuts.collar(points, self.body, self.style))
        if self.has_sleeves:
            found.append(cuts.cuff(points, self.body, self.style.sleeve, self.trunk.reach(points)))
        if self.kind == "top":
            found.append(cuts.armhole(points, self.body, self.style, self.trunk.reach(points)))
        return np.min(found, axis=0)


def _mirrored(points: Points) -> Points:
    """The same places on the left side."""
    return np.concatenate([np.abs(points[..., :1]), points[..., 1:]], axis=-1)
