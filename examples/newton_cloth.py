"""Record a sheet of cloth that NVIDIA Newton simulates, as drape learns from: one npz a sequence.

    python -m venv /tmp/newton && /tmp/newton/bin/pip install newton==1.8.0
    /tmp/newton/bin/python examples/newton_cloth.py recordings/newton

Newton (https://github.com/newton-physics/newton) runs on the CPU, in an environment of its own; drape does not need it.
A square of 0.5 m hangs by two corners, is turned and bent, gets a random velocity, and swings; or hangs by one corner;
or falls free. Every edge is one of Newton's springs, every inner edge one of its hinges: ½ k Δl² and ½ b Δθ², which is
the form of the law that drape learns. Backward Euler by vertex block descent.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import newton
import numpy as np
import warp as wp

FPS, FRAMES = 60, 40
"""Frames a second, frames in a sequence."""
STEPS, SWEEPS = 4, 100
"""Steps in a frame, sweeps over the vertices in a step: so many that the equations of a step are solved."""
DENSITY, GRAVITY = 0.2, 9.81
"""[kg/m²], [m/s²]"""
SPRING, HINGE, HINGE_DAMPING = 100.0, 2.0e-4, 1.0e-6
"""Stiffness k of an edge [N/m] and b of an inner edge [J], damping of its angle [J s]."""


def square(size: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rest positions [m], faces, the two upper corners."""
    side = np.linspace(-size / 2, size / 2, count)
    rest = np.stack([*np.meshgrid(side, side), np.zeros((count, count))], -1).reshape(-1, 3)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, count + 1], first[:, None] + [0, count + 1, count]])
    return rest, faces, np.array([count * (count - 1), count * count - 1])


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


def sheet(number: int) -> Sheet:
    """The sheet of one sequence: six of eight hang by two corners, one by a single corner, one falls."""
    random = np.random.default_rng([number, 7])
    rest, faces, corners = square(0.5, 16)
    pinned = {3: corners[:1], 6: corners[:0]}.get(number % 8, corners)
    return Sheet(rest, faces, pinned, *start(rest, pinned, random))


def add_cloth(builder: newton.ModelBuilder, each: Sheet) -> None:
    """Masses, springs and hinges of one sheet; its triangles weigh, and nothing else."""
    first = len(builder.edge_indices)
    builder.add_cloth_mesh(
        pos=wp.vec3(), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(), density=DENSITY, particle_radius=0.005,
        vertices=[wp.vec3(*point) for point in each.rest], indices=each.faces.reshape(-1).tolist(),
        tri_ke=0.0, tri_ka=0.0, tri_kd=0.0, edge_ke=0.0, edge_kd=0.0,
    )  # fmt: skip
    for edge in range(first, len(builder.edge_indices)):
        *_, i, j = builder.edge_indices[edge]
        builder.add_spring(int(i), int(j), SPRING, kd=0.0, control=0.0)
        length = builder.edge_rest_length[edge]  # Newton multiplies by it
        builder.edge_bending_properties[edge] = (HINGE / length, HINGE_DAMPING / length)


def simulate(sheets: list[Sheet]) -> tuple[np.ndarray, np.ndarray]:
    """Positions in each frame and masses of the vertices of all sheets, which do not feel each other."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, -GRAVITY))
    for each in sheets:
        add_cloth(builder, each)
    mass = np.array(builder.particle_mass)
    first = np.cumsum([0] + [len(each.rest) for each in sheets[:-1]])
    for vertex in np.concatenate([each.pinned + offset for each, offset in zip(sheets, first, strict=True)]).tolist():
        builder.particle_mass[vertex] = 0.0
        builder.particle_flags[vertex] = builder.particle_flags[vertex] & ~newton.ParticleFlags.ACTIVE
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverVBD(model, iterations=SWEEPS, particle_enable_self_contact=False)
    now, then, control = model.state(), model.state(), model.control()
    now.particle_q.assign(np.concatenate([each.x for each in sheets]).astype(np.float32))
    now.particle_qd.assign(np.concatenate([each.v for each in sheets]).astype(np.float32))
    frames = [now.particle_q.numpy().copy()]
    for _ in range(1, FRAMES):
        for _ in range(STEPS):
            now.clear_forces()
            solver.step(now, then, control, None, 1.0 / FPS / STEPS)
            now, then = then, now
        frames.append(now.particle_q.numpy().copy())
    return np.stack(frames), mass


def main() -> None:
    """Record what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sequences", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="where several processes share the work")
    arguments = parser.parse_args()
    wp.config.quiet = True
    numbers = range(arguments.first, arguments.first + arguments.sequences)
    sheets = [sheet(number) for number in numbers]
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
