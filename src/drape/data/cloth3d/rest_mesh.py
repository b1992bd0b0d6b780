"""The rest mesh of a garment of CLOTH3D: an OBJ, of quads or triangles, turned about z by the sequence's zrot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.geometry.mesh import ClothMesh
from drape.scene.mesh_file import read_triangles


def read_rest_mesh(path: Path, zrot: float) -> ClothMesh:
    """Rest positions [m] relative to the root joint, z up, turned by -``zrot`` so that they agree with the frames.

    Quads are cut into (0, 1, 2) and (0, 2, 3). Vertices keep the order of the file, which is that of the frames.

    Raises:
        DrapeError: no such file, no mesh, or a mesh that is no cloth; the sentence opens with the path.
    """
    positions, faces = read_triangles(path)
    return ClothMesh.from_faces(turn_about_z(positions, -zrot), faces, name=str(path))


def turn_about_z(positions: Float[np.ndarray, "... 3"], angle: float) -> Float[np.ndarray, "... 3"]:
    """Rotation about z by ``angle`` [rad], counter-clockwise seen from above."""
    c, s = np.cos(angle), np.sin(angle)
    return positions @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
