"""Motions of a body: walk, turn, squat, wave, jump, dance, with random proportions and tempo."""

from __future__ import annotations

import difflib

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.figure.figure import Figure
from drape.figure.ground import stand
from drape.figure.kinematics import forward_kinematics
from drape.figure.motion_dance import dance
from drape.figure.motion_exercise import jump, squat
from drape.figure.motion_gait import turn, walk
from drape.figure.motion_wave import wave
from drape.figure.pose import Pose
from drape.figure.skeleton import REFERENCE_HEIGHT

_MAKERS = {"walk": walk, "turn": turn, "squat": squat, "wave": wave, "jump": jump, "dance": dance}
MOTIONS: tuple[str, ...] = tuple(_MAKERS)
START = 0.5
"""Seconds in which a motion gets under way from standing still."""


def make_motion(
    name: str, figure: Figure, frames: int, fps: float, rng: np.random.Generator
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Skinning transforms (rest to posed) of a motion that starts from standing still; the lowest vertex is at z = 0.

    Raises:
        DrapeError: an unknown motion, no frames, a rate that is not positive.
    """
    known_motion(name)
    if frames < 1 or not fps > 0:
        raise DrapeError(f"motion {name!r}: {frames} frames at {fps}/s; expected 1 or more and a rate above 0")
    pose: Pose = _MAKERS[name](_own_time(np.arange(frames) / fps), rng)
    scale = figure.stature / REFERENCE_HEIGHT
    transforms = forward_kinematics(figure.joints, pose.rotations(), np.zeros((frames, 3)))
    return stand(transforms, figure, fps, np.broadcast_to(pose.flight * scale, frames))


def known_motion(name: str) -> str:
    """``name`` itself.

    Raises:
        DrapeError: it is none of :data:`MOTIONS`.
    """
    if name not in _MAKERS:
        near = difflib.get_close_matches(name, MOTIONS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"choose one of {', '.join(MOTIONS)}"
        raise DrapeError(f"motion: there is no {name!r}; expected one of {', '.join(MOTIONS)}; {hint}")
    return name


def _own_time(time: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """Time of the motion, which runs slowly at first: the integral of a smooth step over :data:`START`."""
    u = np.clip(time / START, 0.0, 1.0)
    return START * (u**3 - 0.5 * u**4) + np.maximum(time - START, 0.0)
