"""Whether sizes make sense in metres: meshes come in all units, and no file says which."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError

SMALLEST, LARGEST = 0.01, 100.0
"""Diagonal of the bounding box of a cloth [m]."""
RATIO = 10.0
"""Largest ratio of the sizes of a garment and the body that wears it."""


def size(positions: Float[np.ndarray, "... 3"]) -> float:
    """Diagonal of the bounding box."""
    points = positions.reshape(-1, 3)
    return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))


def check_cloth_size(positions: Float[np.ndarray, "vertices 3"], where: str) -> None:
    """Refuse a cloth of a file whose unit cannot be the metre.

    Raises:
        DrapeError: smaller than 1 cm or larger than 100 m.
    """
    found = size(positions)
    if not SMALLEST <= found <= LARGEST:
        raise DrapeError(
            f"{where}: found a cloth of {found:.3g} m; expected {SMALLEST} to {LARGEST:.0f} m; the file seems to have "
            "another unit: set scene.scale (0.001 for millimetres, 0.01 for centimetres)"
        )


def check_winding(
    faces: Int[np.ndarray, "faces 3"], positions: Float[np.ndarray, "body_vertices 3"], where: str
) -> None:
    """Refuse a closed body that is inside out: its contact would pull the cloth in.

    The volume is ``Σ_faces x0 · (x1 x x2) / 6``. Nothing is known of a body with holes.

    Raises:
        DrapeError: every edge has a face on both sides, and the volume is negative.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    closed = np.array_equal(np.unique(edges, axis=0), np.unique(edges[:, ::-1], axis=0))
    corners = positions[faces] - positions.mean(axis=0)
    volume = float(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0
    if closed and volume < 0.0:
        raise DrapeError(
            f"{where}: found a closed body whose faces wind inwards (volume {volume:.3g} m³); expected outwards, "
            "anticlockwise seen from outside; flip its normals and export it again"
        )


def check_garment_and_body(
    garment: Float[np.ndarray, "vertices 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    garment_where: str,
    body_where: str,
) -> None:
    """Refuse a garment and a body that cannot belong together.

    Raises:
        DrapeError: sizes that differ by more than a factor of 10, or bounding boxes further apart than the body's size.
    """
    garment_size, body_size = size(garment), size(body)
    if max(garment_size, body_size) > RATIO * min(garment_size, body_size):
        raise DrapeError(
            f"{garment_where} and {body_where}: found sizes of {garment_size:.3g} m and {body_size:.3g} m; expected "
            f"them within a factor of {RATIO:.0f}; they seem to have different units: set scene.scale (cloth) or "
            "scene.body_scale"
        )
    gap = np.maximum(garment.min(axis=0) - body.max(axis=0), body.min(axis=0) - garment.max(axis=0))
    distance = float(np.linalg.norm(np.maximum(gap, 0.0)))
    if distance > body_size:
        raise DrapeError(
            f"{garment_where} and {body_where}: found the cloth {distance:.3g} m away from a body of "
            f"{body_size:.3g} m; expected it on the body or near it; move one of them, or set scene.up_axis if their "
            "axes differ"
        )
