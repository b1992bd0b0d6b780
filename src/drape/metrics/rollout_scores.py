"""Scores of recorded garments that a network animates during its training."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from torch import nn

from drape.contact.penetration import Penetration
from drape.data.recorded_scene import recorded_scene
from drape.data.sequence import GarmentSequence
from drape.errors import DrapeError
from drape.metrics.collision import behind_nearest_vertex
from drape.metrics.position import distance_by_frame
from drape.simulators.neural.cloths import Cloths
from drape.simulators.neural.neural import NeuralSimulator

EVERY = 8
"""Collisions are counted in every so many frames."""


class ScoredRollout(NamedTuple):
    """A recorded sequence as a network animates it."""

    sequence: GarmentSequence
    x: Float[np.ndarray, "frames vertices 3"]
    """Positions [m]; the first ones are those of the recorded frame :data:`~drape.data.recorded_scene.START`."""
    scores: dict[str, float]
    """``error_mm``, ``last_error_mm``, ``collision_percent`` (the paper's), ``inside_percent``, ``ms_per_frame``."""


def rollout_scores(
    network: nn.Module, cloths: Cloths, sequence: GarmentSequence, frames: int | None = None
) -> ScoredRollout:
    """The whole sequence, or so many frames of it, animated from two recorded frames; scores are means over frames.

    Raises:
        DrapeError: there are no recorded frames, or no body.
    """
    scene = recorded_scene(sequence, frames)
    recorded, body = scene.reference, scene.obstacle
    if recorded is None or body is None:
        raise DrapeError(f"sequences/{sequence.name}: found no recorded frames or no body; expected both, to compare")
    device = next(network.parameters()).device
    simulator = NeuralSimulator(network, cloths, scene, str(device))
    states, began = [scene.initial], time.perf_counter()
    for frame in range(scene.frames):
        states.append(simulator.step(states[-1], frame).state)
    seconds = time.perf_counter() - began
    x = np.stack([state.x for state in states])
    error = 1e3 * distance_by_frame(x, recorded[: len(x)])[1:]
    looked, penetration = range(EVERY, len(x), EVERY), Penetration(scene.mesh, body)
    inside = [penetration.inside(x[k], k) for k in looked]
    behind = [behind_nearest_vertex(x[k], body.at(k), body.faces).mean() for k in looked]
    scores = {
        "error_mm": float(error.mean()),
        "last_error_mm": float(error[-1]),
        "collision_percent": 100.0 * float(np.mean(behind)) if behind else 0.0,
        "inside_percent": 100.0 * float(np.mean(inside)) if inside else 0.0,
        "ms_per_frame": 1e3 * seconds / scene.frames,
    }
    return ScoredRollout(sequence, x, scores)
