"""Reads Biovision hierarchy (BVH) files: a skeleton of offsets, and channels over time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from drape.errors import DrapeError

CHANNELS = [axis + kind for kind in ("position", "rotation") for axis in "XYZ"]


@dataclass(frozen=True, eq=False)
class BvhFile:
    """Joints and ends (called ``name end``) in the order of the file, parents before children; units of the file."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Float[np.ndarray, "bvh_joints 3"]
    """From the parent, in its frame."""
    rotations: Float[np.ndarray, "bvh_frames bvh_joints 3 3"]
    """In the frame of the parent; identity at rest."""
    root: Float[np.ndarray, "bvh_frames 3"]
    """Place of the first joint."""
    frame_time: float
    """[s]"""

    def world(
        self, rotations: Float[np.ndarray, "some bvh_joints 3 3"], root: Float[np.ndarray, "some 3"]
    ) -> tuple[Float[np.ndarray, "some bvh_joints 3 3"], Float[np.ndarray, "some bvh_joints 3"]]:
        """Rotations and positions of all joints in the world."""
        turns, places = np.empty_like(rotations), np.empty(rotations.shape[:2] + (3,))
        for joint, parent in enumerate(self.parents):
            if parent < 0:
                turns[:, joint], places[:, joint] = rotations[:, joint], root
            else:
                turns[:, joint] = turns[:, parent] @ rotations[:, joint]
                places[:, joint] = places[:, parent] + turns[:, parent] @ self.offsets[joint]
        return turns, places


def load_bvh(path: Path) -> BvhFile:
    """Read and check a file.

    Raises:
        DrapeError: no such file, no BVH, a broken hierarchy, a wrong number of values, values that are not finite.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise DrapeError(f"{path}: cannot be read ({error.strerror}); expected a BVH file") from error
    hierarchy, found, motion = text.partition("MOTION")
    if not found or "HIERARCHY" not in hierarchy or "ROOT" not in hierarchy:
        raise DrapeError(f"{path}: is no BVH file; expected the sections HIERARCHY, with a ROOT, and MOTION")
    names, parents, offsets, channels = _read_hierarchy(hierarchy.split("HIERARCHY", 1)[1].split(), path)
    values, frame_time = _read_motion(motion, sum(len(own) for own in channels), path)
    rotations = np.tile(np.eye(3), (len(values), len(names), 1, 1))
    root = np.tile(np.array(offsets[0]), (len(values), 1))
    column = 0
    for joint, own in enumerate(channels):
        block = values[:, column : column + len(own)]
        column += len(own)
        turning = [index for index, channel in enumerate(own) if channel.endswith("rotation")]
        if turning:  # in the order of the channels, each about an axis that the ones before have turned
            order = "".join(own[index][0] for index in turning)
            rotations[:, joint] = _turn(order, block[:, turning])
        if joint == 0:
            for index, channel in enumerate(own):
                if channel.endswith("position"):
                    root[:, "XYZ".index(channel[0])] = block[:, index]
    return BvhFile(tuple(names), tuple(parents), np.array(offsets), rotations, root, frame_time)


def _turn(order: str, degrees: np.ndarray) -> np.ndarray:
    turn = Rotation.identity(len(degrees))
    for axis, angle in zip(order, degrees.T, strict=True):
        turn = turn * Rotation.from_rotvec(np.deg2rad(angle)[:, None] * np.eye(3)["XYZ".index(axis)])
    return turn.as_matrix()


def _read_hierarchy(words: list[str], path: Path) -> tuple[list[str], list[int], list[list[float]], list[list[str]]]:
    names, parents, open_joints = list[str](), list[int](), list[int]()
    offsets, channels = list[list[float]](), list[list[str]]()
    position = 0
    try:
        while position < len(words):
            word = words[position]
            if word in ("ROOT", "JOINT", "End"):
                last = words.index("{", position)
                name = " ".join(words[position + 1 : last])
                parent = open_joints[-1] if open_joints else -1
                names.append(name if word != "End" else f"{names[parent]} end")
                parents.append(parent)
                offsets.append([0.0, 0.0, 0.0])
                channels.append([])
                open_joints.append(len(names) - 1)
                position = last + 1
            elif word == "OFFSET":
                offsets[open_joints[-1]] = [float(number) for number in words[position + 1 : position + 4]]
                position += 4
            elif word == "CHANNELS":
                count = int(words[position + 1])
                channels[open_joints[-1]] = _checked_channels(words[position + 2 : position + 2 + count], path)
                position += 2 + count
            elif word == "}":
                open_joints.pop()
                position += 1
            else:
                raise ValueError(f"{word!r}")
    except (ValueError, IndexError) as error:
        if isinstance(error, DrapeError):
            raise
        where = " ".join(words[max(position - 2, 0) : position + 3])
        raise DrapeError(
            f"{path}: cannot read the hierarchy near '{where}'; expected ROOT, JOINT, End Site, OFFSET, CHANNELS"
        ) from error
    if open_joints or parents.count(-1) != 1 or not np.isfinite(offsets).all():
        raise DrapeError(f"{path}: the hierarchy is broken; expected one ROOT, matching braces and finite offsets")
    return names, parents, offsets, channels


def _checked_channels(own: list[str], path: Path) -> list[str]:
    own = [channel[:1].upper() + channel[1:].lower() for channel in own]
    unknown = [channel for channel in own if channel not in CHANNELS]
    if unknown or len(set(own)) < len(own):
        raise DrapeError(f"{path}: found the channels {' '.join(own)}; expected each once, of {', '.join(CHANNELS)}")
    return own


def _read_motion(text: str, columns: int, path: Path) -> tuple[np.ndarray, float]:
    lines = text.replace("\t", " ").split("\n", 3)
    try:
        words = text.replace(":", " : ").split()
        start = words.index("Time") + 2
        count, frame_time = int(words[words.index("Frames") + 2]), float(words[start])
        values = np.array(words[start + 1 :], dtype=np.float64)
    except (ValueError, IndexError) as error:
        raise DrapeError(
            f"{path}: cannot read the motion ({lines[1].strip() if len(lines) > 1 else 'empty'} ...); "
            "expected 'Frames: N', 'Frame Time: s' and then numbers"
        ) from error
    if count < 1 or columns < 1 or len(values) != count * columns:
        raise DrapeError(
            f"{path}: found {len(values)} values; expected {count} frames of {columns} channels, {count * columns} in "
            "all; the file is cut off or its CHANNELS are wrong"
        )
    if not (np.isfinite(values).all() and np.isfinite(frame_time) and frame_time > 0):
        bad = np.flatnonzero(~np.isfinite(values))
        found = f"frame {bad[0] // columns} is not finite" if len(bad) else f"a frame time of {frame_time} s"
        raise DrapeError(f"{path}: {found}; expected finite numbers and a frame time above 0; record it again")
    return values.reshape(count, columns), frame_time
