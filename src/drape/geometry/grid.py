"""The square piece of cloth, and longer ones: a regular grid cut into triangles."""

from __future__ import annotations

import numpy as np

from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh

PATTERNS = ("uniform", "alternating")


def square_grid(size: float, resolution: int, pattern: str = "uniform") -> ClothMesh:
    """A flat square of side ``size`` [m] in the xy plane, centred on the origin, with ``resolution``² vertices.

    Vertex ``i * resolution + j`` lies in row ``i`` (row 0 is the top, largest y) and column ``j`` (x grows with j), so
    the top corners are vertices 0 and ``resolution - 1``. Faces wind anticlockwise seen from +z. ``pattern``:
    ``uniform`` cuts all quads along the same diagonal, ``alternating`` flips the diagonal like a chess board.
    22 x 22 uniform: 484 vertices, 882 faces, 1365 edges (docs/sources.md, The piece of cloth).

    Raises:
        DrapeError: a size that is not positive, fewer than 2 vertices a side, an unknown pattern.
    """
    if not size > 0 or resolution < 2 or pattern not in PATTERNS:
        raise DrapeError(
            f"square cloth: size {size}, resolution {resolution}, pattern {pattern!r}; "
            f"expected size > 0, resolution >= 2 and a pattern among {', '.join(PATTERNS)}"
        )
    return rectangular_grid((size, size), (resolution, resolution), pattern)


def rectangular_grid(size: tuple[float, float], resolution: tuple[int, int], pattern: str = "uniform") -> ClothMesh:
    """As :func:`square_grid`, with sides ``size`` [m] and numbers of vertices ``resolution`` along x and y.

    Raises:
        DrapeError: a side that is not positive, fewer than 2 vertices along one, an unknown pattern.
    """
    if not all(side > 0 for side in size) or min(resolution) < 2 or pattern not in PATTERNS:
        raise DrapeError(
            f"rectangular cloth: size {tuple(size)}, resolution {tuple(resolution)}, pattern {pattern!r}; "
            f"expected sizes > 0, resolutions >= 2 and a pattern among {', '.join(PATTERNS)}"
        )
    x, y = (np.linspace(-side / 2, side / 2, count) for side, count in zip(size, resolution, strict=True))
    rows, columns = np.meshgrid(np.arange(resolution[1]), np.arange(resolution[0]), indexing="ij")
    positions = np.stack([x[columns], -y[rows], np.zeros(rows.shape)], axis=-1).reshape(-1, 3)
    corner = (rows * resolution[0] + columns)[:-1, :-1].reshape(-1)
    a, b, c, d = corner, corner + resolution[0], corner + resolution[0] + 1, corner + 1
    flipped = ((rows + columns)[:-1, :-1].reshape(-1) % 2 == 1) & (pattern == "alternating")
    first = np.where(flipped[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    second = np.where(flipped[:, None], np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    faces = np.stack([first, second], axis=1).reshape(-1, 3)
    return ClothMesh.from_faces(positions.astype(np.float32), faces, name="rectangular cloth")
