"""A sheet of cloth on a flat plate that is tilted, pushed aside or turned, as a block with Coulomb's friction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from drape.geometry.grid import square_grid
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene
from drape.scene.state import State

Simulate = Callable[[Scene], Float[np.ndarray, "frames vertices 3"]]
"""Positions of the cloth [m] in all frames of a scene, the initial one included."""
UP = np.array([0.0, 0.0, 1.0])
PLATE = square_grid(40.0, 2)
"""Two faces, so large that the sheet stays on them and meets no edge but their diagonal."""


class Slide(NamedTuple):
    """Motion of the middle of a sheet down a slope."""

    acceleration: float
    """[m/s²]"""
    speed: float
    """In the last frame [m/s]."""


@dataclass(frozen=True)
class SheetOnPlate:
    """Experiments on friction, each begun when the sheet lies still under its weight on the plate.

    ``size`` is the side of the sheet [m], ``resolution`` its vertices along a side; ``gravity`` in m/s². It begins
    ``height`` [m] above the plate, settles for ``settle`` frames and moves for ``frames``. The plate lies in the xy
    plane; gravity is tilted instead of it.
    """

    material: Material
    size: float
    resolution: int
    gravity: float
    fps: float
    frames: int
    settle: int
    height: float

    def slope(self, simulate: Simulate, coefficient: float, tangent: float) -> Slide:
        """Down a slope φ of ``tan φ = tangent``; a block rests up to ``tan φ = μ``, then ``g (sin φ - μ cos φ)``."""
        angle = math.atan(tangent)
        gravity = self.gravity * np.array([math.sin(angle), 0.0, -math.cos(angle)])
        way = self._centres(simulate, coefficient, gravity, PLATE.rest_positions[None])[:, 0]
        return Slide(self._acceleration(way), float(way[-1] - way[-2]) * self.fps)

    def pushed(self, simulate: Simulate, coefficient: float, acceleration: float) -> float:
        """Acceleration of the sheet, in that of a plate that moves aside [m/s²]; of a block ``min(1, μ g / a)``."""
        way = 0.5 * acceleration * self._times**2
        plate = PLATE.rest_positions + way[:, None, None] * np.array([1.0, 0.0, 0.0])
        centres = self._centres(simulate, coefficient, -self.gravity * UP, plate)
        return self._acceleration(centres[:, 0]) / acceleration

    def turned(self, simulate: Simulate, coefficient: float, rate: float, radius: float) -> float:
        """Angle that the sheet has turned about the axis of a plate, ``radius`` [m] away from it, in that of the plate.

        The plate comes steadily to ``rate`` ω [rad/s] within the time T; a block turns with it while
        ``radius · sqrt(ω⁴ + (ω / T)²) < μ g``.
        """
        angle = 0.5 * rate * self._times**2 / self._times[-1]
        c, s, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        turn = np.moveaxis(np.array([[c, -s, o], [s, c, o], [o, o, o + 1.0]]), -1, 0)
        plate = PLATE.rest_positions @ turn.transpose(0, 2, 1)
        centres = self._centres(simulate, coefficient, -self.gravity * UP, plate, at=radius)
        found = np.unwrap(np.arctan2(centres[:, 1], centres[:, 0]))
        return float(found[-1] / angle[-1])

    def _acceleration(self, way: Float[np.ndarray, " frames"]) -> float:
        """That of the parabola through the last two thirds of the frames [m/s²]; implicit Euler's are parabolas."""
        later = slice(self.frames // 3, None)
        return float(2.0 * np.polyfit(self._times[later], way[later], 2)[0])

    @property
    def _times(self) -> Float[np.ndarray, " frames"]:
        """[s]"""
        return np.arange(self.frames + 1) / self.fps

    def _centres(
        self, simulate: Simulate, coefficient: float, gravity: np.ndarray, plate: np.ndarray, at: float = 0.0
    ) -> Float[np.ndarray, "frames 3"]:
        """The middle of the sheet in each frame [m]; it has settled ``at`` x [m] on the plate as it is at first."""
        mesh = square_grid(self.size, self.resolution)

        def scene(x: np.ndarray, gravity: np.ndarray, plate: np.ndarray, frames: int) -> Scene:
            return Scene(
                name="sheet on a plate",
                mesh=mesh,
                initial=State.at_rest(x),
                material=self.material,
                mass=np.full(mesh.num_vertices, self.material.mass_per_vertex),
                gravity=gravity,
                dt=1.0 / self.fps,
                frames=frames,
                obstacle=Obstacle(PLATE.faces, plate),
                friction=coefficient,
            )

        above = mesh.rest_positions + np.array([at, 0.0, self.height])
        settled = simulate(scene(above, gravity * UP, plate[:1], self.settle))[-1]
        return simulate(scene(settled, gravity, plate, self.frames)).mean(axis=1)


def slides_from(sheet: SheetOnPlate, simulate: Simulate, coefficient: float, still: float, halvings: int) -> float:
    """``tan φ`` of the slope from which on a sheet accelerates by more than ``still`` [m/s²]; from μ/2 to 3 μ/2."""
    low, high = 0.5 * coefficient, 1.5 * coefficient
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        if sheet.slope(simulate, coefficient, middle).acceleration > still:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)
