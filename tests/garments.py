"""A small data set of garments that needs no simulator: tubes of cloth around a ball that moves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import trimesh
import yaml

from drape.config.entry_point import CONF
from drape.data.hdf5_writer import data_writer
from drape.data.stored_part import Header, Part, StoredBody, StoredGarment, StoredSequence

FPS = 30.0
FRAMES = 6
RADIUS = 0.12
"""Of the ball [m]."""
AROUND, RINGS = 14, 5
"""Vertices of the tube."""
TOP = np.arange(AROUND)
"""Its highest ring."""
FABRICS = ("silk", "denim")


def tube() -> tuple[np.ndarray, np.ndarray]:
    """Rest positions [m] and faces, wound outwards; 2 cm from the ball."""
    angle = np.arange(AROUND) * 2 * np.pi / AROUND
    ring = (RADIUS + 0.02) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    positions = np.concatenate([ring - [0, 0, 0.05 * k - 0.1] for k in range(RINGS)])
    first = np.arange(AROUND * (RINGS - 1))
    right = first - first % AROUND + (first + 1) % AROUND
    below, across = first + AROUND, right + AROUND
    return positions, np.concatenate([np.stack([first, below, right], 1), np.stack([right, below, across], 1)])


def transforms(frames: int = FRAMES) -> np.ndarray:
    """One joint that turns about z and moves along x, at rest in the first two frames."""
    found = np.tile(np.eye(4), (frames, 1, 1, 1))
    for k in range(2, frames):
        angle, c, s = 0.05 * (k - 1), np.cos(0.05 * (k - 1)), np.sin(0.05 * (k - 1))
        found[k, 0, :2, :2] = [[c, -s], [s, c]]
        found[k, 0, 0, 3] = 0.1 * angle
    return found


def carried(points: np.ndarray, frames: int = FRAMES) -> np.ndarray:
    """Points that the joint carries rigidly."""
    moves = transforms(frames)[:, 0]
    return points @ moves[:, :3, :3].transpose(0, 2, 1) + moves[:, None, :3, 3]


def recorded(frames: int = FRAMES, seed: int = 0) -> np.ndarray:
    """Frames of the tube: carried, and it sags a little more with every frame."""
    rest, _ = tube()
    sag = 0.002 * np.arange(frames)[:, None] * (0.1 - rest[:, 2])
    x = carried(rest, frames)
    x[..., 2] -= sag
    beside = 1e-6 * np.random.default_rng(seed).normal(size=x.shape)
    beside[:, TOP] = 0.0
    return x + (beside if seed else 0.0)


def settings(fabric: str) -> dict[str, float | str]:
    """The fabric in Blender's numbers, as conf/fabric has it."""
    node = yaml.safe_load((CONF / "fabric" / f"{fabric}.yaml").read_text(encoding="utf-8"))
    values = {key: value for key, value in node.items() if key not in ("_target_", "name")}
    return values | {"preset": fabric.capitalize(), "quality": 10}


def write_groups(
    path: Path, header: Header, bodies: Mapping[str, StoredBody], garments: Mapping[str, StoredGarment],
    sequences: Iterable[StoredSequence],
) -> None:  # fmt: skip
    """A file of sequences that name their bodies and garments; of unknown ones it is told nothing."""
    with data_writer(path, header) as writer:
        for sequence in sequences:
            writer.add(Part(bodies.get(sequence.body), garments.get(sequence.garment), sequence))


def write(path: Path, frames: int = FRAMES, **changes: object) -> Path:
    """Four sequences: a dress to train on; a silk dress, a denim skirt with a pinned top, a silk skirt to test on.

    The last one has neither twin nor joints. ``changes`` are those of every sequence.
    """
    ball = trimesh.creation.icosphere(subdivisions=2, radius=RADIUS)
    rest, faces = tube()

    def bones(count: int) -> dict[str, np.ndarray]:
        return {"bones": np.zeros((count, 4), int), "weights": np.tile([1.0, 0, 0, 0], (count, 1))}

    points = np.asarray(ball.vertices)
    bodies = {"ball": StoredBody(points, np.asarray(ball.faces), **bones(len(points)))}
    garments = {
        "dress": StoredGarment("dress", "ball", rest, faces, **bones(len(rest))),
        "skirt": StoredGarment("skirt", "ball", rest, faces, pinned=TOP),
    }
    joints = {"transforms": transforms(frames)}
    rows = [
        ("dress", "silk", "train", joints),
        ("dress", "silk", "test", joints | {"twin": recorded(frames, seed=1)}),
        ("skirt", "denim", "test", joints | {"twin": recorded(frames, seed=2)}),
        ("skirt", "silk", "test", {"body_positions": carried(points, frames)}),
    ]
    sequences = [
        StoredSequence(
            **{
                "name": f"{number:05d}", "body": "ball", "motion": "turn", "split": split, "garment": garment,
                "fabric": fabric, "mass_per_vertex": 0.02, "friction": 0.3, "positions": recorded(frames),
            } | more | changes
        )
        for number, (garment, fabric, split, more) in enumerate(rows)
    ]  # fmt: skip
    header = Header("test", FPS, (0.0, 0.0, -9.81), {name: settings(name) for name in FABRICS}, "{}")
    write_groups(path, header, bodies, garments, sequences)
    return path
