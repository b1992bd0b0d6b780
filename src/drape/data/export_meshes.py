"""A stored animation as plain meshes: a sequence of OBJ files, or arrays in an npz file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drape.data.animation_hdf5 import AnimationFile
from drape.data.whole_file import whole_file
from drape.reading.mesh_record import FileForm, Polygons


def export_npz(file: AnimationFile, path: Path) -> Path:
    """Arrays under their names in the HDF5 file (``.`` for ``/``), and ``dt`` [s]; returns ``path``.

    ``x``, ``v`` (frames, vertices, 3) in float64, ``mesh.faces``, ``mesh.rest_positions``, ``mesh.mass``, ..., and
    ``body.faces``, ``body.positions`` where there is a body.
    """
    motion = file.trajectory()
    arrays = {name.replace("/", "."): array for name, array in file.header.arrays().items()}
    with whole_file(path) as temporary:
        np.savez(temporary, x=motion.x, v=motion.v, dt=np.float64(motion.dt), **arrays)
    return path


def export_obj(file: AnimationFile, folder: Path) -> Path:
    """``cloth_0000.obj`` … and ``body_0000.obj`` … (one ``body.obj`` if it stands still); returns ``folder``.

    Meshes that came from files are written as they came in: polygons, order of vertices, texture coordinates,
    materials, unit, axes, number of the first frame. Others in metres, as simulated. No normals. Files of an earlier
    export that are not among these are removed.
    """
    header, obstacle, (cloth, body) = file.header, file.header.obstacle, file.header.forms
    faces, written = _faces(cloth, header.faces), set()
    numbers = {frame: f"{header.first + frame:04d}" for frame in range(file.num_frames)}
    for frame, number in numbers.items():
        written.add(_write(folder / f"cloth_{number}.obj", _positions(cloth, file.x(frame)), faces))
    if obstacle is not None:
        faces = _faces(body, obstacle.faces)
        names = {0: "body"} if obstacle.is_static else {frame: f"body_{number}" for frame, number in numbers.items()}
        for frame, name in names.items():
            written.add(_write(folder / f"{name}.obj", _positions(body, obstacle.at(frame)), faces))
    for old in [*folder.glob("cloth_*.obj"), *folder.glob("body*.obj")]:
        if old not in written:
            old.unlink()
    return folder


def _positions(form: FileForm | None, x: np.ndarray) -> np.ndarray:
    return x if form is None else form.in_file(x)


def _faces(form: FileForm | None, faces: np.ndarray) -> str:
    """Texture coordinates, materials and polygons as lines of an OBJ file."""
    polygons = Polygons.of_faces(faces) if form is None else form.polygons
    words, lines = (polygons.corners + 1).astype(str).tolist(), []
    if form is not None and form.uv is not None:
        uv, which = np.unique(form.uv, axis=0, return_inverse=True)
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in np.nan_to_num(uv).tolist()]
        places = np.where(np.isnan(form.uv[:, 0]), "", np.char.add("/", (which.reshape(-1) + 1).astype(str)))
        words = [word + place for word, place in zip(words, places.tolist(), strict=True)]
    material = np.full(len(polygons.sizes), -1) if form is None or form.material is None else form.material
    materials, current = () if form is None else form.materials, -1
    for start, size, index in zip(polygons.starts.tolist(), polygons.sizes.tolist(), material.tolist(), strict=True):
        if index != current and index >= 0:
            lines.append(f"usemtl {materials[index]}")
            current = index
        lines.append("f " + " ".join(words[start : start + size]))
    return "\n".join(lines)


def _write(path: Path, positions: np.ndarray, faces: str) -> Path:
    vertices = "\n".join(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in positions.tolist())
    with whole_file(path) as temporary:
        temporary.write_text(f"{vertices}\n{faces}\n", encoding="utf-8")
    return path
