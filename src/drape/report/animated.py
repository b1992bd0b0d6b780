"""Messages of ``animate.py``: the energies that a scene requires, and how an animation went."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drape.contact.crossings import Crossings
from drape.contact.penetration import distances
from drape.data.animation_hdf5 import AnimationFile
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.step import Step
from drape.energy.terms.ipc import Barrier
from drape.metrics.position import distance_travelled, vertex_distance
from drape.report.table import Table
from drape.scene.scene import Scene
from drape.simulators.rollout import first_frame
from drape.simulators.simulator import Outcome
from drape.simulators.solver.balance import HANGING, mean_weight
from drape.simulators.solver.term_costs import search_seconds, term_costs


def explained(potential: IncrementalPotential, step: Step) -> Table:
    """The terms: why each is there, and what it costs at each evaluation and at each factorisation."""
    search = search_seconds(step)
    rows = tuple(
        (cost.name, cost.reason, f"{1e3 * cost.seconds:.2f}", f"{1e3 * cost.hessian_seconds:.2f}")
        for cost in term_costs(potential, step)
    )
    nearest = "no body: nearest faces are not searched"
    if search is not None:
        nearest = f"nearest faces of the body: {1e3 * search:.1f} ms a step"
    return Table("Energies of this scene", ("energy", "because", "energy and forces, ms", "Hessian, ms"), rows, nearest)


def animated(path: Path, scene: Scene, made: Sequence[Path], barrier: Barrier | None = None) -> str:
    """Lines on all frames of the file, on those that did not converge and their remedy, and on where everything is.

    ``barrier``: what lets nothing cross in them, where there is one; it is then checked that nothing does.
    """
    with AnimationFile(path) as file:
        numbers = {name: values[1:] for name, values in file.numbers().items()}
        count, vertices = file.num_frames - 1, scene.mesh.num_vertices
        rate = f"{1 / scene.dt:.4g} per second"
        lines = [f"{scene.name}: {count} frames of {vertices} vertices, {scene.material.name}, at {rate}", *scene.said]
        lines += _at_the_start(scene)
        if barrier is None:
            lines += _moved_out(file.x(0), scene.initial.x)
        else:
            out = first_frame(scene).x
            lines += _moved_out(out, scene.initial.x) + untangled(out, file.x(0), scene, barrier)
            lines.append(crossed(file, scene, barrier))
        if scene.reference is not None:
            lines.append(_beside(file, scene.reference))
    missed = numbers["residual"] / mean_weight(scene)
    lines.append(
        f"{1e3 * np.median(numbers['seconds']):.0f} ms/frame (median), {np.median(numbers['iterations']):.0f} "
        f"evaluations, mean unbalanced force {_mean(missed):.2g} times the weight of a vertex"
    )
    if scene.obstacle is not None:
        inside = 100 * numbers["inside"]
        lines.append(f"inside the body: mean {np.mean(inside):.3f} %, at most {np.max(inside):.2f} % of the vertices")
    lines += _not_converged([list(Outcome)[int(place)] for place in numbers["outcome"]], missed)
    return "\n".join([*lines, *(os.path.relpath(file) for file in made)])


def _at_the_start(scene: Scene) -> list[str]:
    """Lines on the distance of garment and body of files, and on pinned vertices inside the body."""
    if scene.obstacle is None or not scene.said:
        return []
    apart = distances(scene.initial.x, scene.obstacle, 0)
    lines = [] if (apart < 0).any() else [f"garment and body are {1e3 * apart.min():.1f} mm apart at their nearest"]
    pinned = apart[[] if scene.pins is None else scene.pins.vertices]
    if (pinned < 0).any():
        lines.append(
            f"{int((pinned < 0).sum())} pinned vertices start inside the body, by up to {-1e3 * pinned.min():.1f} mm, "
            "and stay there"
        )
    return lines


def _moved_out(first: Float[np.ndarray, "vertices 3"], initial: Float[np.ndarray, "vertices 3"]) -> list[str]:
    """Line on what :func:`drape.simulators.rollout.first_frame` did to the initial state."""
    moved = 1e3 * np.linalg.norm(first - initial, axis=1)
    moved = moved[moved > 0]
    if not len(moved):
        return []
    one = f"{len(moved)} vertices were" if len(moved) > 1 else "1 vertex was"
    return [
        f"{one} inside the body at the start, and moved out of it: by {moved.mean():.1f} mm on average, at most "
        f"{moved.max():.1f} mm"
    ]


def _not_converged(outcomes: Sequence[Outcome], missed: Float[np.ndarray, " frames"]) -> list[str]:
    """Lines on frames that did not converge and their remedy; which of them hang in the air, or that all are usable.

    ``missed``: mean unbalanced force of each frame, in weights of a vertex; NaN is neither.
    """
    lines, ended = [], np.array([outcome.name for outcome in outcomes])
    for outcome in Outcome:
        if outcome is not Outcome.CONVERGED and (ended == outcome.name).any():
            where = np.flatnonzero(ended == outcome.name)
            lines.append(f"{len(where)} of {len(ended)} frames ({spans(where + 1)}) {outcome.value}")
    hanging, converged = missed > HANGING, ended == Outcome.CONVERGED.name
    short = np.isin(ended, [Outcome.ITERATIONS.name, Outcome.PRECISION.name])
    if hanging.any():
        remedy = "simulator.tolerance is too large" if converged[hanging].all() else "raise simulator.iterations"
        where = np.flatnonzero(hanging)
        lines.append(
            f"{len(where)} of {len(ended)} frames ({spans(where + 1)}) leave cloth unbalanced by up to "
            f"{missed[where].max():.2g} times its weight: it hangs in the air, or moves as nothing moves it; {remedy}"
        )
    elif short.any() and np.isfinite(missed[short]).all():
        lines.append(f"these frames are usable: forces balance to within {missed[short].max():.2g} weights of a vertex")
    return lines


def _mean(values: Float[np.ndarray, " frames"]) -> float:
    """Of those that are finite; NaN where none is."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan


