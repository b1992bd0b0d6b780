"""A few lines of text that say what is in a data set."""

from __future__ import annotations

import numpy as np

from drape.data.hdf5 import TrajectoryFile
from drape.data.motion import edge_strain, external_energy_per_mass, speeds

COLUMNS = ("fabric", "train", "test", "rejected", "speed m/s", "edge strain %", "energy change J/frame")


def dataset_card(file: TrajectoryFile) -> str:
    """Per fabric: sequences in both splits, rejected starts, and what the cloth does.

    Ranges are percentiles 1 | 50 | 99 and then the extremes in brackets, over all sequences, frames and vertices or
    edges. The energy is kinetic plus gravitational energy of the whole cloth; its change between two frames is what the
    internal energy and the dissipation have to account for.
    """
    mesh = file.mesh
    lines = [
        f"{file.path}: {file.num_sequences} sequences of {file.num_frames} frames, dt {file.dt:.5f} s, "
        f"{mesh.num_vertices} vertices, {mesh.num_faces} faces, {mesh.num_edges} edges, {len(file.pinned)} pinned",
        f"cloth {np.ptp(mesh.rest_positions[:, 0]):.2f} m wide, gravity {np.linalg.norm(file.gravity):.3f} m/s2, "
        f"seed {file.attribute('seed')}, Blender {file.attribute('blender_version')}, "
        f"{file.path.stat().st_size / 1e6:.1f} MB",
        "percentiles 1 | 50 | 99  [least, greatest] over all sequences and frames:",
    ]
    return "\n".join(lines + aligned([COLUMNS, *(_row(file, index) for index in range(len(file.fabrics)))]))


def _row(file: TrajectoryFile, index: int) -> tuple[str, ...]:
    fabric = file.fabrics[index]
    mass = file.materials[fabric]["mass_per_vertex"] * file.mesh.num_vertices
    chosen = np.flatnonzero(file.fabric == index)
    counts = [str(int(np.isin(chosen, file.split(split)).sum())) for split in ("train", "test")]
    rejected = str(int((file.attempts[chosen] - 1).sum()))
    samples: tuple[list, list, list] = ([], [], [])
    for sequence in chosen:
        x = file.positions(int(sequence))
        samples[0].append(speeds(x, file.dt).astype(np.float32))
        samples[1].append(100.0 * edge_strain(x, file.mesh).astype(np.float32))
        samples[2].append(mass * np.diff(external_energy_per_mass(x, file.dt, file.gravity)))
    return (fabric, *counts, rejected, *(_range(np.concatenate([v.reshape(-1) for v in s])) for s in samples))


def _range(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [1, 50, 99])
    return f"{low:.3g} | {middle:.3g} | {high:.3g}  [{values.min():.3g}, {values.max():.3g}]"


def aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of text whose columns begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
