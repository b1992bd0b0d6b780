"""Crossing faces in words: at the start, with what was done about them, and in the frames, where none should be."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.contact.crossings import Crossings
from drape.data.animation_hdf5 import AnimationFile
from drape.energy.terms.ipc import Barrier
from drape.report.frame_numbers import spans
from drape.scene.scene import Scene


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
