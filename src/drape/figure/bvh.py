"""Motion capture for a figure: any BVH file, carried over to its skeleton."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from drape.errors import DrapeError
from drape.figure.bvh_file import BvhFile, load_bvh
from drape.figure.bvh_names import match_names
from drape.figure.figure import Figure
from drape.figure.kinematics import forward_kinematics, joint_positions
from drape.figure.retarget import NEXT, hinge_axis, rest_alignment
from drape.figure.skeleton import JOINTS, PARENTS
from drape.figure.skinning import pose_vertices

LOG = logging.getLogger(__name__)
UPRIGHT = {"y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), "z": np.eye(3)}
"""From the axes of the file to z up; a body that faces z with y up then faces -y."""
UNITS = {"metres": 0.8, "centimetres": 80.0, "inches": 31.5, "millimetres": 800.0, "units of 5.64 cm (CMU)": 14.2}
"""Length of a leg of 0.8 m."""
SOLE = 0.05
"""Part of the frames in which the lowest vertex may be below the ground."""


def read_bvh(
    path: str | Path,
    figure: Figure,
    frames: int,
    fps: float,
    start: float = 0.0,
    names: Mapping[str, str] | None = None,
    up: str | None = None,
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Skinning transforms (rest to posed) of ``frames`` frames at ``fps`` from ``start`` [s] of a recording.

    Every bone turns as in the file, relative to its direction at rest there; ``up`` is the vertical axis of the file,
    None for the one along which the trunk stands on average.
    The path of the hips is scaled with the length of the legs, starts above the origin and stands on z = 0.
    ``names`` (joint of the figure: joint of the file) helps where joints are not recognised.

    Raises:
        DrapeError: no BVH file, joints that are missing, a recording that is too short.
    """
    path = Path(path)
    if up not in (*UPRIGHT, None):
        raise DrapeError(f"{path}: up axis {up!r}; expected 'y' or 'z'")
    file = load_bvh(path)
    found = match_names(file.names, path, names)
    turns, places, scale = _retargeted(file, found, figure, UPRIGHT[up or _standing(file, found)], path)
    turns, places = _resample(turns, places, file.frame_time, frames, fps, start, path)
    local = turns.copy()
    parents = np.array(PARENTS)
    local[:, 1:] = np.swapaxes(turns[:, parents[1:]], -1, -2) @ turns[:, 1:]
    transforms = forward_kinematics(figure.joints, local, np.zeros((frames, 3)))
    hips = [JOINTS.index("left_thigh"), JOINTS.index("right_thigh")]
    shift = scale * places - joint_positions(figure.joints, transforms)[:, hips].mean(axis=1)
    shift[:, :2] -= shift[0, :2]
    transforms[..., :3, 3] += shift[:, None]
    lowest = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)[:, :, 2].min(axis=1)
    transforms[..., 2, 3] -= np.quantile(lowest, SOLE)
    return transforms


def _standing(file: BvhFile, found: dict[str, int]) -> str:
    """The axis along which shoulders are above hips, on average over the frames; y if neither is clear."""
    places = file.world(file.rotations, file.root)[1]
    parts = [
        places[:, [found[f"left_{part}"], found[f"right_{part}"]]].mean(axis=(0, 1)) for part in ("upper_arm", "thigh")
    ]
    trunk = parts[0] - parts[1]
    return "z" if trunk[2] > max(trunk[1], 0.0) else "y"


