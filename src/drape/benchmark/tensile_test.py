"""The tensile test of the Kawabata system: a sheet 20 cm wide between clamps 5 cm apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import brentq

from drape.benchmark.sample import Sample
from drape.benchmark.triangular_sheet import triangular_sheet
from drape.energy.scene_step import SceneSteps
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State

WIDTH, GAUGE = 0.20, 0.05
"""Of the sheet, and between the clamps [m]."""
SMALL = 0.01
"""Strain at which the stiffness is taken."""
LARGEST = 4.0
"""Strain up to which a load is looked for."""
RATE = 1e-3
"""Strain of the step in which damping is measured."""


@dataclass(frozen=True)
class Pulled:
    """Result of the test of a fabric."""

    stiffness: float
    """Load per strain at 1 % [N/m]."""
    extensions: tuple[float, ...]
    """At the loads asked for; infinite where 400 % are not enough."""
    damping_time: float
    """Load per rate of strain over load per strain [s]: what damps stretching."""


class TensileTest:
    """A sheet of ``cells`` columns, an even number, from clamp to clamp; its loads [N/m] are those of the half in the
    middle of its width.

    Clamped across, the sheet cannot grow narrow there; its hems, which are stiffer in laws of springs, are outside.
    """

    def __init__(self, sample: Sample, cells: int):
        self.sample = sample
        self.mesh, column = triangular_sheet(GAUGE, WIDTH, cells)
        self.rest = np.asarray(self.mesh.rest_positions, np.float64)
        self.clamped = np.flatnonzero((column == 0) | (column == cells))
        middle = (column == cells) & (np.abs(self.rest[:, 1]) <= 0.25 * WIDTH)
        spacing = WIDTH / (np.count_nonzero(column == cells) - 1)
        self.weights = middle / (np.count_nonzero(middle) * spacing)
        """Weight of each vertex's force in the load of the second clamp [1/m]."""

    def run(self, loads: Sequence[float]) -> Pulled:
        """Everything, with the extensions at ``loads`` [N/m]."""
        stiffness = self.load(SMALL) / SMALL
        return Pulled(stiffness, tuple(map(self.extension, loads)), self.viscosity() / stiffness)

    def load(self, strain: float) -> float:
        """At rest, the clamps that much farther apart [N/m]."""
        scene = self._scene(strain)
        return self._load(self.sample.at_rest(scene).x, scene.initial.x * 0.0, scene, moving=False)

    def extension(self, load: float) -> float:
        """Strain at a load [N/m]."""
        if self.load(LARGEST) < load:
            return float("inf")
        return float(brentq(lambda strain: self.load(strain) - load, 0.0, LARGEST, rtol=1e-3))

    def viscosity(self) -> float:
        """Growth of the load with the rate of strain, when the sheet is being stretched [N s/m]."""
        scene = self._scene(RATE)
        after, before = scene.initial.x, self.rest
        more = self._load(after, before, scene, moving=True) - self._load(after, before, scene, moving=False)
        return more * scene.dt / RATE

    def _scene(self, strain: float) -> Scene:
        """The sheet, stretched evenly, between its clamps; no weight acts in its plane."""
        x = self.rest * [1.0 + strain, 1.0, 1.0]
        return self.sample.scene("tensile test", self.mesh, x, pins=Pins.fixed(self.clamped, x), gravity=0.0)

    def _load(
        self,
        x: Float[np.ndarray, "vertices 3"],
        before: Float[np.ndarray, "vertices 3"],
        scene: Scene,
        *,
        moving: bool,
    ) -> float:
        """On the second clamp [N/m], of cloth that stands still at ``x`` or has moved there from ``before``."""
        steps = SceneSteps(scene, self.sample.law.attributes)
        start = State.at_rest(before if moving else x)
        step = steps.step(start, 0.0, 1.0)
        at = torch.from_numpy(x - steps.origin(start))
        pulls = (term.energy_and_gradient(at, step)[1] for term in self.sample.law.terms)
        pull = sum(pulls, torch.zeros_like(at))
        return float(self.weights @ pull[:, 0].numpy())
