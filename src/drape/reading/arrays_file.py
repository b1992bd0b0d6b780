"""Meshes as arrays: npz or HDF5 with ``faces`` (faces, 3), ``positions`` (frames, vertices, 3) and perhaps ``fps``."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from drape.errors import DrapeError
from drape.reading.mesh_record import MeshFile, Polygons
from drape.stored import check_hdf5

NAMES = ("faces", "positions", "fps")
OF_POSES = ("poses", "betas", "trans")
"""Arrays that motion databases of SMPL bodies (AMASS) hold instead of meshes."""


def read_arrays(path: Path) -> MeshFile:
    """A mesh that may move.

    Raises:
        DrapeError: a file that cannot be read, poses of SMPL instead of meshes, arrays that are missing or of another
            shape.
    """
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as file:
                found, arrays = set(file.files), {name: file[name] for name in NAMES if name in file}
        else:
            with h5py.File(path, "r") as file:
                check_hdf5(file, path)
                found, arrays = set(file), {name: file[name][()] for name in NAMES if name in file}
                if "fps" in file.attrs:
                    arrays["fps"] = file.attrs["fps"]
    except Exception as error:  # cut off, something else, an array of objects
        raise DrapeError(f"{path}: cannot be read ({type(error).__name__}: {error}); write the file again") from error
    if "positions" not in arrays and found & set(OF_POSES):
        raise DrapeError(
            f"{path}: found {', '.join(sorted(found & set(OF_POSES)))}: poses of an SMPL body (as of AMASS), not its "
            "mesh; expected faces and positions; pose the body with its model (the package smplx gives vertices and "
            "faces for poses, betas, trans) and store np.savez(..., faces=faces, positions=vertices, fps=rate)"
        )
    for name, last in (("faces", 2), ("positions", 3)):
        array = np.asarray(arrays[name]) if name in arrays else None
        if array is None or array.ndim != last or array.shape[-1] != 3 or array.dtype.kind not in "iuf":
            what = "nothing" if array is None else f"{array.dtype} of shape {array.shape}"
            shape = "(faces, 3)" if name == "faces" else "(frames, vertices, 3)"
            raise DrapeError(f"{path}: {name}: found {what}; expected numbers of shape {shape}")
    if arrays["faces"].dtype.kind == "f":
        raise DrapeError(f"{path}: faces: found {arrays['faces'].dtype}; expected whole numbers (vertex indices)")
    fps = np.asarray(arrays.get("fps", np.nan), np.float64).reshape(-1)
    if len(fps) != 1:
        raise DrapeError(f"{path}: fps: found {len(fps)} numbers; expected one, frames per second")
    known = None if "fps" not in arrays else float(fps[0])
    return MeshFile(path, Polygons.of_faces(arrays["faces"]), arrays["positions"].astype(np.float64), known)
