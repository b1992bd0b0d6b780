"""Squats and jumps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.pose import HANGING, SIDES, Pose
from drape.figure.skeleton import SHIN, THIGH

GRAVITY = 9.81
"""[m/s²]"""
INSTEP = 0.13
"""From the ankle to the ball of the foot [m]."""
STRAIGHT = 0.006
"""Lowering of a standing body against that with straight legs [m]."""


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
