"""Mesh dependence: the sag of the same physical cloth in coarser and finer meshes."""

from __future__ import annotations

import copy
import dataclasses
import sys
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from omegaconf import DictConfig, ListConfig
from tqdm import tqdm

from drape import config as conf
from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured
from drape.errors import DrapeError
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Simulator

REFINED = ("resolution", "clamped_rows")
"""Values of a scene that count rows of vertices."""


class Settled(NamedTuple):
    """A cloth that has come to rest, or not."""

    sag: float
    """Sag of the place of interest below the pins [m]; see :func:`sag`."""
    lowest: float
    """Sag of the lowest vertex [m]."""
    steps: int
    still: bool


class Resolution:
    """Sag of each of the config's scenes at rest, by mesh, fabric and energy, and its change from the mesh as given.

    Args:
        refinements: multiples of the number of edges along the sides; 1 is the scene as given.
        step: time step; a long one damps motion, and rest does not depend on it [s].
        steps: at most.
        still: mean motion of a vertex in a step at which the cloth is at rest, as a share of the sag.
        at: by name of the scene, the place whose sag is measured; see :func:`sag`.
        hold: by name of the scene, half the side of the square around each pin within which vertices are held as well
            [m]. A sheet that hangs by points alone hangs the lower the finer its mesh is, by the logarithm of the edge
            length, whatever its law: the stress at a point has no limit.

    Raises:
        DrapeError: no refinement of 1.
    """

    def __init__(
        self,
        refinements: Sequence[float],
        step: float,
        steps: int,
        still: float,
        at: Mapping[str, Sequence[float]],
        hold: Mapping[str, float],
    ):
        if 1.0 not in refinements:
            raise DrapeError(f"measure.refinements: found {list(refinements)}; expected 1.0 among them")
        self.refinements = sorted(refinements, key=lambda refinement: refinement != 1.0)
        self.step = step
        self.steps = steps
        self.still = still
        self.at = at
        self.hold = hold

    def measure(self, config: DictConfig) -> Measured:
        """Of the scenes, fabrics and energies of ``config``."""
        circumstances, composed, rows = Circumstances(), Composed(config), []
        cases = [(s, f, e) for s in config.scenes for f in config.fabrics for e in config.energies]
        for name, fabric, energy in tqdm(cases, desc="settling", file=sys.stderr):
            found: dict[float, Settled] = {}
            for refinement in self.refinements:
                node = refined(composed.with_fabric(fabric).scenes[name], refinement, f"scenes.{name}")
                node.fps, node.frames = 1.0 / self.step, self.steps
                scene = held_around_pins(conf.instantiate(node), self.hold.get(name, 0.0))
                found[refinement] = self._settle(composed.simulator(scene, energy, fabric), scene, self.at[name])
                rows.append(
                    {
                        "scene": name,
                        "fabric": fabric,
                        "energy": energy,
                        "refinement": refinement,
                        "vertices": scene.mesh.num_vertices,
                        "sag_m": found[refinement].sag,
                        "sag_change_percent": 100 * (found[refinement].sag / found[1.0].sag - 1.0),
                        "lowest_m": found[refinement].lowest,
                        "lowest_change_percent": 100 * (found[refinement].lowest / found[1.0].lowest - 1.0),
                        "steps": found[refinement].steps,
                        "at_rest": "yes" if found[refinement].still else "no",
                    }
                )
        title = f"Sag of the same cloth in coarser and finer meshes, at rest (steps of {self.step:g} s)"
        return Measured("resolution", title, rows, circumstances.text())

    def _settle(self, simulator: Simulator, scene: Scene, at: Sequence[float]) -> Settled:
        state = scene.initial
        for frame in range(self.steps):
            before, state = state, simulator.step(state, frame).state
            moved = float(np.linalg.norm(state.x - before.x, axis=1).mean())
            still = moved <= self.still * abs(sag(scene, state, at))
            if still:
                break
        lowest = float(_pins(scene).targets[0, :, 2].max() - state.x[:, 2].min())
        return Settled(sag(scene, state, at), lowest, frame + 1, still)


def refined(scene: DictConfig, refinement: float, where: str) -> DictConfig:
    """A scene's node with ``refinement`` times as many edges along the sides, and as many rows clamped.

    Raises:
        DrapeError: a number of edges that cannot be multiplied so.
    """
    node = copy.deepcopy(scene)
    for name in REFINED:
        if name not in node:
            continue
        counts = node[name] if isinstance(node[name], ListConfig) else [node[name]]
        finer = [(count - 1) * refinement + 1 for count in counts]
        if any(count != round(count) for count in finer):
            raise DrapeError(
                f"conf: {where}.{name}: found {node[name]} vertices; expected numbers of edges whose "
                f"{refinement:g}-fold is whole; an odd number of vertices can be halved"
            )
        whole = [round(count) for count in finer]
        node[name] = whole if isinstance(node[name], ListConfig) else whole[0]
    return node


def held_around_pins(scene: Scene, reach: float) -> Scene:
    """The scene with all vertices held that are at rest within ``reach`` [m] of a pin along each axis."""
    if not reach:
        return scene
    rest = np.asarray(scene.mesh.rest_positions, np.float64)
    away = np.abs(rest[:, None] - rest[_pins(scene).vertices]).max(axis=-1).min(axis=1)
    return dataclasses.replace(scene, pins=Pins.fixed(np.flatnonzero(away <= 1.001 * reach), scene.initial.x))


def sag(scene: Scene, state: State, at: Sequence[float]) -> float:
    """Sag of the vertex nearest to a place below the highest pin [m].

    ``at``: the place, as shares of the sheet's sides along x and y from their lowest values, at rest.
    """
    rest = np.asarray(scene.mesh.rest_positions, np.float64)[:, :2]
    place = rest.min(axis=0) + np.array(at) * np.ptp(rest, axis=0)
    nearest = int(np.linalg.norm(rest - place, axis=1).argmin())
    return float(_pins(scene).targets[0, :, 2].max() - state.x[nearest, 2])


def _pins(scene: Scene) -> Pins:
    if scene.pins is None:
        raise DrapeError(
            f"scene {scene.name}: found no pinned vertex; expected some that the cloth hangs by; choose another scene"
        )
    return scene.pins
