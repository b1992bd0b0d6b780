"""A few lines of text that say what is in a data set, and what the quality control of garments found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drape.data.hdf5 import GarmentFile, GarmentSequence
from drape.data.motion import edge_strain, external_energy_per_mass, speeds
from drape.data.schema import RECORDINGS, SPLITS
from drape.scene.mass import vertex_areas
from drape.scene.proportions import size

OF_SHEETS = ("fabric", "train", "test", "rejected", "speed m/s", "edge strain %", "energy change J/frame")
OF_GARMENTS = (
    "kind", "train", "test", "vertices", "redrawn", "repaired", "inside %", "crossing %", "stretch", "speed m/s",
    "twin mm",
)  # fmt: skip


def dataset_card(file: GarmentFile) -> str:
    """Summary of all sequences, and a row of a table for each fabric of sheets or each kind of garment.

    Sheets: rejected starts, and what the cloth does in percentiles 1 | 50 | 99 with the extremes in brackets, over all
    frames and vertices or edges. The energy is kinetic plus gravitational energy of the whole cloth; its change between
    two frames is what the internal energy and the dissipation have to account for.

    Garments: what quality control measured. Inside: vertices inside the body, mean over the frames and worst frame of
    any sequence. Crossing: faces through others, the same. Stretch: length over rest length of the edges, mean and the
    largest 99th percentile of a sequence. Twin: mean distance of the same simulation started 1e-6 m beside (test
    split): the noise floor.
    """
    frames = [sequence.num_frames for sequence in file.sequences]
    most = f"{min(frames)} to {max(frames)}" if min(frames) < max(frames) else f"{frames[0]}"
    seed = "" if file.attribute("format") == RECORDINGS else f"seed {file.attribute('seed')}, "
    first = (
        f"{file.path}: {len(frames)} sequences of {most} frames, dt {file.dt:.5f} s, gravity "
        f"{np.linalg.norm(file.gravity):.3f} m/s2, {seed}{file.source}, {file.path.stat().st_size / 1e6:.1f} MB"
    )
    dressed = any(sequence.body for sequence in file.sequences)
    return "\n".join([first, *(_garments if dressed else _sheets)(file)])


def _sheets(file: GarmentFile) -> list[str]:
    lines = []
    for mesh in dict.fromkeys(sequence.mesh for sequence in file.sequences):
        own = [sequence for sequence in file.sequences if sequence.mesh is mesh]
        pins = ", ".join(map(str, sorted({len(sequence.pinned) for sequence in own})))
        densities = sorted(sequence.mass.sum() / vertex_areas(mesh).sum() for sequence in own)
        density = " to ".join(dict.fromkeys(f"{value:.3g}" for value in (densities[0], densities[-1])))
        lines.append(
            f"cloth of {size(mesh.rest_positions):.2f} m from corner to corner and {density} kg/m2: "
            f"{mesh.num_vertices} vertices, {mesh.num_faces} faces, edges of {1e3 * mesh.rest_lengths.mean():.1f} mm; "
            f"pinned: {pins}"
        )
    lines.append("percentiles 1 | 50 | 99  [least, greatest] over all sequences and frames:")
    return lines + aligned([OF_SHEETS, *(_fabric_row(file, fabric) for fabric in file.fabrics)])


def _fabric_row(file: GarmentFile, fabric: str) -> tuple[str, ...]:
    chosen = [sequence for sequence in file.sequences if sequence.fabric == fabric]
    again = sum(sequence.attempts - 1 for sequence in chosen)
    samples: tuple[list, list, list] = ([], [], [])
    for sequence in chosen:
        x, mass = sequence.positions, sequence.mass
        energy = external_energy_per_mass(x, file.dt, file.gravity, mass)
        samples[0].append(speeds(x, file.dt).astype(np.float32))
        samples[1].append(100.0 * edge_strain(x, sequence.mesh).astype(np.float32))
        samples[2].append(mass.sum() * np.diff(energy))
    ranges = (_range(np.concatenate([v.reshape(-1) for v in s])) for s in samples)
    return (fabric, *_counts(chosen), "-" if file.attribute("format") == RECORDINGS else str(again), *ranges)


def _range(values: np.ndarray) -> str:
    low, middle, high = np.percentile(values, [1, 50, 99])
    return f"{low:.3g} | {middle:.3g} | {high:.3g}  [{values.min():.3g}, {values.max():.3g}]"


def _garments(file: GarmentFile) -> list[str]:
    redrawn, repaired = ([test(sequence) for sequence in file.sequences] for test in (_is_redrawn, _is_repaired))
    either = np.mean(np.logical_or(redrawn, repaired))
    kinds = list(dict.fromkeys(sequence.kind for sequence in file.sequences))
    groups = [(kind, [s for s in file.sequences if s.kind == kind]) for kind in kinds]
    return [
        *(_split_line(file, split) for split in SPLITS if file.split(split)),
        f"quality control: {sum(redrawn)} drawn anew, {sum(repaired)} repaired with more solver steps: "
        f"{100 * either:.1f} % of the sequences",
        *aligned([OF_GARMENTS, *(_kind_row(kind, own) for kind, own in [*groups, ("all", file.sequences)])]),
    ]


def _split_line(file: GarmentFile, split: str) -> str:
    members = [file.sequence(name) for name in file.split(split)]
    motions = ", ".join(dict.fromkeys(sequence.motion for sequence in members))
    fabrics = [sequence.fabric for sequence in members]
    counts = ", ".join(f"{fabrics.count(fabric)} {fabric}" for fabric in file.fabrics)
    return (
        f"{split}: {len(members)} sequences, {len({s.body for s in members})} bodies, "
        f"{len({s.garment for s in members})} garments, motions {motions}; {counts}"
    )


def _kind_row(kind: str, members: Sequence[GarmentSequence]) -> tuple[str, ...]:
    def numbers(measure: str) -> np.ndarray:
        found = [sequence.quality[measure] for sequence in members if measure in sequence.quality]
        return np.array(found or [np.nan], float)

    vertices = [sequence.mesh.num_vertices for sequence in members]
    twin = numbers("twin_distance")
    return (
        kind,
        *_counts(members),
        f"{min(vertices)}-{max(vertices)}",
        str(sum(map(_is_redrawn, members))),
        str(sum(map(_is_repaired, members))),
        f"{100 * numbers('inside_mean').mean():.3f} | {100 * numbers('inside_worst').max():.2f}",
        f"{100 * numbers('self_intersection_mean').mean():.3f} | {100 * numbers('self_intersection_worst').max():.2f}",
        f"{numbers('stretch_mean').mean():.3f} | {numbers('stretch_99').max():.2f}",
        f"{numbers('speed').max():.1f}",
        f"{1e3 * twin.mean():.1f}" if np.isfinite(twin).all() else "-",
    )


def _counts(members: Sequence[GarmentSequence]) -> tuple[str, ...]:
    """Number of sequences in each split."""
    return tuple(str(sum(sequence.split == split for sequence in members)) for split in SPLITS)


def _is_redrawn(sequence: GarmentSequence) -> bool:
    return sequence.attempts > 1


def _is_repaired(sequence: GarmentSequence) -> bool:
    return bool(sequence.quality.get("repaired"))


def aligned(rows: list[tuple[str, ...]]) -> list[str]:
    """Lines of text whose columns begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
