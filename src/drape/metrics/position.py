"""Vertex distance between two animations of the same cloth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Positions = Float[np.ndarray, "*frames vertices 3"]


def vertex_distance(x: Positions, reference: Positions) -> float:
    """Mean distance of a vertex to where it is in ``reference`` [m]."""
    return float(np.linalg.norm(np.asarray(x) - reference, axis=-1).mean())


def distance_by_frame(
    x: Float[np.ndarray, "frames vertices 3"], reference: Float[np.ndarray, "frames vertices 3"]
) -> Float[np.ndarray, " frames"]:
    """Mean distance of a vertex to where it is in ``reference`` [m], in each frame: the paper's Euclidean error."""
    return np.linalg.norm(x - reference, axis=-1).mean(axis=-1)


def distance_travelled(x: Float[np.ndarray, "frames vertices 3"]) -> float:
    """Mean distance of a vertex in frames 1, 2, ... to where it was in frame 0 [m]: what an error compares with."""
    return vertex_distance(x[1:], np.broadcast_to(x[0], x[1:].shape))
