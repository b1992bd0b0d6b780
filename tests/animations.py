"""A small animated scene without a simulator: a sheet that waves above a sphere that moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from drape.data.animation_hdf5 import AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.geometry.grid import square_grid
from drape.reading.files import read_file
from drape.reading.mesh_record import ReadMesh
from drape.reading.triangles import made
from drape.scene.obstacle import Obstacle
from drape.scene.state import State

FILES = Path(__file__).parent / "fixtures"
"""As tools write them."""
COLUMNS = {"residual": "N", "iterations": "1"}
MESH = square_grid(1.0, 7, "alternating")
REST = MESH.rest_positions.astype(np.float64)


def header(frames: int = 3, body: bool = True, **changes: object) -> AnimationHeader:
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    path = np.array([[0.05 * k, 0.0, -0.35] for k in range(frames)])
    values = {
        "rest_positions": REST,
        "faces": MESH.faces,
        "mass": np.full(len(REST), 0.003),
        "dt": 1 / 30,
        "frames": frames,
        "gravity": np.array([0.0, 0.0, -9.81]),
        "fabric": "denim",
        "pinned": np.array([0, 6]),
        "obstacle": Obstacle(ball.faces, ball.vertices + path[:, None]) if body else None,
        "columns": COLUMNS,
        "config": "scene: {name: waving}\nsolver: {tolerance: 0.001}\n",
    }
    return AnimationHeader(**(values | changes))


def state(frame: int) -> State:
    """The sheet at one frame, and its velocity at 1/30 s between frames."""
    phase = 5.0 * REST[:, 0] + frame
    x = REST + np.column_stack([0.02 * frame * REST[:, 1], 0 * phase, 0.08 * np.sin(phase) + 0.02 * frame])
    return State(x, np.column_stack([0.6 * REST[:, 1], 0 * phase, 2.4 * np.cos(phase) + 0.6]))


def numbers(frame: int) -> dict[str, float] | None:
    return {"residual": 1e-4 * frame, "iterations": 10 + frame} if frame else None


def write(path: Path, made: AnimationHeader, stop: int | None = None) -> Path:
    """Frames up to ``stop`` (to the end), going on where another call stopped."""
    with AnimationWriter(path, made) as writer:
        for frame in range(writer.num_frames, made.frames if stop is None else stop):
            writer.append(state(frame), numbers(frame))
    return path


def raised(read: ReadMesh, path: Path, first: int = 0) -> Path:
    """Two frames of a cloth as it was read, and 1 cm higher, with a body that moves from frame ``first`` on."""
    x = read.positions[0]
    ball = made(replace(read_file(FILES / "trimesh" / "ball_mixed.obj"), first=first))
    body = Obstacle(ball.faces, ball.positions + [[[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.02]]])
    unit = np.ones(len(x))
    header = AnimationHeader(
        x, read.faces, unit, 1 / 24, 2, np.array([0, 0, -9.81]), obstacle=body, forms=(read.form, ball.form)
    )
    with AnimationWriter(path, header) as writer:
        for frame in range(2):
            writer.append(State(x + [0.0, 0.0, 0.01 * frame], 0 * x))
    return path
