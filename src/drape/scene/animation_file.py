"""Animations that only Blender can open, read in a process of its own (``python -m drape.blender.read_animation``)."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import drape
from drape.errors import DrapeError
from drape.scene.motion_clip import MotionClip

KINDS = (".glb", ".gltf", ".abc", ".usd", ".usda", ".usdc", ".usdz")


def read_animation(path: Path, dt: float, frames: int) -> MotionClip:
    """Every mesh of a GLB, glTF, Alembic or USD file as one triangle mesh, +z up, [m].

    glTF and Alembic count in seconds and are read at the times ``k * dt``, k = 0..``frames``, as far as they go; USD
    at its time codes, whose rate Blender does not tell.

    Raises:
        DrapeError: Blender is missing or its process died, or the file holds no body.
    """
    source = str(Path(drape.__file__).parents[1])
    search = os.pathsep.join([source, *filter(None, [os.environ.get("PYTHONPATH")])])
    with tempfile.TemporaryDirectory() as folder:
        arrays = Path(folder) / "body.npz"
        done = subprocess.run(
            [sys.executable, "-m", "drape.blender.read_animation", str(path), str(arrays), repr(dt), str(frames)],
            env={**os.environ, "PYTHONPATH": search}, capture_output=True, text=True, errors="replace", check=False,
        )
        answer = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 and done.stdout.strip() else None
        if answer is None:
            tail = " | ".join(done.stderr.strip().splitlines()[-3:]) or "no output"
            raise DrapeError(
                f"{path}: the Blender process that reads it died (exit status {done.returncode}): {tail}; export the "
                "body as a folder of OBJ files or as npz instead"
            )
        if "error" in answer:
            raise DrapeError(f"{path}: {answer['error']}")
        with np.load(arrays, allow_pickle=False) as file:
            return MotionClip(file["faces"], file["positions"].astype(np.float64), answer["fps"], z_is_up=True)
