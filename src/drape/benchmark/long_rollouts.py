"""Whether trained simulators stay in hand for long: bodies that go on moving, and then stand still."""

from __future__ import annotations

import glob
import sys
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, Int
from omegaconf import DictConfig
from torch import Tensor
from tqdm import tqdm

from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.contact.penetration import Penetration
from drape.data.motion import edge_strain, speeds
from drape.data.recorded_scene import recorded_scene
from drape.data.trajectories import open_dressed
from drape.energy.fabric import Fabric
from drape.energy.scene_step import SceneSteps
from drape.energy.term import EnergyTerm
from drape.errors import DrapeError
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.neural.checkpoint import Trained, load_simulator, training_name
from drape.simulators.neural.neural import NeuralSimulator
from drape.simulators.simulator import Outcome

EVERY = 10
"""Frames between two that are looked at for vertices inside the body."""


class LongRollouts:
    """Test garments over ``frames``: the body plays its motion there and back, and stands still from ``stand`` on.

    A body that stands does no work, so from then on kinetic, gravitational and elastic energy together may only fall;
    the elastic energy is what a simulator was trained with, for supervised ones that of the config's ``elastic``.

    Args:
        checkpoints: of ``train.py``, patterns.
        path: data set of garments.
        sequences: the first of the test split.
        frames: to simulate.
        stand: frame from which on the body stands.

    Raises:
        DrapeError: no checkpoint, no sequences, or frames out of order.
    """

    def __init__(self, checkpoints: Sequence[str], path: str, sequences: int, frames: int, stand: int):
        if not (0 < stand < frames and sequences > 0):
            raise DrapeError(
                f"conf: measure: found sequences {sequences}, stand {stand}, frames {frames}; expected at least one "
                "sequence and 0 < stand < frames"
            )
        self.checkpoints = sorted(path for pattern in checkpoints for path in glob.glob(pattern))
        if not self.checkpoints:
            raise DrapeError(
                f"conf: measure.checkpoints: found no file {' or '.join(checkpoints)}; expected checkpoints of "
                "simulators, from python src/train.py model=mgn_s_eunet or its like"
            )
        self.path, self.sequences, self.frames, self.stand = path, sequences, frames, stand

    def measure(self, config: DictConfig) -> Measured:
        """One row for each checkpoint."""
        circumstances, composed = Circumstances(), Composed(config)
        file = open_dressed(self.path)
        chosen, rows = file.split("test")[: self.sequences], []
        total = len(chosen) * len(self.checkpoints)
        with tqdm(total=total, desc="animating", unit=" sequences", file=sys.stderr) as bar:
            for path in self.checkpoints:
                trained, found = load_simulator(path), []
                for name in chosen:
                    sequence = file.sequence(name)
                    scene = prolonged(recorded_scene(sequence), self.frames, self.stand)
                    law = composed.law("elastic", sequence.fabric)
                    found.append(_rollout(trained, scene, self.stand, law))
                    bar.update()
                rows.append(_summary(trained, found))
        title = (
            f"{self.path}: {len(chosen)} test garments over {self.frames} frames; the body moves there and back for "
            f"{self.stand}, then it stands"
        )
        return Measured("long_rollouts", title, rows, circumstances.text())


def there_and_back(frames: int, recorded: int, stand: int) -> Int[np.ndarray, " shown"]:
    """Number of the ``recorded`` frame that is shown in each of ``frames + 1``; from ``stand`` on always the same."""
    shown = np.minimum(np.arange(frames + 1), stand) % (2 * (recorded - 1))
    return np.minimum(shown, 2 * (recorded - 1) - shown)


def prolonged(scene: Scene, frames: int, stand: int) -> Scene:
    """The scene with its body and its pinned vertices :func:`there_and_back`."""
    shown = there_and_back(frames, scene.frames + 1, stand)
    pins = None if scene.pins is None else Pins(scene.pins.vertices, scene.pins.targets[shown])
    body = None if scene.obstacle is None else Obstacle(scene.obstacle.faces, scene.obstacle.positions[shown])
    return replace(scene, frames=frames, pins=pins, obstacle=body, reference=None)


def total_energy(
    x: Float[np.ndarray, "frames vertices 3"], scene: Scene, terms: Sequence[EnergyTerm], attributes: Tensor
) -> Float[np.ndarray, " frames-1"]:
    """Kinetic and gravitational energy with that of ``terms``, per mass [J/kg], from the second frame on.

    Velocities by backward differences, and heights between the same two frames: what falls freely keeps its energy.
    """
    moving = 0.5 * speeds(x, scene.dt) ** 2 - 0.5 * (x[1:] + x[:-1]) @ scene.gravity
    step = SceneSteps(scene, attributes).step(scene.initial, 0.0, 1.0)
    with torch.no_grad():
        places = [torch.from_numpy(frame - frame.mean(axis=0)) for frame in x[1:]]
        stored = np.array([[float(term(place, step)) for place in places] for term in terms])
    return (moving @ scene.mass + stored.sum(axis=0)) / scene.mass.sum()


def largest_rise(energy: Float[np.ndarray, " frames"]) -> float:
    """By how much the energy is at some time above what it was at an earlier one."""
    return float((energy - np.minimum.accumulate(energy)).max())


def _rollout(trained: Trained, scene: Scene, stand: int, law: Fabric) -> Row:
    simulator = NeuralSimulator(trained.network, trained.cloths, scene)
    states: list[State] = [scene.initial]
    finite, began = 0, time.perf_counter()
    for frame in range(scene.frames):
        result = simulator.step(states[-1], frame)
        finite += result.outcome is Outcome.CONVERGED
        states.append(result.state)
    seconds = time.perf_counter() - began
    x = np.stack([state.x for state in states])
    penetration = None if scene.obstacle is None else Penetration(scene.mesh, scene.obstacle)
    inside = [0.0 if penetration is None else penetration.inside(x[k], k) for k in range(EVERY, len(x), EVERY)]
    terms = trained.cloths.terms(scene.material)
    terms, attributes = (terms, trained.cloths.of(scene.material).attributes) if terms else (law.terms, law.attributes)
    stored = [term for term in terms if term.stores]
    energy = total_energy(x[stand:], simulator.scene, stored, attributes)
    return {
        "finite": finite / scene.frames,
        "inside": float(np.mean(inside)),
        "strain": float(np.sqrt(np.mean(edge_strain(x[-1:], scene.mesh) ** 2))),
        "speed": float(np.linalg.norm(states[-1].v, axis=-1).mean()),
        "change": float(energy[-1] - energy[0]),
        "rise": largest_rise(energy),
        "seconds": seconds / scene.frames,
    }


def _summary(trained: Trained, found: list[Row]) -> Row:
    """Means over sequences; of energies the worst."""
    of = {name: np.array([row[name] for row in found]) for name in found[0]}
    told = trained.training
    return {
        "row": training_name(told) + ("" if told["ablation"] == "none" else f" {told['ablation']}"),
        "seed": str(told["seed"]),
        "finite_frames_percent": 100 * of["finite"].mean(),
        "inside_percent": 100 * of["inside"].mean(),
        "last_strain_rms_percent": 100 * of["strain"].mean(),
        "last_speed_m_per_s": of["speed"].mean(),
        "energy_change_worst_J_per_kg": of["change"].max(),
        "energy_rise_worst_J_per_kg": of["rise"].max(),
        "ms_per_frame": 1e3 * np.median(of["seconds"]),
    }
