"""A stored animation as plain meshes: a sequence of OBJ files, or arrays in an npz file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from drape.data.animation_hdf5 import AnimationFile
from drape.data.whole_file import whole_file


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

    Vertices in the order of the scene, coordinates as simulated [m], no normals. Files of an earlier export that are
    not among these are removed.
    """
    header, written = file.header, set()
    obstacle = header.obstacle
    for frame in range(file.num_frames):
        written.add(_write(folder / f"cloth_{frame:04d}.obj", file.x(frame), header.faces))
        if obstacle is not None and not obstacle.is_static:
            written.add(_write(folder / f"body_{frame:04d}.obj", obstacle.at(frame), obstacle.faces))
    if obstacle is not None and obstacle.is_static:
        written.add(_write(folder / "body.obj", obstacle.at(0), obstacle.faces))
    for old in [*folder.glob("cloth_*.obj"), *folder.glob("body*.obj")]:
        if old not in written:
            old.unlink()
    return folder


def _write(path: Path, positions: np.ndarray, faces: np.ndarray) -> Path:
    mesh = trimesh.Trimesh(positions, faces, process=False)
    with whole_file(path) as temporary:
        temporary.write_text(mesh.export(file_type="obj", include_normals=False, digits=9), encoding="utf-8")
    return path
