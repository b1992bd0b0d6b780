"""Near-uniform triangles on a cut surface: even boundary loops, then isotropic remeshing of the inside."""

from __future__ import annotations

import numpy as np
from gpytoolbox import remesh_botsch
from jaxtyping import Float, Int

from drape.garment.boundary import resample_boundary
from drape.garment.clip import compact
from drape.garment.polish import polish

ITERATIONS = 6
"""Rounds of splitting, collapsing, flipping and relaxing [Botsch 2004]."""


def remesh(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], edge: float
) -> tuple[Float[np.ndarray, "new 3"], Int[np.ndarray, "triangles 3"]]:
    """The same surface with edges of about ``edge`` [m]; boundary vertices stay on their loops."""
    vertices, faces = resample_boundary(vertices, faces, edge)
    vertices, triangles = remesh_botsch(vertices, faces.astype(np.int32), ITERATIONS, edge, True)
    return polish(*compact(vertices, triangles.astype(np.int64)))
