"""Dancing: every joint swings with its own random period."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.pose import SIDES, Pose


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
