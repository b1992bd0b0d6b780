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
from drape.energy.terms.ipc import Barrier
from drape.errors import DrapeError
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome, Simulator, StepResult, barrier_of

COLUMNS = {"iterations": "1", "residual": "N", "steps": "1", "outcome": "1", "seconds": "s", "inside": "1"}
"""Stored with each frame; ``outcome``: its place among the :class:`Outcome`, 0 is converged; ``inside``: share of the
surface inside the body."""
CLEARANCE = 2e-3
"""Distance from the body to which the first frame is moved where it is inside [m]."""
DEEPEST = 0.1
"""Share of the body's largest extent by which cloth may be inside it at the start; deeper is a mistake of the files."""


def first_frame(scene: Scene, barrier: Barrier | None = None) -> State:
    """The initial state, with vertices that are inside the body moved out of it and stopped; pinned ones stay.

    With a ``barrier``, which keeps apart only what is apart, cloth that crosses is then untangled as far as possible,
    and stopped as well.

    Raises:
        DrapeError: vertices so deep in the body that this would be a jump.
    """
    initial, body = scene.initial, scene.obstacle
    held = np.zeros(len(initial.x), bool)
    held[[] if scene.pins is None else scene.pins.vertices] = True
    x = initial.x if body is None else _out_of(body, initial.x, held, scene.name)
    if barrier is not None:
        x, _ = untangle(barrier.collisions, x, None if body is None else body.at(0), held=held)
    moved = (x != initial.x).any(axis=1, keepdims=True)
    return State(x, np.where(moved, 0.0, initial.v))


def _out_of(body: Obstacle, x: np.ndarray, held: np.ndarray, name: str) -> np.ndarray:
    out = np.where(held[:, None], x, push_out(x, body, CLEARANCE))
    depth = np.linalg.norm(out - x, axis=1)
    deepest = DEEPEST * float(np.ptp(body.at(0), axis=0).max())
    if depth.max() - CLEARANCE > deepest:
        raise DrapeError(
            f"scene {name}: found {int((depth > 0).sum())} vertices inside the body at the start, vertex "
            f"{depth.argmax()} by {depth.max() - CLEARANCE:.3g} m; expected at most {deepest:.3g} m, a tenth of the "
            "body's size; move the garment out of the body, or give its place on it as scene.start"
        )
    return out


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
