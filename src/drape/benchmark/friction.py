"""Friction of our solver and of Blender compared with Coulomb's law: slopes, plates that are pushed or turned."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from omegaconf import DictConfig
from tqdm import tqdm

from drape import config as conf
from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured
from drape.benchmark.sheet_on_plate import SheetOnPlate, Simulate, slides_from
from drape.blender.cloth_on_body import ClothOnBody
from drape.blender.presets import fabric_settings
from drape.data.blender_friction import HIGHEST_NUMBER, coefficient
from drape.errors import DrapeError
from drape.scene.scene import Scene

BLENDER = "Blender"


class Friction:
    """One row for each coefficient and simulator: Blender's cloth, and each energy of the config in our solver.

    On a slope of ``tan φ = 2 μ`` a block accelerates by ``g (sin φ - μ cos φ)``; a plate that is pushed aside by
    ``2 μ g`` hands over half of its motion; one that comes to turn with ``ω² r = μ g / 8`` takes it along. Below the
    limit our term lets it creep (see its class): the last column, at ``tan φ = μ / 2``.

    Args:
        coefficients: μ.
        sheet: of :class:`~drape.benchmark.sheet_on_plate.SheetOnPlate`, without its material.
        still: acceleration up to which a sheet on a slope is said to rest [m/s²].
        halvings: of the range from μ/2 to 3 μ/2 in which the limit of sliding is looked for.
        radius: distance of the sheet from the axis of the plate that turns [m].
        residual: unbalanced force at which a step of our solver is done, mean over the vertices, as a share of their
            weight; a friction of μ = 0.02 is 0.02 of the weight.
        steps: of Blender's solver per frame.
        blender: its contact, as in conf/data/garments.yaml.

    Raises:
        DrapeError: a coefficient that Blender cannot have.
    """

    def __init__(
        self,
        coefficients: Sequence[float],
        sheet: Mapping[str, float],
        still: float,
        halvings: int,
        radius: float,
        residual: float,
        steps: int,
        blender: Mapping[str, float],
    ):
        highest = coefficient(HIGHEST_NUMBER)
        wrong = [value for value in coefficients if not 0 < value <= highest]
        if wrong or not coefficients:
            raise DrapeError(
                f"measure.coefficients: found {list(coefficients)}; expected numbers above 0 up to {highest:g}, the "
                "highest that Blender has"
            )
        self.coefficients, self.sheet = coefficients, sheet
        self.still, self.halvings, self.radius = still, halvings, radius
        self.residual, self.steps, self.blender = residual, steps, blender

    def measure(self, config: DictConfig) -> Measured:
        """Of the fabric of ``config``, without air drag in Blender, as our solver has none."""
        circumstances, composed = Circumstances(), Composed(config)
        given: dict[str, Any] = dict(self.sheet)
        sheet = SheetOnPlate(conf.instantiate(config.fabric), **given)
        blender = ClothOnBody(self._settings(config), self.blender)
        simulators: dict[str, Simulate] = {BLENDER: blender}
        simulators |= {name: self._solver(composed, name) for name in config.energies}
        cases = [(value, name) for value in self.coefficients for name in simulators]
        try:
            rows = [
                {"coefficient": value, "simulator": name, **self._row(sheet, simulators[name], value)}
                for value, name in tqdm(cases, desc="sliding", file=sys.stderr)
            ]
        finally:
            blender.close()
        title = (
            f"A sheet of {sheet.resolution**2} vertices of {sheet.material.name} on a plate, beside a block with "
            "Coulomb's friction: 50 % taken over when pushed, 100 % when turned"
        )
        return Measured("friction", title, rows, circumstances.text())

    def _row(self, sheet: SheetOnPlate, simulate: Simulate, value: float) -> dict[str, float]:
        limit = slides_from(sheet, simulate, value, self.still, self.halvings)
        steep, normal = math.atan(2.0 * value), value * sheet.gravity
        rate = math.sqrt(0.125 * normal / self.radius)
        return {
            "slides_from_deg": math.degrees(math.atan(limit)),
            "block_deg": math.degrees(math.atan(value)),
            "off_percent": 100.0 * (limit / value - 1.0),
            "acceleration_m_per_s2": sheet.slope(simulate, value, 2.0 * value).acceleration,
            "block_m_per_s2": sheet.gravity * (math.sin(steep) - value * math.cos(steep)),
            "pushed_percent": 100.0 * sheet.pushed(simulate, value, 2.0 * normal),
            "turned_percent": 100.0 * sheet.turned(simulate, value, rate, self.radius),
            "creep_mm_per_s": 1e3 * sheet.slope(simulate, value, 0.5 * value).speed,
        }

    def _settings(self, config: DictConfig) -> dict[str, float | int | str]:
        preset = config.material[config.fabric.name]
        settings = fabric_settings(config.fabric.name, preset.preset, preset.get("overrides") or {})
        return settings | {"air_damping": 0.0, "quality": self.steps}

    def _solver(self, composed: Composed, energy: str) -> Simulate:
        def simulate(scene: Scene) -> np.ndarray:
            weight = float(np.linalg.norm(scene.gravity) * scene.mass.mean())
            simulator = composed.simulator(scene, energy, tolerance=self.residual * weight)
            state, positions = scene.initial, [scene.initial.x]
            for frame in range(scene.frames):
                state = simulator.step(state, frame).state
                positions.append(state.x)
            return np.stack(positions)

        return simulate
