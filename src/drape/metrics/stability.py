"""Stability checks of an undriven cloth: finite frames, outcomes of steps, no gain of energy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from drape.data.animation_hdf5 import AnimationFile
from drape.energy.fabric import Fabric
from drape.energy.scene_step import SceneSteps
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome

WEIGHT = 9.81
"""Residuals are measured against mass times this [m/s²]."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Findings on an animation of an undriven cloth."""

    outcomes: Counter[Outcome]
    """Of its frames."""
    residual: float
    """The largest mean unbalanced force per vertex, as a share of the mean weight of a vertex."""
    gain: float
    """The largest rise of the mechanical energy above what it was before, over all frames, as a share of the largest
    kinetic and stored energy: 0 where it only falls."""
    drift: float | None
    """The largest change of the momentum, as a share of the largest ``Σ m |v|``; None under gravity or with pins."""
    seconds: float
    """Of all frames."""
    x: Float[np.ndarray, "vertices 3"]
    """Positions at the end [m]."""
    side: float
    """Largest extent of the cloth at rest [m]."""

    @property
    def is_finite(self) -> bool:
        """All these numbers are; frames that are not cannot be stored at all."""
        return bool(np.isfinite([self.gain, self.drift or 0.0, self.residual]).all() and np.isfinite(self.x).all())


def stability(file: AnimationFile, scene: Scene, fabric: Fabric) -> Stability:
    """Of an animation of ``scene`` with ``fabric``, evaluated in float64 whatever the solver worked in.

    Raises:
        DrapeError: a scene in which pins or a body do work, or with frames missing.
    """
    if scene.obstacle is not None or (scene.pins is not None and not scene.pins.is_static):
        raise DrapeError(f"scene {scene.name}: found a body or moving pins; expected a scene where nobody does work")
    if not file.is_complete:
        raise DrapeError(f"{file.path}: found {file.num_frames} of {file.header.frames} frames; animate the others")
    numbers, states = file.numbers(), [file.state(frame) for frame in range(file.num_frames)]
    moving, stored, potential = np.array(list(energies(scene, fabric, states))).T
    return Stability(
        outcomes=Counter(list(Outcome)[int(place)] for place in numbers["outcome"][1:]),
        residual=float(numbers["residual"][1:].max() / (WEIGHT * scene.mass.mean())),
        gain=gain(moving + stored + potential, float(np.abs(moving + stored).max())),
        drift=None if scene.pins is not None or scene.gravity.any() else _drift(scene, states),
        seconds=float(numbers["seconds"][1:].sum()),
        x=states[-1].x,
        side=float(np.ptp(scene.mesh.rest_positions, axis=0).max()),
    )


def energies(scene: Scene, fabric: Fabric, states: Iterable[State]) -> Iterable[tuple[float, float, float]]:
    """Kinetic energy, energy stored in the cloth, and that in gravity and constant forces, of each state [J]."""
    terms = [term.double() for term in fabric.terms if term.stores]
    steps, force = SceneSteps(scene, fabric.attributes), scene.mass[:, None] * scene.gravity
    if scene.external_force is not None:
        force = force + scene.external_force
    with torch.no_grad():
        for state in states:
            step = steps.step(state, 0.0, 1.0)
            stored = sum(float(term(step.x, step).sum()) for term in terms)
            kinetic = 0.5 * float((scene.mass[:, None] * state.v**2).sum())
            yield kinetic, stored, -float((force * (state.x - scene.initial.x)).sum())


def gain(energy: Float[np.ndarray, " frames"], scale: float) -> float:
    """The largest rise above any earlier value, as a share of ``scale``."""
    risen = float((energy - np.minimum.accumulate(energy)).max())
    return risen / scale if risen > 0 else 0.0


def _drift(scene: Scene, states: Sequence[State]) -> float:
    momenta = np.array([(scene.mass[:, None] * state.v).sum(axis=0) for state in states])
    largest = max(float((scene.mass * np.linalg.norm(state.v, axis=1)).sum()) for state in states)
    change = float(np.linalg.norm(momenta - momenta[0], axis=1).max())
    return change / largest if change > 0 else 0.0
