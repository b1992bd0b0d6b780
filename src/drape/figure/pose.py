"""Description of a motion: turns of the joints over time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from drape.figure.skeleton import JOINTS, arm_direction

SIDES = (("left", 1.0), ("right", -1.0))
"""Name of a side, and the sign of its x."""
HANGING = np.deg2rad(38)
"""From the arms at rest down to the sides."""
FORWARDS = np.array([0.0, -1.0, 0.0])

Angle = Float[np.ndarray, " frames"] | float
"""In radians, over the frames or constant."""


@dataclass(eq=False)
class Pose:
    """Turns of the joints, each in the frame of its parent, over all frames; a joint that is not named stays at rest.

    Angles are in radians. A body faces -y with z up, so a positive turn about x bends forwards, and one about z turns
    to the left; ``side`` is +1 left, -1 right.
    """

    frames: int
    turns: dict[str, Rotation] = field(default_factory=dict)
    flight: Angle = 0.0
    """Height of the lowest vertex above the ground, for a body of the reference height [m]."""

    def about(self, axis: str, angle: Angle) -> Rotation:
        """Turn about ``x``, ``y`` or ``z``."""
        return Rotation.from_rotvec(np.broadcast_to(angle, self.frames)[:, None] * np.eye(3)["xyz".index(axis)])

    def trunk(self, joint: str, bend: Angle = 0.0, lean: Angle = 0.0, twist: Angle = 0.0) -> None:
        """Turn a joint of the trunk: ``bend`` forwards, ``lean`` to the left, ``twist`` to the left."""
        self.turns[joint] = self.about("z", twist) * self.about("y", lean) * self.about("x", bend)

    def arm(self, side: float, lower: Angle, swing: Angle = 0.0, elbow: Angle = 0.0) -> None:
        """Turn the upper arm down by ``lower``, then forwards by ``swing``; bend the ``elbow`` forwards."""
        name = _name(side)
        across = np.cross(arm_direction() * [side, 1.0, 1.0], FORWARDS)
        across /= np.linalg.norm(across)
        swung, lowered = self.about("x", -np.asarray(swing)), self.about("y", side * np.asarray(lower))
        self.turns[f"{name}_upper_arm"] = swung * lowered
        self.turns[f"{name}_forearm"] = Rotation.from_rotvec(np.broadcast_to(elbow, self.frames)[:, None] * across)

    def leg(
        self, side: float, thigh: Angle, knee: Angle, pitch: Angle = 0.0, spread: Angle = 0.0, yaw: Angle = 0.0
    ) -> None:
        """Lift the ``thigh`` forwards, bend the ``knee``, ``pitch`` the toes down from the level.

        The whole leg is turned to the left by ``yaw`` and outwards by ``spread``. All are angles to the ground, not to
        the pelvis, whose turn must be given first.
        """
        name = _name(side)
        aside = self.about("y", -side * np.asarray(spread))
        lifted = self.about("x", -np.asarray(thigh))
        bent = self.about("x", knee)
        level = self.turns["pelvis"].inv() if "pelvis" in self.turns else self.about("x", 0.0)
        self.turns[f"{name}_thigh"] = level * self.about("z", yaw) * aside * lifted
        self.turns[f"{name}_shin"] = bent
        self.turns[f"{name}_foot"] = (aside * lifted * bent).inv() * self.about("x", pitch)

    def rotations(self) -> Float[np.ndarray, "frames joints 3 3"]:
        """Rotation matrices of all joints."""
        still = np.tile(np.eye(3), (self.frames, 1, 1))
        return np.stack([self.turns[name].as_matrix() if name in self.turns else still for name in JOINTS], axis=1)


def _name(side: float) -> str:
    return "left" if side > 0 else "right"
