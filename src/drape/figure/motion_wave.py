"""Waving with one arm."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.pose import HANGING, Pose


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
