"""Record a sheet of cloth that NVIDIA Newton simulates, as drape learns from: one npz a sequence.

    python -m venv /tmp/newton && /tmp/newton/bin/pip install newton==1.8.0
    /tmp/newton/bin/python examples/newton_cloth.py recordings/newton --sequences 20

Newton (https://github.com/newton-physics/newton) runs on the CPU, in an environment of its own; drape does not need it.
A sheet of 0.2 kg/m² hangs by two corners, is turned and bent, gets a random velocity, and swings; or hangs by one
corner; or falls free. Membrane: stable Neo-Hookean; bending: dihedral angles; backward Euler by vertex block descent.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import newton
import numpy as np
import warp as wp
from scipy.spatial import Delaunay

FPS, SUBSTEPS, ITERATIONS = 60, 10, 30
"""Frames a second, steps in a frame, sweeps over the vertices in a step."""
DENSITY = 0.2
"""[kg/m²]"""
FABRIC = {"tri_ke": 100.0, "tri_ka": 100.0, "tri_kd": 0.05, "edge_ke": 5.0e-4, "edge_kd": 1.0e-6}
"""Lamé's two constants [N/m] and their damping; bending stiffness over length [J/m] and its damping. Ten times as
stiff, these sweeps do not converge (forces are several times what the motion needs), and waves in the plane of the
sheet are faster than frames: no law shows in such a recording. With 10 sweeps a third of the force is left, with 30
a tenth."""
GRAVITY = 9.81
FRAMES = 40


def grid(size: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square: rest positions [m], faces, the two upper corners."""
    side = np.linspace(-size / 2, size / 2, count)
    rest = np.stack([*np.meshgrid(side, side), np.zeros((count, count))], -1).reshape(-1, 3)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, count + 1], first[:, None] + [0, count + 1, count]])
    return rest, faces, np.array([count * (count - 1), count * count - 1])


