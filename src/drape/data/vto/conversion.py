"""Motions of VTO and HOOD into one file: ``python src/generate.py data=vto data.root=...``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from drape.data.conversion import Conversion, convert, frame_range
from drape.data.smpl.body_model import SmplModel
from drape.data.split_lists import read_splits
from drape.data.stored_part import Header, Part, StoredBody, StoredSequence
from drape.data.vto.motion import COMMAND, read_motion
from drape.errors import DrapeError
from drape.reading.triangles import to_metres

FEWEST = 3
"""Frames: two to start from, one to predict."""


def convert_vto(data: Mapping) -> Conversion:
    """Convert the motions that the config node names into ``data.path``; those that cannot be read are left out.

    What comes out are motions of a body alone: there is no garment to compare with, one is trained on them without.

    Raises:
        DrapeError: a mistake in the config, no SMPL model, no motion that can be converted, another data set in the
            way.
    """
    root = Path(data["root"])
    motions = {"_".join(path.relative_to(root).with_suffix("").parts): path for path in root.rglob("*.npz")}
    if not motions:
        raise DrapeError(
            f"data.root: {root}: found no motion (.npz); VTO's pickles are converted once: {COMMAND} <folder> {root}"
        )
    fps, (first, stop) = float(data["fps"]), frame_range(data["frames"])
    splits = read_splits(motions, data["train"], data["test"])
    config = {"data": {key: value for key, value in data.items() if key != "path"}}
    header = Header(
        source="vto",
        fps=fps,
        gravity=(0.0, 0.0, -float(data["gravity"])),
        materials={},
        config=yaml.safe_dump(config, sort_keys=False),
    )
    reader = MotionReader(motions, SmplModel.load(data["smpl"]), first, stop, splits)
    return convert(Path(data["path"]), config, header, splits, reader.read)


@dataclass(frozen=True, eq=False)
class MotionReader:
    """Reads motions: frames ``first`` to ``stop`` (exclusive), or to the end of a shorter one."""

    paths: Mapping[str, Path]
    model: SmplModel
    first: int
    stop: int
    splits: Mapping[str, str]

    def read(self, name: str) -> Part:
        """Motion ``name``, turned from y up to z up.

        Raises:
            DrapeError: no such motion, a damaged one, too few frames.
        """
        if name not in self.paths:
            raise DrapeError(f"{name}: found no {name}.npz below data.root; expected the motion that a list names")
        motion = read_motion(self.paths[name])
        stop = min(self.stop, motion.num_frames)
        if stop - self.first < FEWEST:
            raise DrapeError(
                f"{self.paths[name]}: found {motion.num_frames} frames; expected at least {self.first + FEWEST}, as "
                f"frames {self.first} to {self.stop} are asked for; set data.frames"
            )
        frames = slice(self.first, stop)
        shape = motion.shape[frames]
        rest = self.model.posed(np.zeros((1, 72)), shape[0], np.zeros((1, 3)))[0]
        moved = self.model.posed(motion.poses[frames], shape, motion.translation[frames])
        told = {"model": "smpl", "betas": shape[0].tolist()}
        body = StoredBody(to_metres(rest, 1.0, "y"), self.model.faces, shape=told)
        sequence = StoredSequence(
            name=name,
            body=name,
            motion=self.paths[name].stem,
            split=self.splits[name],
            body_positions=to_metres(moved, 1.0, "y").astype(np.float32),
        )
        return Part(body, None, sequence)
