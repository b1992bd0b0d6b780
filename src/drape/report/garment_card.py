"""A few lines of text that say what is in a data set of garments, and what its quality control found."""

from __future__ import annotations

import numpy as np

from drape.data.hdf5 import GarmentFile, GarmentSequence
from drape.report.dataset_card import aligned

COLUMNS = (
    "kind",
    "train",
    "test",
    "vertices",
    "redrawn",
    "repaired",
    "inside %",
    "crossing %",
    "stretch",
    "speed m/s",
    "twin mm",
)


def garment_card(file: GarmentFile) -> str:
    """Per kind of garment: sequences, vertices, and what quality control measured; and what the splits share.

    Inside: vertices inside the body, mean over the frames and worst frame of any sequence. Crossing: faces through
    others, the same. Stretch: length over rest length of the edges, mean and the largest 99th percentile of a sequence.
    Twin: mean distance of the same simulation started 1e-6 m beside (test split): the noise floor.
    """
    sequences = [file.sequence(name) for name in file.names]
    kinds = list(dict.fromkeys(sequence.kind for sequence in sequences))
    groups = [(kind, [s for s in sequences if s.kind == kind]) for kind in kinds]
    rows = [_row(file, kind, members) for kind, members in [*groups, ("all", sequences)]]
    lines = [
        f"{file.path}: {len(sequences)} sequences of {sequences[0].num_frames} frames, dt {file.dt:.5f} s, gravity "
        f"{np.linalg.norm(file.gravity):.3f} m/s2, seed {file.attribute('seed')}, {file.source}, "
        f"{file.path.stat().st_size / 1e6:.1f} MB",
        *(_split_line(file, split) for split in ("train", "test") if file.split(split)),
        _refusals(sequences),
    ]
    return "\n".join(lines + aligned([COLUMNS, *rows]))


def _split_line(file: GarmentFile, split: str) -> str:
    members = [file.sequence(name) for name in file.split(split)]
    motions = ", ".join(dict.fromkeys(sequence.motion for sequence in members))
    fabrics = [sequence.fabric for sequence in members]
    counts = ", ".join(f"{fabrics.count(fabric)} {fabric}" for fabric in file.fabrics)
    return (
        f"{split}: {len(members)} sequences, {len({s.body for s in members})} bodies, "
        f"{len({s.garment for s in members})} garments, motions {motions}; {counts}"
    )


def _refusals(sequences: list[GarmentSequence]) -> str:
    redrawn = sum(sequence.attempts > 1 for sequence in sequences)
    repaired = sum(bool(sequence.quality.get("repaired")) for sequence in sequences)
    either = sum(sequence.attempts > 1 or bool(sequence.quality.get("repaired")) for sequence in sequences)
    return (
        f"quality control: {redrawn} drawn anew, {repaired} repaired with more solver steps: "
        f"{100 * either / len(sequences):.1f} % of the sequences"
    )


def _row(file: GarmentFile, kind: str, members: list[GarmentSequence]) -> tuple[str, ...]:
    def numbers(measure: str) -> np.ndarray:
        found = [sequence.quality[measure] for sequence in members if measure in sequence.quality]
        return np.array(found or [np.nan], float)

    vertices = [file.mesh(sequence.garment).num_vertices for sequence in members]
    twin = [sequence.quality["twin_distance"] for sequence in members if "twin_distance" in sequence.quality]
    return (
        kind,
        *(str(sum(sequence.split == split for sequence in members)) for split in ("train", "test")),
        f"{min(vertices)}-{max(vertices)}",
        str(sum(sequence.attempts > 1 for sequence in members)),
        str(sum(bool(sequence.quality.get("repaired")) for sequence in members)),
        f"{100 * numbers('inside_mean').mean():.3f} | {100 * numbers('inside_worst').max():.2f}",
        f"{100 * numbers('self_intersection_mean').mean():.3f} | {100 * numbers('self_intersection_worst').max():.2f}",
        f"{numbers('stretch_mean').mean():.3f} | {numbers('stretch_99').max():.2f}",
        f"{numbers('speed').max():.1f}",
        f"{1e3 * np.mean(twin):.1f}" if twin else "-",
    )
