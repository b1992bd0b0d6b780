"""A few lines of text that say what is in a data set."""

from __future__ import annotations

import numpy as np

from drape.data.hdf5 import GarmentFile
from drape.data.motion import edge_strain, external_energy_per_mass, speeds
from drape.data.schema import RECORDINGS
from drape.scene.mass import vertex_areas
from drape.scene.proportions import size

COLUMNS = ("fabric", "train", "test", "rejected", "speed m/s", "edge strain %", "energy change J/frame")


def dataset_card(file: GarmentFile) -> str:
    """Per fabric: sequences in both splits, rejected starts, and what the cloth does.

    Ranges are percentiles 1 | 50 | 99 and then the extremes in brackets, over all sequences, frames and vertices or
    edges. The energy is kinetic plus gravitational energy of the whole cloth; its change between two frames is what the
    internal energy and the dissipation have to account for.
    """
    about = (_recorded if file.attribute("format") == RECORDINGS else _made)(file)
    lines = [*about, "percentiles 1 | 50 | 99  [least, greatest] over all sequences and frames:"]
    return "\n".join(lines + aligned([COLUMNS, *(_row(file, fabric) for fabric in file.fabrics)]))


def _made(file: GarmentFile) -> list[str]:
    first = file.sequences[0]
    mesh = first.mesh
    return [
        f"{file.path}: {len(file.names)} sequences of {first.num_frames} frames, dt {file.dt:.5f} s, "
        f"{mesh.num_vertices} vertices, {mesh.num_faces} faces, {mesh.num_edges} edges, {len(first.pinned)} pinned",
        f"cloth {np.ptp(mesh.rest_positions[:, 0]):.2f} m wide, gravity {np.linalg.norm(file.gravity):.3f} m/s2, "
        f"seed {file.attribute('seed')}, Blender {file.attribute('blender_version')}, "
        f"{file.path.stat().st_size / 1e6:.1f} MB",
    ]


def _recorded(file: GarmentFile) -> list[str]:
    frames = [sequence.num_frames for sequence in file.sequences]
    most = f"{min(frames)} to {max(frames)}" if min(frames) < max(frames) else f"{frames[0]}"
    lines = [
        f"{file.path}: {len(frames)} sequences of {most} frames, dt {file.dt:.5f} s, gravity "
        f"{np.linalg.norm(file.gravity):.3f} m/s2, {file.path.stat().st_size / 1e6:.1f} MB"
    ]
    for mesh in dict.fromkeys(sequence.mesh for sequence in file.sequences):
        own = [sequence for sequence in file.sequences if sequence.mesh is mesh]
        pins = ", ".join(map(str, sorted({len(sequence.pinned) for sequence in own})))
        area = float(vertex_areas(mesh).sum())
        lines.append(
            f"cloth of {size(mesh.rest_positions):.2f} m and {own[0].mass.sum() / area:.3g} kg/m2: {mesh.num_vertices} "
            f"vertices, {mesh.num_faces} faces, edges of {1e3 * mesh.rest_lengths.mean():.1f} mm; pinned: {pins}"
        )
    return lines


def _row(file: GarmentFile, fabric: str) -> tuple[str, ...]:
    chosen = [name for name in file.names if file.sequence(name).fabric == fabric]
    counts = [str(sum(file.sequence(name).split == split for name in chosen)) for split in ("train", "test")]
    again = sum(file.sequence(name).attempts - 1 for name in chosen)
    rejected = "-" if file.attribute("format") == RECORDINGS else str(again)
    samples: tuple[list, list, list] = ([], [], [])
    for name in chosen:
        sequence = file.sequence(name)  # which keeps what is read of it
        x, mass = sequence.positions, sequence.mass
        energy = external_energy_per_mass(x, file.dt, file.gravity, mass)
        samples[0].append(speeds(x, file.dt).astype(np.float32))
        samples[1].append(100.0 * edge_strain(x, sequence.mesh).astype(np.float32))
        samples[2].append(mass.sum() * np.diff(energy))
    ranges = (_range(np.concatenate([v.reshape(-1) for v in s])) for s in samples)
    return (fabric, *counts, rejected, *ranges)


def _range(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [1, 50, 99])
    return f"{low:.3g} | {middle:.3g} | {high:.3g}  [{values.min():.3g}, {values.max():.3g}]"


def aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of text whose columns begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
