"""Walking, and turning on the spot."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from drape.figure.pose import HANGING, SIDES, Pose

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
