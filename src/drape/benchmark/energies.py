"""Cost of the laws of a fabric: energy with forces, and the Hessians that a solver factorises."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence

import numpy as np
from omegaconf import DictConfig
from torch import Tensor

from drape import config as conf
from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.scene_step import SceneSteps
from drape.energy.step import Step
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.solver.implicit import PRECISIONS

WARM_UP = 2
"""Rounds that are not counted."""


class Energies:
    """Medians [ms] of energy and forces, of the Hessian and of the rough Hessian of each of the config's energies.

    All at the same deformed state of the config's scene; in each round every energy has its turn, in each precision.
    Only what belongs to the fabric counts: inertia, gravity and contact are the same for all.
    """

    def __init__(self, precisions: Sequence[str], repeats: int):
        self.precisions = precisions
        self.repeats = repeats

    def measure(self, config: DictConfig) -> Measured:
        """Of the scene and the energies of ``config``."""
        circumstances = Circumstances()
        composed, scene = Composed(config), conf.instantiate(config.scene)
        calls = {}
        for precision in self.precisions:
            for energy in config.energies:
                for part, call in self._parts(composed, scene, energy, precision).items():
                    calls[energy, precision, part] = call
        seconds = medians(calls, self.repeats)
        rows = []
        for precision in self.precisions:
            for energy in config.energies:
                ms = {part: 1e3 * seconds[energy, precision, part] for part in ("forces", "hessian", "rough")}
                rows.append(
                    {
                        "energy": energy,
                        "precision": precision,
                        "energy_and_forces_ms": ms["forces"],
                        **{
                            f"{other}_takes_times": seconds[other, precision, "forces"] / (1e-3 * ms["forces"])
                            for other in config.energies
                        },
                        "hessian_ms": ms["hessian"],
                        "rough_hessian_ms": ms["rough"],
                    }
                )
        title = (
            f"Energies of {scene.material.name} at {scene.mesh.num_vertices} vertices and "
            f"{len(scene.mesh.edges)} edges, medians of {self.repeats}"
        )
        return Measured("energies", title, rows, circumstances.text())

    def _parts(self, composed: Composed, scene: Scene, energy: str, precision: str) -> dict[str, Callable]:
        law = composed.law(energy)
        potential = IncrementalPotential(law.terms).with_laws_in(PRECISIONS[precision])
        step, x = deformed(scene, law.attributes)
        return {
            "forces": lambda: potential.evaluate(x, step),
            "hessian": lambda: potential.hessian(x, step),
            "rough": lambda: potential.hessian(x, step, rough=True),
        }


def deformed(scene: Scene, attributes: Tensor) -> tuple[Step, Tensor]:
    """A step of a scene's cloth and positions at its end: stretched by some percent, in waves, moving."""
    rest = np.asarray(scene.mesh.rest_positions, np.float64)
    size = np.ptp(rest, axis=0).max()
    waves = np.sin(2 * np.pi * rest[:, [1, 0, 0]] / size * [3.0, 2.0, 5.0])
    x = rest * [1.03, 1.02, 1.0] + size * waves * [0.004, 0.004, 0.006]
    step = SceneSteps(scene, attributes).step(State(x, waves), 0.0, 1.0)
    return step, step.inertial


def medians(calls: dict[tuple, Callable[[], object]], repeats: int) -> dict[tuple, float]:
    """Median time of each call [s]; in each round all have their turn, so that all see the same machine."""
    times: dict[tuple, list[float]] = {key: [] for key in calls}
    for _ in range(WARM_UP + repeats):
        for key, call in calls.items():
            began = time.perf_counter()
            call()
            times[key].append(time.perf_counter() - began)
    return {key: statistics.median(found[WARM_UP:]) for key, found in times.items()}
