"""The drape test of Cusick: the shadow of a disc of cloth that hangs over a smaller pedestal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from PIL import Image, ImageDraw

from drape.benchmark.sample import GRAVITY, Sample
from drape.scene.built_in.cusick import cusick

PEDESTAL = 0.09
"""Radius of the pedestal [m]."""
FALL = 45
"""Frames of a thirtieth of a second in which the disc falls into its folds."""
UNEVEN = 0.01
"""Waves of the overhang at the start, as a share of it: an even disc has no reason to fold anywhere."""
PIXEL = 1e-4
"""Of the shadow [m]."""
FOLD = 0.04
"""Least height of a fold's crest above the hollows beside it, in radii of the pedestal."""


@dataclass(frozen=True)
class Draped:
    """A disc at rest over the pedestal."""

    radius: float
    """Of the disc [m]."""
    x: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    @property
    def coefficient(self) -> float:
        """Share of the overhang's area that its shadow has: 1 for a plate, 0 for cloth that hangs straight down."""
        held = np.pi * PEDESTAL**2
        return (shadow(self.x, self.faces) - held) / (np.pi * self.radius**2 - held)

    @property
    def folds(self) -> int:
        """Crests along the rim."""
        rings = int((len(self.x) / 3) ** 0.5)
        return crests(np.hypot(*self.x[-6 * rings :, :2].T), FOLD * PEDESTAL)


def drape_test(sample: Sample, diameter: float, rings: int) -> Draped:
    """A disc of ``diameter`` [m] of ``rings`` rings of vertices that has fallen and come to rest.

    Raises:
        DrapeError: see :func:`cusick`, :meth:`Sample.at_rest`.
    """
    radius = 0.5 * diameter
    scene = cusick(
        radius=radius, pedestal_radius=PEDESTAL, rings=rings, unevenness=UNEVEN * (radius - PEDESTAL),
        material=sample.material, mass={"areal_density": sample.areal_density}, gravity=(0.0, 0.0, -GRAVITY), fps=30.0,
        frames=FALL,
    )  # fmt: skip
    simulator, state = sample.solver(scene), scene.initial
    for frame in range(FALL):
        state = simulator.step(state, frame).state
    state = sample.at_rest(replace(scene, initial=state))
    return Draped(radius, state.x, np.array(scene.mesh.faces))


def shadow(x: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]) -> float:
    """Area that cloth covers seen from above [m²]; where faces lie over each other, once."""
    low = x[:, :2].min(axis=0) - 2 * PIXEL
    places = (x[:, :2] - low) / PIXEL
    picture = Image.new("1", tuple(np.ceil(places.max(axis=0)).astype(int) + 3))
    draw = ImageDraw.Draw(picture)
    for corners in places[faces]:
        draw.polygon([tuple(corner) for corner in corners], fill=1)
    return float(np.count_nonzero(np.asarray(picture))) * PIXEL**2


def crests(distance: Float[np.ndarray, " rim"], least: float) -> int:
    """Maxima of a closed curve that rise by ``least`` above the minima on both sides."""
    start = int(distance.argmin())
    values = np.roll(distance, -start)
    count, low, high, rising = 0, values[0], values[0], True
    for value in [*values[1:], values[0]]:
        if rising:
            high = max(high, value)
            if high - value >= least and high - low >= least:
                count, low, rising = count + 1, value, False
        else:
            low = min(low, value)
            if value - low >= least:
                high, rising = value, True
    return count
