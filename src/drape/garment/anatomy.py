"""Landmarks and parts of a figure that garments refer to, measured on its mesh in the rest pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.figure.skeleton import JOINTS
from drape.garment.figure_like import FigureLike
from drape.garment.loft import Loft, measure

REFERENCE_HEIGHT = 1.75
"""Lengths of garments below are for a person of this height [m]; they scale with the figure."""
SCAN = 0.004
"""Step of the search for armpit and crotch [m]."""

SPINE, THROAT, SKULL = "spine", "throat", "skull"
SHOULDER, WRIST, HIP, KNEE, ANKLE = "left_upper_arm", "left_hand", "left_thigh", "left_shin", "left_foot"
LEFTWARD, BACKWARD, FORWARD, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
TRUNK = ("pelvis", "spine", "chest")
LEFT_LEG, RIGHT_LEG = ("left_thigh", "left_shin", "left_foot"), ("right_thigh", "right_shin", "right_foot")
LEGS = (*LEFT_LEG[:2], *RIGHT_LEG[:2])
ARMS = ("left_upper_arm", "left_forearm", "right_upper_arm", "right_forearm")


@dataclass(frozen=True, eq=False)
class Anatomy:
    """Heights above the ground [m], joints [m], and the lofts of the parts."""

    scale: float
    """Height of the figure over :data:`REFERENCE_HEIGHT`."""
    front: float
    """-1 where the person faces -y, +1 where +y."""
    throat: float
    shoulder: Float[np.ndarray, "3"]
    """The left one, at positive x."""
    wrist: Float[np.ndarray, "3"]
    armpit: float
    waist: float
    hip: float
    crotch: float
    knee: float
    ankle: float
    throat_half: Float[np.ndarray, "2"]
    """Half widths of the throat, across and front to back [m]."""
    throat_centre: float
    """y of the middle of the throat [m]."""
    torso: Loft
    """From the armpits down to the ankles, both legs in one."""
    leg: Loft
    """The left one, from the crotch to the ankle; the right one is its mirror image."""
    arm: Loft
    """The left one, from the shoulder to the wrist."""


def bone_vertices(figure: FigureLike, *names: str) -> Float[np.ndarray, "vertices 3"]:
    """Vertices that follow one of these bones more than any other."""
    strongest = np.take_along_axis(figure.bones, figure.weights.argmax(1)[:, None], axis=1)[:, 0]
    return figure.rest_positions[np.isin(strongest, [JOINTS.index(name) for name in names])]


def joint(figure: FigureLike, name: str) -> Float[np.ndarray, "3"]:
    """Rest position of a joint [m]."""
    return figure.joints[JOINTS.index(name)]


def measure_anatomy(figure: FigureLike) -> Anatomy:
    """Landmarks from the joints, the vertices of the bones, and the signed distance along two vertical lines."""
    scale = float(np.ptp(figure.rest_positions[:, 2])) / REFERENCE_HEIGHT
    shoulder, wrist, ankle = (joint(figure, name) for name in (SHOULDER, WRIST, ANKLE))
    hip, knee = joint(figure, HIP), joint(figure, KNEE)
    under_arm, under_trunk = shoulder + [0.012 * scale, 0.0, 0.0], hip * [0.0, 1.0, 1.0] + [0.0, 0.0, 0.06 * scale]
    armpit = float(shoulder[2] - _way_out(figure, under_arm, np.array(DOWN), 0.20 * scale))
    crotch = float(under_trunk[2] - _way_out(figure, under_trunk, np.array(DOWN), 0.30 * scale))
    trunk = bone_vertices(figure, *TRUNK, *LEGS)
    torso = measure(trunk, np.array([0.0, 0.0, armpit]), np.array([0.0, 0.0, -1.0]), armpit - ankle[2])
    leg = measure(_left(bone_vertices(figure, *LEGS)), hip, ankle - hip, float(np.linalg.norm(ankle - hip)))
    arm = measure(
        _left(bone_vertices(figure, *ARMS)), shoulder, wrist - shoulder, float(np.linalg.norm(wrist - shoulder))
    )
    throat = joint(figure, THROAT)
    middle = 0.5 * (throat + joint(figure, SKULL))
    side, front, back = (_way_out(figure, middle, np.array(way), 0.2 * scale) for way in (LEFTWARD, FORWARD, BACKWARD))
    foot = bone_vertices(figure, ANKLE)
    return Anatomy(
        scale=scale,
        front=float(np.sign(foot[:, 1].mean() - ankle[1])),
        throat=float(throat[2]),
        shoulder=shoulder,
        wrist=wrist,
        armpit=armpit,
        waist=_waist(torso, armpit, float(joint(figure, SPINE)[2]), scale),
        hip=float(hip[2]),
        crotch=crotch,
        knee=float(knee[2]),
        ankle=float(ankle[2]),
        throat_half=np.array([side, 0.5 * (front + back)]),
        throat_centre=float(middle[1] + 0.5 * (back - front)),
        torso=torso,
        leg=leg,
        arm=arm,
    )


def _left(vertices: np.ndarray) -> np.ndarray:
    return vertices[vertices[:, 0] > 0.0]


def _way_out(figure: FigureLike, start: np.ndarray, direction: np.ndarray, longest: float) -> float:
    """Distance from ``start`` to where a line first leaves the body; ``longest`` if it never does [m]."""
    way = np.arange(SCAN, longest, SCAN)
    outside = figure.signed_distance(start + way[:, None] * direction) > 0.0
    return float(way[outside.argmax()]) if outside.any() else longest


def _waist(torso: Loft, armpit: float, spine: float, scale: float) -> float:
    """Height of the narrowest section near the lowest joint of the spine [m]."""
    heights = armpit - torso.along
    near = np.abs(heights - spine - 0.02 * scale) < 0.06 * scale
    girth = np.where(near, torso.half.sum(1), np.inf)
    return float(heights[girth.argmin()])