def patch(size: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A rounded piece with an irregular mesh."""
    random, spacing = np.random.default_rng(seed), size / (count - 1)
    rows = np.arange(-count, count + 1)
    points = np.stack(np.meshgrid(rows, rows), -1).reshape(-1, 2) * [1.0, np.sqrt(0.75)]
    points[:, 0] += 0.5 * (np.round(points[:, 1] / np.sqrt(0.75)) % 2)
    points = spacing * (points + random.uniform(-0.2, 0.2, points.shape))
    inside = np.abs(points / [0.5 * size, 0.42 * size]) ** 3
    points = points[inside.sum(1) < 1.0]
    faces = Delaunay(points).simplices
    corners = points[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    faces = faces[np.abs(area) > 0.15 * spacing**2]
    faces[area[np.abs(area) > 0.15 * spacing**2] < 0] = faces[area[np.abs(area) > 0.15 * spacing**2] < 0][:, ::-1]
    used, faces = np.unique(faces, return_inverse=True)
    points, faces = points[used], faces.reshape(-1, 3)
    ends = [int(np.argmax(points @ [side, 1.0])) for side in (-1.0, 1.0)]
    return np.column_stack([points, np.zeros(len(points))]), faces, np.array(ends)


def start(rest: np.ndarray, pinned: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at the start: bent about one line without being stretched, turned about the pins."""
    angle = random.uniform(0.0, np.pi)
    along = np.array([np.cos(angle), np.sin(angle)]) if len(pinned) < 2 else np.array([0.0, 1.0])
    s = rest[:, :2] @ along
    reach = np.ptp(s)
    line = np.linspace(s.min(), s.max(), 400)
    turn = random.uniform(0.2, 1.2) * np.sin(random.uniform(1.0, 5.0) * (line - line[0]) / reach + random.uniform(0, 6))
    step = np.diff(line, prepend=line[0])
    flat, high = np.cumsum(np.cos(turn) * step), np.cumsum(np.sin(turn) * step)
    x = rest.copy()
    x[:, :2] += (np.interp(s, line, flat) - s)[:, None] * along
    x[:, 2] = np.interp(s, line, high)
    swing = random.uniform(-0.9, 0.9) + np.pi / 2
    cos, sin = np.cos(swing), np.sin(swing)
    x = x @ np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
    x -= x[pinned].mean(0) if len(pinned) else x.mean(0)
    v = 1.5 * random.normal(size=3) * [0.5, 1.0, 0.3] * np.linalg.norm(x, axis=1, keepdims=True) / np.ptp(rest[:, 0])
    v[pinned] = 0.0
    return x, v


class Sheet(NamedTuple):
    """A sheet at the start of its sequence."""

    rest: np.ndarray
    faces: np.ndarray
    pinned: np.ndarray
    x: np.ndarray
    v: np.ndarray


def sheet(number: int, kind: str) -> Sheet:
    """The sheet of one sequence: six of eight hang by two corners, one by a single corner, one falls."""
    random = np.random.default_rng([number, 7])
    pieces = [grid(0.5, 16)] if kind == "grid" else [patch(0.5, 16, 1), patch(0.6, 18, 2)]
    rest, faces, corners = pieces[number % len(pieces)]
    pinned = {3: corners[:1], 6: corners[:0]}.get(number % 8, corners)
    return Sheet(rest, faces, pinned, *start(rest, pinned, random))


def simulate(sheets: list[Sheet]) -> tuple[np.ndarray, np.ndarray]:
    """Positions in each frame and masses of the vertices of all sheets, which do not feel each other."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    for each in sheets:
        builder.add_cloth_mesh(
            pos=wp.vec3(), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(), density=DENSITY, particle_radius=0.005,
            vertices=[wp.vec3(*point) for point in each.rest], indices=each.faces.reshape(-1).tolist(), **FABRIC,
        )  # fmt: skip
    mass = np.array(builder.particle_mass)
    first = np.cumsum([0] + [len(each.rest) for each in sheets[:-1]])
    for vertex in np.concatenate([each.pinned + offset for each, offset in zip(sheets, first, strict=True)]).tolist():
        builder.particle_mass[vertex] = 0.0
        builder.particle_flags[vertex] = builder.particle_flags[vertex] & ~newton.ParticleFlags.ACTIVE
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverVBD(model, iterations=ITERATIONS, particle_enable_self_contact=False)
    now, then, control = model.state(), model.state(), model.control()
    now.particle_q.assign(np.concatenate([each.x for each in sheets]).astype(np.float32))
    now.particle_qd.assign(np.concatenate([each.v for each in sheets]).astype(np.float32))
    frames = [now.particle_q.numpy().copy()]
    for frame in range(1, FRAMES):
        for _ in range(SUBSTEPS):
            now.clear_forces()
            solver.step(now, then, control, None, 1.0 / FPS / SUBSTEPS)
            now, then = then, now
        frames.append(now.particle_q.numpy().copy())
        print(f"frame {frame} of {FRAMES - 1}", end="\r", flush=True)
    return np.stack(frames), mass


def main() -> None:
    """Record what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sequences", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="where several processes share the work")
    parser.add_argument("--sheet", choices=("grid", "patches"), default="grid")
    arguments = parser.parse_args()
    wp.config.quiet = True
    numbers = range(arguments.first, arguments.first + arguments.sequences)
    sheets = [sheet(number, arguments.sheet) for number in numbers]
    positions, mass = simulate(sheets)
    ends = np.cumsum([len(each.rest) for each in sheets])[:-1]
    arguments.folder.mkdir(parents=True, exist_ok=True)
    parts = np.split(positions, ends, axis=1), np.split(mass, ends)
    for number, each, x, weights in zip(numbers, sheets, *parts, strict=True):
        path = arguments.folder / f"sequence_{number:02d}.npz"
        arrays = {"faces": each.faces, "positions": x, "rest_positions": each.rest, "mass": weights}
        np.savez_compressed(path, **arrays, fps=float(FPS))
        print(path, f"{len(each.rest)} vertices, {len(each.pinned)} pins", flush=True)


if __name__ == "__main__":
    main()
