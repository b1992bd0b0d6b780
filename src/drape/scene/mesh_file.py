"""Triangle meshes from the files that people have: OBJ, PLY, STL, GLB (read by trimesh)."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.scene.mesh import ClothMesh
from drape.scene.proportions import check_cloth_size

KINDS = (".obj", ".ply", ".stl", ".glb")
WITHOUT_SHARED_VERTICES = (".stl", ".glb")
"""STL repeats a vertex for every face, GLB for every normal and texture coordinate: copies are merged."""


def read_triangles(path: Path | str) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """Positions (in the file's unit and axes) and faces; polygons are cut into triangles, all objects are joined.

    Vertices keep the order of the file; copies of a vertex in STL and GLB become one, at the place of the first. GLB
    has +y up by definition and is turned so that +z is up; the other formats do not say, and are taken as they are.

    Raises:
        DrapeError: no such file, another kind of file, nothing that can be read, no triangle.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise DrapeError(f"{path}: found a file of kind {kind or 'nothing'!r}; expected one of {', '.join(KINDS)}")
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; give the path of a mesh ({', '.join(KINDS)})")
    try:
        content = path.read_bytes()
        content = _without_texture(content) if kind == ".obj" else content
        loaded = trimesh.load_scene(io.BytesIO(content), file_type=kind[1:], process=False, maintain_order=True)
        mesh = loaded.to_mesh()
    except Exception as error:  # a parser may fail in any way
        raise DrapeError(
            f"{path}: cannot be read as {kind[1:].upper()} ({type(error).__name__}: {error}); export the mesh again"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise DrapeError(f"{path}: found no triangle; expected a triangle mesh; export faces, not points or curves")
    positions, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
    if kind == ".glb":
        positions = y_up_to_z_up(positions)
    return merge_copies(positions, faces) if kind in WITHOUT_SHARED_VERTICES else (positions, faces)


def read_cloth(path: Path | str, scale: float = 1.0, up_axis: str = "z") -> ClothMesh:
    """A cloth in its rest state [m]: the positions of the file times ``scale``, turned if ``up_axis`` is ``y``.

    A garment of several parts that touch nowhere is allowed: each moves on its own.

    Raises:
        DrapeError: see :func:`read_triangles`, :meth:`ClothMesh.from_faces` and :func:`check_cloth_size`; the sentence
            opens with the path.
    """
    positions, faces = read_triangles(path)
    mesh = ClothMesh.from_faces(to_metres(positions, path, scale, up_axis), faces, name=str(path))
    check_cloth_size(mesh.rest_positions, str(path))
    return mesh


def to_metres(positions: np.ndarray, path: Path | str, scale: float, up_axis: str) -> Float[np.ndarray, "... 3"]:
    """Positions of a file times ``scale``, with +z up.

    ``up_axis`` says what is up in a file that does not say so itself; GLB does.

    Raises:
        DrapeError: a scale that is not positive, an unknown axis.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise DrapeError(f"{path}: scale: found {scale}; expected metres per unit of the file, as 0.01 for centimetres")
    if up_axis not in ("y", "z"):
        raise DrapeError(f"{path}: up_axis: found {up_axis!r}; expected y or z")
    turned = up_axis == "y" and Path(path).suffix.lower() != ".glb"
    return scale * (y_up_to_z_up(positions) if turned else positions)


def y_up_to_z_up(positions: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """(x, y, z) to (x, -z, y): a quarter turn about x."""
    return np.stack([positions[..., 0], -positions[..., 2], positions[..., 1]], axis=-1)


def merge_copies(
    positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "merged 3"], Int[np.ndarray, "faces 3"]]:
    """Vertices at exactly the same place become one, in the order of first appearance."""
    _, first, group = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positions[first[order]], rank[group.reshape(-1)][faces]


def _without_texture(content: bytes) -> bytes:
    """An OBJ's vertices and faces only: trimesh would cut the mesh along texture seams, which would tear the cloth."""
    lines, count = [], 0
    for line in content.decode("utf-8", errors="replace").replace("\\\n", " ").splitlines():
        words = line.partition("#")[0].split()
        if words[:1] == ["v"]:
            count += 1
            lines.append("v " + " ".join(words[1:4]))
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) for word in words[1:]]
            lines.append("f " + " ".join(str(c if c > 0 else count + 1 + c) for c in corners))
    return "\n".join(lines).encode()
