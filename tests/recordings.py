"""Recordings of cloth whose law is known: springs along edges, gravity, pins, and nothing else."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import trimesh

from drape.data.hdf5 import GarmentFile
from drape.data.trajectories import open_trajectories
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.scene.mass import vertex_masses

FPS, SUBSTEPS = 60.0, 40
STIFFNESS, DAMPER = 20.0, 0.15
"""Of the spring along each edge [N/m], and of the axial damper beside it [kg/s]: no wave is faster than frames."""
DENSITY = 0.2
"""[kg/m²]"""
GRAVITY = np.array([0.0, 0.0, -9.81])


def patch(seed: int = 0) -> ClothMesh:
    """No grid: places and diagonals are irregular."""
    grid = square_grid(0.4, 5, "alternating")
    rest = grid.rest_positions + 0.015 * np.random.default_rng(seed).normal(size=grid.rest_positions.shape) * [1, 1, 0]
    return ClothMesh.from_faces(rest.astype(np.float32), grid.faces[::-1])


def swinging(mesh: ClothMesh, pinned: list[int], frames: int = 24, seed: int = 0) -> np.ndarray:
    """Positions [m] of a sheet that starts in a random wave; small steps, so that frames hold the true motion."""
    random = np.random.default_rng(seed)
    rest, mass = mesh.rest_positions.astype(np.float64), vertex_masses(mesh, {"areal_density": DENSITY})[:, None]
    angle = random.uniform(0.6, 1.4)
    x = rest @ np.array([[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    x += 0.01 * np.sin(12.0 * rest[:, :1] + random.uniform(0, 6)) * [0, 1, 1]
    v, dt = random.normal(size=3) * (rest[:, 1:2].max() - rest[:, 1:2]), 1.0 / FPS / SUBSTEPS
    first, second = mesh.edges.T
    recorded = [x.copy()]
    for step in range(1, (frames - 1) * SUBSTEPS + 1):
        edge = x[second] - x[first]
        length = np.linalg.norm(edge, axis=1, keepdims=True)
        rate = ((v[second] - v[first]) * edge).sum(1, keepdims=True) / length
        pull = (STIFFNESS * (length - mesh.rest_lengths[:, None]) + DAMPER * rate) * edge / length
        force = np.zeros_like(x)
        np.add.at(force, first, pull)
        np.add.at(force, second, -pull)
        a = GRAVITY + force / mass
        a[pinned], v[pinned] = 0.0, 0.0
        v = v + dt * a
        x = x + dt * v
        if step % SUBSTEPS == 0:
            recorded.append(x.copy())
    return np.stack(recorded)


def write_npz(path: Path, mesh: ClothMesh, x: np.ndarray, **changes: object) -> Path:
    """As Newton's example script writes them; ``changes`` of arrays, None leaves one out."""
    arrays = {"faces": mesh.faces, "positions": x, "rest_positions": mesh.rest_positions, "fps": FPS}
    arrays = {name: value for name, value in (arrays | changes).items() if value is not None}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **arrays)
    return path


def write_meshes(folder: Path, mesh: ClothMesh, positions: np.ndarray, kind: str) -> Path:
    """A file a frame, by trimesh."""
    folder.mkdir(parents=True)
    for number, frame in enumerate(positions):
        trimesh.Trimesh(frame, mesh.faces, process=False).export(folder / f"frame_{number}.{kind}")
    return folder


def as_version_1(file: GarmentFile, path: Path) -> GarmentFile:
    """The same recordings as version 1 stored them."""
    pieces = {sequence.garment: sequence for sequence in file.sequences}
    with h5py.File(path, "w") as target:
        known = {name: file.attribute(name) for name in ("drape_version", "fps", "dt", "up_axis", "config")}
        target.attrs.update(known, format="drape recordings", schema_version=1, gravity=file.gravity)
        target.attrs["fabrics"] = list(file.fabrics)

        def add(name: str, array: np.ndarray, kind: str, unit: str) -> None:
            target.create_dataset(name, data=array.astype(kind)).attrs.update(units=unit, meaning="")

        for number, one in enumerate(pieces.values()):
            add(f"pieces/{number}/rest_positions", one.mesh.rest_positions, "float32", "m")
            add(f"pieces/{number}/faces", one.mesh.faces, "int64", "1")
            add(f"pieces/{number}/pinned", one.pinned, "int64", "1")
            add(f"pieces/{number}/mass", one.mass, "float64", "kg")
        for number, one in enumerate(file.sequences):
            add(f"sequences/{number:06d}/positions", one.positions, "float32", "m")
            target[f"sequences/{number:06d}"].attrs.update(
                name=one.motion, piece=list(pieces).index(one.garment), fabric=file.fabrics.index(one.fabric),
                split=["train", "test"].index(one.split),
            )  # fmt: skip
        for fabric, settings in file.materials.items():
            target.create_group(f"materials/{fabric}").attrs.update(settings)
    return open_trajectories(path)