def _retargeted(
    file: BvhFile, found: dict[str, int], figure: Figure, upright: np.ndarray, path: Path
) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotations of our joints in the world, the middle of the hips in units of the file, and the scale of these."""
    turns, places = file.world(file.rotations, file.root)
    rest = file.world(np.tile(np.eye(3), (1, len(file.names), 1, 1)), np.zeros((1, 3)))[1][0] @ upright.T
    turns, places = upright @ turns @ upright.T, places @ upright.T
    scale = _scale(found, rest, figure, path)
    directions = {joint: _direction(file, found, rest, joint) for joint in found}
    directions = {joint: direction for joint, direction in directions.items() if direction.any()}
    aligned = rest_alignment(figure.directions, directions, _hinges(file, found, turns, places), _level(found, rest))
    ours = np.empty((len(turns), len(JOINTS), 3, 3))
    for joint, (name, parent) in enumerate(zip(JOINTS, PARENTS, strict=True)):
        ours[:, joint] = turns[:, found[name]] @ aligned[name] if name in found else ours[:, parent]
    return ours, places[:, [found["left_thigh"], found["right_thigh"]]].mean(axis=1), scale


def _scale(found: dict[str, int], rest: np.ndarray, figure: Figure, path: Path) -> float:
    """Length of the legs of the figure [m] over that in the file."""
    theirs = _leg_length({joint: rest[index] for joint, index in found.items()})
    ours = _leg_length(dict(zip(JOINTS, figure.joints, strict=True)))
    if not theirs > 0:
        raise DrapeError(f"{path}: legs without length at rest; expected OFFSETs of thigh, shin and foot")
    unit = min(UNITS, key=lambda name: abs(np.log(theirs / UNITS[name])))
    LOG.info("%s: legs of %.4g, taken as %s; scaled by %.4g to %.3g m", path, theirs, unit, ours / theirs, ours)
    return ours / theirs


def _leg_length(place: dict[str, np.ndarray]) -> float:
    sides, bones = ("left", "right"), (("thigh", "shin"), ("shin", "foot"))
    ends = [(place[f"{side}_{a}"], place[f"{side}_{b}"]) for side in sides for a, b in bones]
    return 0.5 * sum(float(np.linalg.norm(b - a)) for a, b in ends)


def _hinges(file: BvhFile, found: dict[str, int], turns: np.ndarray, places: np.ndarray) -> dict[str, np.ndarray]:
    """Axes of the elbows and knees that bend at all."""
    axes = {}
    for upper in (f"{side}_{part}" for side in ("left", "right") for part in ("upper_arm", "thigh")):
        below = found[_next(upper)]
        end = found.get(_next(_next(upper)), _first_child(file, below))
        first, second = places[:, below] - places[:, found[upper]], places[:, end] - places[:, below]
        axis = hinge_axis(turns[:, found[upper]], first, second)
        if axis is not None:
            axes[upper] = axis
    return axes


def _level(found: dict[str, int], rest: np.ndarray) -> np.ndarray:
    """Frame of the other's trunk at rest: left, back, up; upright if it stands upright."""
    left = rest[found["left_thigh"]] - rest[found["right_thigh"]]
    shoulders = 0.5 * (rest[found["left_upper_arm"]] + rest[found["right_upper_arm"]])
    up = shoulders - 0.5 * (rest[found["left_thigh"]] + rest[found["right_thigh"]])
    if up[2] > 0.7 * np.linalg.norm(up):
        up = np.array([0.0, 0.0, 1.0])
    up = up / np.linalg.norm(up)
    left = left - (left @ up) * up
    left = left / np.linalg.norm(left)
    return np.stack([left, np.cross(up, left), up], axis=1)


def _next(joint: str) -> str:
    side, _, part = joint.partition("_")
    return f"{side}_{NEXT.get(part, '')}"


def _first_child(file: BvhFile, joint: int) -> int:
    return file.parents.index(joint) if joint in file.parents else joint


def _direction(file: BvhFile, found: dict[str, int], rest: np.ndarray, joint: str) -> np.ndarray:
    """Of the bone at rest; zero where the file does not say."""
    end = found.get(_next(joint), _first_child(file, found[joint]))
    along = rest[end] - rest[found[joint]]
    length = np.linalg.norm(along)
    return along / length if length > 0 else np.zeros(3)


def _resample(
    turns: np.ndarray, places: np.ndarray, frame_time: float, frames: int, fps: float, start: float, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    have = np.arange(len(turns)) * frame_time
    wanted = start + np.arange(frames) / fps
    slack = 1e-3 * frame_time  # the file states it with few digits
    if frames < 1 or not fps > 0 or start < 0:
        raise DrapeError(f"{path}: {frames} frames at {fps}/s from {start} s; expected 1 or more, above 0, 0 or more")
    if len(turns) < 2 or wanted[-1] > have[-1] + slack:
        longest = max(int((have[-1] + slack - start) * fps) + 1, 0)
        raise DrapeError(
            f"{path}: has {len(turns)} frames, {have[-1]:.2f} s; expected {wanted[-1]:.2f} s for {frames} frames at "
            f"{fps:g} per second from {start:g} s; ask for at most {longest} frames or take a longer recording"
        )
    wanted = np.minimum(wanted, have[-1])
    resampled = [Slerp(have, Rotation.from_matrix(turns[:, joint]))(wanted).as_matrix() for joint in range(len(JOINTS))]
    return np.stack(resampled, axis=1), CubicSpline(have, places)(wanted)
