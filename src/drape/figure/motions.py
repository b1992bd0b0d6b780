"""Motions of a body: walk, turn, squat, jump, wave, dance, with random proportions and tempo."""

from __future__ import annotations

import difflib

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from drape.errors import DrapeError
from drape.figure.figure import Figure
from drape.figure.ground import stand
from drape.figure.kinematics import forward_kinematics
from drape.figure.pose import HANGING, SIDES, Pose
from drape.figure.skeleton import REFERENCE_HEIGHT, SHIN, THIGH

HIP = {0: 30, 10: 26, 20: 18, 30: 8, 40: -2, 50: -10, 58: -6, 70: 14, 80: 27, 88: 32}
KNEE = {0: 5, 7: 11, 14: 17, 25: 13, 38: 6, 50: 13, 60: 38, 71: 64, 80: 52, 90: 17, 97: 4}
ANKLE = {0: 0, 7: -5, 20: 4, 40: 9, 48: 8, 56: -6, 63: -17, 71: -4, 80: 5, 92: 3}
"""Flexion in degrees against per cent of a stride from heel strike, after Winter (2009), natural cadence."""


def walk(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Walks forwards, 0.7 to 0.9 strides a second; arms and shoulders swing against the legs."""
    pose = Pose(len(time))
    rate, size, start = rng.uniform(0.70, 0.90), rng.uniform(0.8, 1.0), rng.uniform(0, 1)
    arms, bend, twist = rng.uniform(0.7, 1.3), rng.uniform(0.15, 0.45), rng.uniform(0.6, 1.2)
    stride = rate * time + start
    swing = np.cos(2 * np.pi * (stride - 0.02))
    pose.trunk("pelvis", twist=-0.09 * size * twist * swing, lean=0.05 * np.sin(2 * np.pi * stride))
    pose.trunk("spine", bend=0.04, lean=-0.05 * np.sin(2 * np.pi * stride), twist=0.05 * twist * swing)
    pose.trunk("chest", twist=0.16 * size * twist * swing)
    pose.trunk("skull", twist=-0.08 * twist * swing)
    for _, side in SIDES:
        own = stride + 0.25 * (1 - side)
        hip, knee = size * _gait(HIP, own), size * _gait(KNEE, own) + 0.03
        pose.leg(side, hip, knee, pitch=knee - hip - size * _gait(ANKLE, own))
        forwards = -side * swing
        pose.arm(side, HANGING, 0.38 * size * arms * forwards + 0.05, bend + 0.2 * arms * (1 + forwards) / 2)
    return pose


def turn(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Turns on the spot with small steps, one foot after the other, the arms lifted."""
    pose = Pose(len(time))
    direction, rate = rng.choice([-1.0, 1.0]), np.deg2rad(rng.uniform(85, 140))
    step, start = rng.uniform(0.50, 0.62), rng.uniform(0, 1)
    lift, lifted, sway = rng.uniform(0.25, 0.5), rng.uniform(0.0, 0.8), rng.uniform(0.1, 0.3)
    pace, phase = time / step + start, 2 * np.pi * time / (2 * step) + rng.uniform(0, 2 * np.pi)
    pose.trunk("pelvis", twist=direction * rate * time)
    pose.trunk("spine", twist=direction * 0.15 + 0.10 * np.sin(phase), lean=0.04 * np.sin(phase))
    pose.trunk("chest", twist=direction * 0.15 + 0.15 * np.sin(phase - 0.5))
    pose.trunk("skull", twist=direction * 0.2)
    for _, side in SIDES:
        own = pace + 0.25 * (1 - side)
        part = own % 1.0
        air = np.where(part < 0.5, np.sin(2 * np.pi * part) ** 2, 0.0)
        landed = np.floor(own) + 2 * np.clip(part, 0, 0.5) - np.sin(4 * np.pi * np.clip(part, 0, 0.5)) / (2 * np.pi)
        ahead = (landed - own - 0.25) * step  # of the foot, in time; between its steps it stays where it is
        pose.leg(side, 0.10 + lift * air, 0.18 + 1.7 * lift * air, spread=0.04, yaw=direction * rate * (time + ahead))
        pose.arm(side, HANGING * (1 - lifted) + sway * np.sin(phase * 0.8 + side), 0.25 * side * np.sin(phase), 0.45)
    return pose


def _gait(curve: dict[int, int], stride: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """A periodic spline through the values [rad]."""
    percent, degrees = np.array([*curve, 100]), np.array([*curve.values(), curve[0]])
    return CubicSpline(percent / 100, np.deg2rad(degrees), bc_type="periodic")(stride)


GRAVITY = 9.81
"""[m/s²]"""
INSTEP = 0.13
"""From the ankle to the ball of the foot [m]."""
STRAIGHT = 0.006
"""Depth below its stand with straight legs of a body [m]."""


def squat(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Down and up again, the arms stretched forwards for balance."""
    pose = Pose(len(time))
    tempo, size, start = rng.uniform(0.36, 0.48), rng.uniform(0.8, 1.0), rng.uniform(0, 2 * np.pi)
    apart, reach = rng.uniform(0.08, 0.2), rng.uniform(0.8, 1.4)
    depth = size * (1 - np.cos(2 * np.pi * tempo * time + start)) / 2
    pose.trunk("pelvis", bend=0.15 * depth)
    pose.trunk("spine", bend=0.32 * depth)
    pose.trunk("chest", bend=0.05 * depth)
    pose.trunk("skull", bend=-0.35 * depth)
    for _, side in SIDES:
        pose.leg(side, 0.03 + 1.08 * depth, 0.06 + 1.45 * depth, spread=apart + 0.12 * depth)
        pose.arm(side, HANGING, 0.05 + reach * depth, 0.3)
    return pose


def jump(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Jumps on the spot: from the crouch into a free flight of 0.07 to 0.15 m, and back into the crouch."""
    pose = Pose(len(time))
    rise, ground = rng.uniform(0.07, 0.15), rng.uniform(0.55, 0.70)
    lifted, apart = rng.uniform(0.2, 0.6), rng.uniform(0.05, 0.2)
    leave = np.sqrt(2 * GRAVITY * rise)
    air = 2 * leave / GRAVITY
    clock = (time + ground / 2) % (ground + air)
    aloft = clock - ground
    height = np.where(  # of the pelvis above standing on tiptoe [m], with the speed `leave` at both ends
        aloft < 0, -leave * ground / np.pi * np.sin(np.pi * clock / ground), (leave - GRAVITY / 2 * aloft) * aloft
    )
    tiptoe = 0.55 / (1 + np.exp(-(height + 0.06) / 0.03))
    length = height + INSTEP * (np.sin(0.55) - np.sin(tiptoe))
    bent = STRAIGHT + 0.02 * np.logaddexp(0.0, -length / 0.02)
    pose.flight = np.maximum(length - (STRAIGHT - bent), 0.0)
    up = (1 - np.cos(2 * np.pi * (clock - ground / 2) / (ground + air))) / 2
    crouch, flying = bent / 0.3, pose.flight / rise
    pose.trunk("pelvis", bend=0.15 * crouch)
    pose.trunk("spine", bend=0.30 * crouch)
    pose.trunk("skull", bend=-0.30 * crouch)
    knee, thigh = bend_of(bent)
    for _, side in SIDES:
        pose.leg(side, thigh, knee, pitch=tiptoe, spread=0.04 + apart * flying)
        pose.arm(side, HANGING - lifted * up, 0.6 * up - 0.4 * crouch, 0.35)
    return pose


def bend_of(drop: Float[np.ndarray, " frames"]) -> tuple[Float[np.ndarray, " frames"], Float[np.ndarray, " frames"]]:
    """Angles of knee and thigh that lower the hip by ``drop`` [m], the thigh taking 0.58 of the bend."""
    knee = np.linspace(0, 2.2, 400)
    lowered = THIGH * (1 - np.cos(0.58 * knee)) + SHIN * (1 - np.cos(0.42 * knee))
    bent = np.interp(drop, lowered, knee)
    return bent, 0.58 * bent


def wave(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Lifts one arm and waves with the forearm; the trunk sways over the planted feet."""
    pose = Pose(len(time))
    tempo, size, start = rng.uniform(0.85, 1.1), rng.uniform(0.8, 1.1), rng.uniform(0, 2 * np.pi)
    high, bend, waving = rng.uniform(0.9, 1.35), rng.uniform(0.5, 0.9), rng.choice([-1.0, 1.0])
    sway = 2 * np.pi * 0.5 * tempo * time + start
    up = (1 - np.cos(2 * np.pi * 0.40 * tempo * time)) / 2
    up = up**2 * (3 - 2 * up)
    pose.trunk("pelvis", lean=-0.08 * size * np.sin(sway), twist=0.10 * np.sin(0.7 * sway))
    pose.trunk("spine", lean=0.12 * size * np.sin(sway), bend=0.04)
    pose.trunk("chest", lean=0.10 * size * np.sin(sway - 0.4), twist=0.12 * np.sin(0.7 * sway - 0.3))
    pose.trunk("skull", lean=0.06 * np.sin(sway - 0.8), twist=0.15 * waving * up)
    fore = bend * up * (1.0 + 0.7 * np.sin(2 * np.pi * 1.15 * tempo * time))
    pose.arm(waving, HANGING * (1 - up) - high * up, 0.1, 0.25)
    name = "left" if waving > 0 else "right"
    pose.turns[f"{name}_forearm"] = pose.about("y", -waving * fore) * pose.turns[f"{name}_forearm"]
    pose.arm(-waving, HANGING, 0.22 * size * np.sin(sway), 0.4)
    for side in (1.0, -1.0):
        shift = np.sin(sway)
        pose.leg(side, 0.08 + 0.05 * side * shift, 0.14 + 0.09 * side * shift, spread=0.05 + 0.05 * side * shift)
    return pose


def dance(time: Float[np.ndarray, " frames"], rng: np.random.Generator) -> Pose:
    """Random sinusoids of all joints with periods of 1 to 2.5 s, legs stepping in opposition."""
    pose, size, beat = Pose(len(time)), rng.uniform(0.8, 1.1), rng.uniform(0.45, 0.75)

    def swing(amplitude: float) -> np.ndarray:
        part, frequency, start = rng.uniform(-1, 1), rng.uniform(0.4, 1.0), rng.uniform(0, 2 * np.pi)
        return size * amplitude * part * np.sin(2 * np.pi * frequency * time + start)

    pose.trunk("pelvis", swing(0.12), swing(0.15), swing(0.6))
    pose.trunk("spine", 0.05 + swing(0.1), swing(0.2), swing(0.2))
    pose.trunk("chest", swing(0.14), swing(0.18), swing(0.25))
    pose.trunk("skull", swing(0.15), swing(0.1), swing(0.3))
    step, start, lift, yaw = rng.uniform(0.15, 0.35), rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.6), swing(0.3)
    for _, side in SIDES:
        bent = lift * (1 + side * np.sin(2 * np.pi * beat * time + start)) / 2
        bent = 0.12 + bent**2
        pose.leg(side, bent + swing(0.06), 1.8 * bent, pitch=0.3 * bent, spread=0.08 + step * bent, yaw=yaw)
        pose.arm(side, 0.15 + swing(0.75), 0.2 + swing(0.6), 0.7 + swing(0.5))
    return pose


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
