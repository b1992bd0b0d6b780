"""A cloth in its rest state from any file of meshes that can be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.reading.files import read_file
from drape.reading.mesh_record import MeshFile, ReadMesh
from drape.reading.polygons import triangulated
from drape.reading.triangles import made, to_metres
from drape.scene.proportions import check_cloth_size
from drape.stored import reading


def read_triangles(path: Path | str) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """Positions (in the file's unit and axes) and faces, polygons cut into triangles, nothing else changed.

    Raises:
        DrapeError: see :func:`drape.reading.files.read_file`; no triangle.
    """
    source = read_file(path)
    corners, _ = triangulated(source.polygons, source.positions[0])
    if not len(corners):
        raise DrapeError(f"{path}: found no triangle; expected a mesh with faces; export faces, not points")
    return source.positions[0], source.polygons.corners[corners]


def read_cloth(
    path: Path | str,
    scale: float | None = None,
    up_axis: str | None = None,
    weld: float | None = None,
    wanted: str | None = None,
) -> tuple[ClothMesh, ReadMesh]:
    """A cloth in its rest state, and what was read and changed for it; see :func:`drape.reading.triangles.made`.

    ``wanted``: which object of the file it is, if there are several. A garment of several parts that touch nowhere is
    allowed: each moves on its own.

    Raises:
        DrapeError: see :func:`drape.reading.files.read_file`, :func:`drape.reading.triangles.made`,
            :meth:`ClothMesh.from_faces` and :func:`check_cloth_size`; the sentence opens with the path.
    """
    with reading(path, "export it again"):
        read = made(read_file(path, wanted=wanted), scale, up_axis, weld)
    check_cloth_size(read.positions[0], str(path), asked=scale is not None)
    return ClothMesh.from_faces(read.positions[0], read.faces, name=str(path)), read


def read_pose(path: Path | str, read: ReadMesh, wanted: str | None = None) -> Float[np.ndarray, "vertices 3"]:
    """Positions [m] of a cloth that was read, from a file with the same mesh, its object ``wanted``, in another pose.

    Raises:
        DrapeError: another mesh.
    """
    posed = read_file(path, wanted=wanted)
    if posed.positions.shape[1:] != read.source.positions.shape[1:] or not posed.polygons.same_as(read.source.polygons):
        raise DrapeError(
            f"{path}: found {_told(posed)} that are not those of {read.source.path} ({_told(read.source)}); expected "
            "the same mesh in another pose; export both with the vertices in the same order"
        )
    metres = to_metres(posed.positions[0], read.form.scale, read.form.up)
    if not np.isfinite(metres).all():
        raise DrapeError(f"{path}: found positions that are not finite; export it again")
    return metres[read.in_order]


def _told(mesh: MeshFile) -> str:
    return f"{mesh.positions.shape[1]} vertices and {len(mesh.polygons.sizes)} faces"
