"""Files that only Blender can open, read in a process of its own (``python -m drape.blender.read_meshes``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from drape.blender.process import BlenderProcess
from drape.reading.mesh_record import MeshFile, Polygons
from drape.reading.usd_rate import usd_rate


def read_with_blender(
    path: Path, dt: float | None, frames: int | None, clip: str | None, wanted: str | None = None
) -> MeshFile:
    """Every mesh of the file, or those of the object ``wanted``, +z up, [m]; see :mod:`drape.blender.read_meshes`.

    Alembic says neither unit nor axes: its positions are as they stand in the file, where y is usually up.

    Raises:
        DrapeError: Blender is missing or its process died, the file holds no mesh or none of that name, or several
            clips.
    """
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "mesh.npz"
        request = {"path": str(path), "arrays": str(arrays), "dt": dt, "frames": frames, "clip": clip, "wanted": wanted}
        with BlenderProcess("drape.blender.read_meshes", [], Path(folder) / "log") as blender:
            blender.send(request)
            answer = blender.receive(str(path))
        says = {"unit": 1.0, "up": "z"} if path.suffix.lower() != ".abc" else {"usual": "y"}
        with np.load(arrays, allow_pickle=False) as file:
            x = file["positions"]  # as Blender has turned it
            return MeshFile(
                path,
                Polygons(file["corners"], file["sizes"]),
                x if "up" in says else np.stack([x[..., 0], x[..., 2], -x[..., 1]], axis=-1),
                fps=usd_rate(path) if path.suffix.lower().startswith(".usd") else answer["fps"],
                first=answer["first"],
                uv=file.get("uv"),
                materials=tuple(answer["materials"]),
                material=file["material"] if answer["materials"] else None,
                said=tuple(answer["said"]),
                **says,
            )
