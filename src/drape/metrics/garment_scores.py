"""Scores of an animated garment, frame by frame: the columns of every evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.contact.penetration import Penetration
from drape.data.motion import edge_strain
from drape.errors import DrapeError
from drape.metrics.collision import behind_nearest_vertex
from drape.metrics.drift import energy_drift, momentum_drift
from drape.metrics.hem import hem_angle
from drape.metrics.position import distance_by_frame
from drape.metrics.self_intersection import self_intersecting
from drape.scene.scene import Scene

SCORES = {
    "error_mm": "Euclidean error: mean distance of a vertex to the recorded one",
    "floor_mm": "that of the perturbed twin of the recording, where there is one: the noise floor",
    "collision_percent": "vertices behind the nearest vertex of the body (the paper)",
    "inside_percent": "vertices inside the body",
    "deepest_mm": "how deep the deepest vertex is inside the body",
    "self_intersection_percent": "faces that pass through other faces",
    "stretch": "mean length of an edge over its rest length",
    "stretch_p99": "length of an edge over its rest length, 99th percentile",
    "hem_times": "angle between neighbouring edges of hems, root mean square, over the recorded one",
    "energy_drift_J_per_kg": "kinetic and gravitational energy against the recorded, absolute",
    "momentum_drift_m_per_s": "velocity of the centre of mass against the recorded, absolute",
}
"""Name, which ends in the unit, and meaning of the number that each frame has."""
EVERY = 8
"""Self-intersection is measured in every so many frames, and in the last one; it costs more than all else."""


@dataclass(frozen=True, eq=False)
class AnimatedGarment:
    """Frames 0, 1, ... of an animated garment and those recorded; frame 0, from which it started, is not scored."""

    x: Float[np.ndarray, "frames vertices 3"]
    """[m]"""
    scene: Scene
    """With its ``reference`` of at least as many frames."""
    twin: Float[np.ndarray, "recorded vertices 3"] | None = None
    """As ``reference``, of the perturbed twin of the recording [m]."""

    @property
    def reference(self) -> Float[np.ndarray, "frames vertices 3"]:
        """Recorded positions [m].

        Raises:
            DrapeError: there are none.
        """
        if self.scene.reference is None:
            raise DrapeError(f"scene {self.scene.name}: found no recorded frames; expected some to compare with")
        return self.scene.reference[: len(self.x)]


def frame_scores(garment: AnimatedGarment) -> dict[str, Float[np.ndarray, " frames"]]:
    """Each of :data:`SCORES` for frames 1, 2, ...; NaN where it is not measured: without a body, between ``EVERY``."""
    x, scene = garment.x, garment.scene
    stretch = 1.0 + edge_strain(x[1:], scene.mesh)
    faces = scene.mesh.faces
    measured = [k % EVERY == 0 or k == len(x) - 1 for k in range(1, len(x))]
    through = [self_intersecting(x[k], faces).mean() if yes else np.nan for k, yes in enumerate(measured, 1)]
    return {
        "error_mm": 1e3 * distance_by_frame(x, garment.reference)[1:],
        "floor_mm": _floor(garment),
        **_body_scores(garment),
        "self_intersection_percent": 100 * np.array(through),
        "stretch": stretch.mean(axis=1),
        "stretch_p99": np.percentile(stretch, 99, axis=1),
        "hem_times": hem_angle(x[1:], scene.mesh) / hem_angle(garment.reference[1:], scene.mesh),
        "energy_drift_J_per_kg": energy_drift(x, garment.reference, scene.dt, scene.gravity),
        "momentum_drift_m_per_s": momentum_drift(x, garment.reference, scene.dt),
    }


def sequence_scores(by_frame: Mapping[str, Float[np.ndarray, " frames"]]) -> dict[str, float]:
    """Means over the frames that have a number; NaN where none has."""
    return {name: float(np.mean(v[np.isfinite(v)])) if np.isfinite(v).any() else np.nan for name, v in by_frame.items()}


def _floor(garment: AnimatedGarment) -> Float[np.ndarray, " frames"]:
    if garment.twin is None:
        return np.full(len(garment.x) - 1, np.nan)
    return 1e3 * distance_by_frame(garment.twin[: len(garment.x)], garment.reference)[1:]


def _body_scores(garment: AnimatedGarment) -> dict[str, Float[np.ndarray, " frames"]]:
    frames, obstacle = range(1, len(garment.x)), garment.scene.obstacle
    if obstacle is None:
        return dict.fromkeys(("collision_percent", "inside_percent", "deepest_mm"), np.full(len(frames), np.nan))
    penetration = Penetration(garment.scene.mesh, obstacle)
    depth = np.stack([penetration.depth(garment.x[k], k) for k in frames])
    behind = [behind_nearest_vertex(garment.x[k], obstacle.at(k), obstacle.faces).mean() for k in frames]
    return {
        "collision_percent": 100 * np.array(behind),
        "inside_percent": 100 * (depth > 0) @ penetration.share,
        "deepest_mm": 1e3 * depth.max(axis=1),
    }
