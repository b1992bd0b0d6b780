"""Files that only Blender can open, read in a process of its own (``python -m drape.blender.read_meshes``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from drape.blender.process import BlenderProcess
from drape.reading.mesh_record import MeshFile, Polygons
from drape.reading.usd_rate import usd_rate


def read_with_blender(path: Path, dt: float | None, frames: int | None, clip: str | None) -> MeshFile:
    """Every mesh of the file, +z up, [m]; see :func:`drape.blender.read_meshes.read`.

    Raises:
        DrapeError: Blender is missing or its process died, the file holds no mesh, or several clips.
    """
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "mesh.npz"
        request = {"path": str(path), "arrays": str(arrays), "dt": dt, "frames": frames, "clip": clip}
        with BlenderProcess("drape.blender.read_meshes", [], Path(folder) / "log") as blender:
            blender.send(request)
            answer = blender.receive(str(path))
        with np.load(arrays, allow_pickle=False) as file:
            return MeshFile(
                path,
                Polygons(file["corners"], file["sizes"]),
                file["positions"],
                fps=usd_rate(path) if path.suffix.lower().startswith(".usd") else answer["fps"],
                first=answer["first"],
                unit=None if path.suffix.lower() == ".abc" else 1.0,  # Alembic does not say
                up="z",
                uv=file.get("uv"),
                materials=tuple(answer["materials"]),
                material=file["material"] if answer["materials"] else None,
                said=tuple(answer["said"]),
            )
