"""A large hanging cloth against Blender's own, frame by frame in turn."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Mapping

import numpy as np
from omegaconf import DictConfig
from tqdm import tqdm

from drape import config as conf
from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.blender.presets import fabric_settings
from drape.blender.timed_cloth import TimedCloth
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.simulators.simulator import Outcome, Simulator, StepResult

BLENDER = "Blender"


class Hanging:
    """Time per frame [ms] of the config's energies in our solver and of Blender's cloth: same mesh, masses and fabric.

    Args:
        residual: unbalanced force at which a step is done, mean over the free vertices, as a share of their weight.

    Raises:
        DrapeError: a residual that is not positive.
    """

    def __init__(self, residual: float):
        if not residual > 0:
            raise DrapeError(f"residual: found {residual}; expected a share of the weight, more than 0")
        self.residual = residual

    def measure(self, config: DictConfig) -> Measured:
        """Of the scene of ``config``; each frame is made by all in turn, so that all see the same machine."""
        circumstances, composed = Circumstances(), Composed(config)
        scene: Scene = conf.instantiate(config.scene)
        settings = _settings(config, float(scene.mass.mean()))
        weight = float(np.linalg.norm(scene.gravity) * scene.mass.mean())
        tolerance = self.residual * weight
        for name in config.energies:  # what is compiled when it is first used is compiled before anything is timed
            composed.simulator(scene, name, iterations=3).step(scene.initial, 0)
        ours = {name: _Ours(composed.simulator(scene, name, tolerance=tolerance), scene) for name in config.energies}
        seconds: dict[str, list[float]] = {name: [] for name in (BLENDER, *ours)}
        blender = TimedCloth(scene, settings)
        try:
            for frame in tqdm(range(scene.frames), desc="hanging", unit=" frames", file=sys.stderr):
                x, spent = blender.step()
                seconds[BLENDER].append(spent)
                for name, simulated in ours.items():
                    seconds[name].append(simulated.step(frame))
        finally:
            blender.close()
        row: Row = {"simulator": BLENDER, **_times(seconds, BLENDER), "evaluations": "", "residual_percent": ""}
        rows: list[Row] = [{**row, "converged_percent": "", "mean_height_m": float(x[:, 2].mean())}]
        rows += [{"simulator": n, **_times(seconds, n), **each.report(weight)} for n, each in ours.items()]
        title = (
            f"{scene.name}: {scene.mesh.num_vertices} vertices of {scene.material.name}, {scene.mass.sum():.4g} kg, "
            f"{scene.frames} frames of {scene.dt:.4g} s, residual at most {100 * self.residual:g} % of the weight"
        )
        return Measured("hanging", title, rows, circumstances.text())


def _settings(config: DictConfig, mass: float) -> dict[str, float | int | str]:
    """Blender's settings of the fabric. Its drag is that of a vertex, whatever the mesh: here as before per mass."""
    preset = config.material[config.fabric.name]
    settings = fabric_settings(config.fabric.name, preset.preset, preset.get("overrides") or {})
    return settings | {"air_damping": float(settings["air_damping"]) * mass / float(settings["mass"])}


class _Ours:
    def __init__(self, simulator: Simulator, scene: Scene):
        self.simulator, self.state = simulator, scene.initial
        self.results: list[StepResult] = []

    def step(self, frame: int) -> float:
        began = time.perf_counter()
        self.results.append(self.simulator.step(self.state, frame))
        seconds = time.perf_counter() - began
        self.state = self.results[-1].state
        return seconds

    def report(self, weight: float) -> dict[str, float]:
        converged = [result.outcome is Outcome.CONVERGED for result in self.results]
        return {
            "evaluations": statistics.mean(result.iterations for result in self.results),
            "residual_percent": 100 * max(result.residual for result in self.results) / weight,
            "converged_percent": 100 * statistics.mean(converged),
            "mean_height_m": float(self.state.x[:, 2].mean()),
        }


def _times(seconds: Mapping[str, list[float]], name: str) -> dict[str, float]:
    median, mean = ({n: 1e3 * of(each) for n, each in seconds.items()} for of in (statistics.median, statistics.mean))
    return {
        "ms_per_frame": median[name],
        "blenders_times": median[name] / median[BLENDER],
        "mean_ms_per_frame": mean[name],
        "blenders_times_mean": mean[name] / mean[BLENDER],
    }
