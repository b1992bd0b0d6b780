"""Quality control of a simulated garment: what is measured, and when a sequence is not stored. Does not import bpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import gpytoolbox
import numpy as np
from jaxtyping import Bool, Float, Int

from drape.data.motion import speeds
from drape.geometry.mesh import ClothMesh

CROSSING_EVERY = 4
"""Self-intersection is looked for in every such frame: it lasts, and looking takes long."""
PERCENTILE = 99.0
MEASURES = (
    "inside_mean",
    "inside_worst",
    "depth",
    "self_intersection_mean",
    "self_intersection_worst",
    "stretch_mean",
    "stretch_99",
    "speed",
)
"""Names of the numbers of :func:`measure_quality`."""
Crossing = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""``drape.blender.crossing_faces.crossing_faces``: which faces of (positions, faces) pass through others."""


def measure_quality(
    positions: Float[np.ndarray, "frames vertices 3"],
    mesh: ClothMesh,
    body_positions: Float[np.ndarray, "frames body_vertices 3"],
    body_faces: Int[np.ndarray, "body_faces 3"],
    dt: float,
    crossing: Crossing,
) -> dict[str, float]:
    """The numbers of quality control; all NaN if a position is not finite.

    * ``inside_mean``, ``inside_worst``: fraction of the vertices that is inside the body, over all frames and in the
      worst one; ``depth``: greatest distance from the surface of one that is [m];
    * ``self_intersection_mean``, ``self_intersection_worst``: fraction of the faces that pass through others;
    * ``stretch_mean``, ``stretch_99``: edge length over rest length, mean and 99th percentile;
    * ``speed``: greatest speed of a vertex [m/s].
    """
    x = np.asarray(positions, np.float64)
    if not np.isfinite(x).all():
        return dict.fromkeys(MEASURES, float("nan"))
    inside, depth = np.zeros(len(x)), 0.0
    for frame, body in enumerate(np.asarray(body_positions, np.float64)):
        within = inside_body(x[frame], body, body_faces)
        inside[frame] = within.mean()
        if within.any():
            squared = gpytoolbox.squared_distance(x[frame][within], body, F=body_faces, use_cpp=True)[0]
            depth = max(depth, float(np.sqrt(squared.max())))
    crossed = [crossing(frame, mesh.faces).mean() for frame in x[::CROSSING_EVERY]]
    stretch = np.linalg.norm(x[:, mesh.edges[:, 1]] - x[:, mesh.edges[:, 0]], axis=-1) / mesh.rest_lengths
    found = {
        "inside_mean": inside.mean(),
        "inside_worst": inside.max(),
        "depth": depth,
        "self_intersection_mean": np.mean(crossed),
        "self_intersection_worst": np.max(crossed),
        "stretch_mean": stretch.mean(),
        "stretch_99": np.percentile(stretch, PERCENTILE),
        "speed": speeds(x, dt).max(),
    }
    return {name: float(found[name]) for name in MEASURES}


def reason_to_refuse(quality: Mapping[str, float], bounds: Mapping[str, float]) -> str:
    """Reason for which a sequence of this quality is not stored, or ''; ``bounds`` is ``data.reject``.

    That the rest shape is fit for simulation is checked where it is made (garment.quality).
    """
    if not np.isfinite([quality[measure] for measure in MEASURES]).all():
        return "a position that is not finite"
    rules = {
        "inside": ("inside_worst", "of the vertices inside the body"),
        "self_intersection": ("self_intersection_mean", "of the faces through others"),
        "stretch": ("stretch_99", "times its rest length in 1 % of the edges"),
        "speed": ("speed", "m/s"),
    }
    for bound, (measure, words) in rules.items():
        if quality[measure] > bounds[bound]:
            return f"{measure} {quality[measure]:.4g} {words} (bound {bounds[bound]:g})"
    return ""


def inside_body(
    points: Float[np.ndarray, "points 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    body_faces: Int[np.ndarray, "body_faces 3"],
) -> Bool[np.ndarray, " points"]:
    """Whether each point is inside a closed surface: its winding number is above one half.

    Right also where the surface passes through itself, as the skin of an armpit does [Barill et al. 2018].
    """
    return gpytoolbox.fast_winding_number(points, body, body_faces) > 0.5