def _beside(file: AnimationFile, reference: np.ndarray) -> str:
    """Mean distance to the recorded frames, and how far these moved."""
    error = np.mean([vertex_distance(file.x(k), reference[k]) for k in range(1, file.num_frames)])
    travelled = distance_travelled(reference[: file.num_frames])
    return (
        f"mean distance to the recorded frames {1e3 * error:.1f} mm, {100 * error / travelled:.1f} % of the "
        f"{1e3 * travelled:.0f} mm that the cloth travelled on average"
    )


def untangled(
    tangled: Float[np.ndarray, "vertices 3"], first: Float[np.ndarray, "vertices 3"], scene: Scene, barrier: Barrier
) -> list[str]:
    """Line on crossings of ``tangled`` that :func:`drape.simulators.rollout.first_frame` undid; nothing without any."""
    before, after = (_crossings(x, 0, scene, barrier) for x in (tangled, first))
    count, left = len(before.pairs), len(after.pairs)
    if not count:
        return []
    place = ", ".join(f"{value:.3g}" for value in before.places[0])
    pairs = f"{count} pairs of faces cross" if count > 1 else "1 pair of faces crosses"
    moved = 1e3 * np.linalg.norm(first - tangled, axis=1).max()
    done = f"{max(count - left, 0)} untangled, the cloth moved by at most {moved:.2g} mm"
    stays = "" if not left else f"; {left} remain, and stay" if left > 1 else "; 1 remains, and stays"
    return [f"{pairs} at the start, the first near ({place}); {done}{stays}"]


def crossed(file: AnimationFile, scene: Scene, barrier: Barrier) -> str:
    """Number of frames that end with crossing faces: a check of what the barrier promises."""
    count = file.num_frames - 1
    ends = [len(_crossings(file.x(frame), frame, scene, barrier).pairs) for frame in range(1, count + 1)]
    if not any(ends):
        return f"no faces cross at the end of any of the {count} frames"
    where = np.flatnonzero(ends) + 1
    return (
        f"{len(where)} of {count} frames ({spans(where)}) end with crossing faces, at most {max(ends)} pairs; "
        "contact=ipc keeps apart what starts apart: look at the start, and at pins and bodies that meet each other"
    )


def _crossings(x: Float[np.ndarray, "vertices 3"], frame: int, scene: Scene, barrier: Barrier) -> Crossings:
    return barrier.collisions.crossings(x, None if scene.obstacle is None else scene.obstacle.at(frame))


def spans(frames: Int[np.ndarray, " frames"]) -> str:
    """Sorted numbers in words: ``12-18, 40``."""
    parts = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
    return ", ".join(f"{part[0]}-{part[-1]}" if len(part) > 1 else f"{part[0]}" for part in parts)
