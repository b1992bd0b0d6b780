"""Animations that only Blender can open, read in a process of its own (``python -m drape.blender.read_animation``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from drape.blender.process import BlenderProcess
from drape.scene.motion_clip import MotionClip

KINDS = (".glb", ".gltf", ".abc", ".usd", ".usda", ".usdc", ".usdz")


def read_animation(path: Path, dt: float, frames: int) -> MotionClip:
    """Every mesh of a GLB, glTF, Alembic or USD file as one triangle mesh, +z up, [m].

    glTF and Alembic count in seconds and are read at the times ``k * dt``, k = 0..``frames``, as far as they go; USD
    at its time codes, whose rate Blender does not tell.

    Raises:
        DrapeError: Blender is missing or its process died, or the file holds no body.
    """
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "body.npz"
        with BlenderProcess("drape.blender.read_animation", [], Path(folder) / "log") as blender:
            blender.send({"path": str(path), "arrays": str(arrays), "dt": dt, "frames": frames})
            fps = blender.receive(str(path))
        with np.load(arrays, allow_pickle=False) as file:
            return MotionClip(file["faces"], file["positions"].astype(np.float64), fps, z_is_up=True)
