"""Frame after frame: a scene turned into a stored animation that can be interrupted at any time."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from drape.contact.penetration import Penetration, push_out
from drape.contact.untangle import untangle
from drape.data.animation_writer import AnimationWriter
from drape.energy.ipc import Barrier
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome, Simulator, StepResult, barrier_of

COLUMNS = {"iterations": "1", "residual": "N", "steps": "1", "outcome": "1", "seconds": "s", "inside": "1"}
"""Stored with each frame; ``outcome``: its place among the :class:`Outcome`, 0 is converged; ``inside``: share of the
surface inside the body."""
CLEARANCE = 2e-3
"""Distance from the body to which the first frame is moved where it is inside [m]."""


def first_frame(scene: Scene, barrier: Barrier | None = None) -> State:
    """The initial state, with vertices that are inside the body moved out of it and stopped.

    With a ``barrier``, which keeps apart only what is apart, cloth that crosses is then untangled as far as possible,
    and stopped as well; pinned vertices stay.
    """
    initial, body = scene.initial, scene.obstacle
    x = initial.x if body is None else push_out(initial.x, body, CLEARANCE)
    if barrier is not None:
        held = np.zeros(len(x), bool)
        held[[] if scene.pins is None else scene.pins.vertices] = True
        x, _ = untangle(barrier.collisions, x, None if body is None else body.at(0), held=held)
    moved = (x != initial.x).any(axis=1, keepdims=True)
    return State(x, np.where(moved, 0.0, initial.v))


def roll_out(simulator: Simulator, scene: Scene, writer: AnimationWriter) -> None:
    """Simulate the frames that ``writer`` does not have yet, with a progress bar; each is stored as it is done."""
    seconds, done = [], max(writer.num_frames - 1, 0)
    with tqdm(total=scene.frames, initial=done, desc=f"animating {scene.name}", unit=" frames", file=sys.stderr) as bar:
        for took in frames(simulator, scene, writer):
            seconds.append(took)
            bar.set_postfix_str(f"{1e3 * np.median(seconds):.0f} ms/frame")
            bar.update()


def frames(simulator: Simulator, scene: Scene, writer: AnimationWriter) -> Iterator[float]:
    """Simulate the frames that ``writer`` does not have yet; each is stored, then said how long it took [s]."""
    if writer.num_frames == 0:
        writer.append(first_frame(scene, barrier_of(simulator)))
    done = writer.num_frames - 1
    state = writer.state(done)
    penetration = None if scene.obstacle is None else Penetration(scene.mesh, scene.obstacle)
    for frame in range(done, scene.frames):
        began = time.perf_counter()
        result = simulator.step(state, frame)
        seconds = time.perf_counter() - began
        state = result.state
        writer.append(state, _numbers(result, seconds, penetration, frame + 1))
        yield seconds


def _numbers(result: StepResult, seconds: float, penetration: Penetration | None, frame: int) -> dict[str, float]:
    numbers = {
        "iterations": float(result.iterations),
        "residual": result.residual,
        "steps": float(result.steps),
        "outcome": float(list(Outcome).index(result.outcome)),
        "seconds": seconds,
    }
    if penetration is not None:
        numbers["inside"] = penetration.inside(result.state.x, frame)
    return numbers
