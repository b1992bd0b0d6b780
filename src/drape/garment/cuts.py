"""Boundaries of garments: fields [m] that change sign at a collar, armhole, cuff or hem."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.garment.anatomy import Anatomy
from drape.garment.blending import smooth_maximum
from drape.garment.style import GarmentStyle

Points = Float[np.ndarray, "points 3"]
Field = Float[np.ndarray, " points"]


def above(points: Points, height: float) -> Field:
    """Above a horizontal hem."""
    return points[:, 2] - height


def below(points: Points, height: float) -> Field:
    """Below a waistband."""
    return height - points[:, 2]


def collar_half(body: Anatomy, style: GarmentStyle) -> Float[np.ndarray, "2"]:
    """Half widths of the collar's opening, across and front to back [m]."""
    return body.throat_half + style.ease + (0.02 + 0.035 * style.collar) * body.scale


def collar(points: Points, body: Anatomy, style: GarmentStyle) -> Field:
    """Outside a vertical tube around the throat with a rounded bottom, sheared so that it reaches deeper in front."""
    half = collar_half(body, style)
    depth = (0.03 + 0.06 * style.collar) * body.scale
    forward = body.front * (points[:, 1] - body.throat_centre)
    raised = points[:, 2] + (0.25 + 0.5 * style.collar) * forward
    bottom = np.maximum(body.throat - raised, 0.0) / depth
    rho = np.sqrt((points[:, 0] / half[0]) ** 2 + (forward / half[1]) ** 2 + bottom**2)
    return (rho - 1.0) * float(half.min())


def cuff(points: Points, body: Anatomy, share: float, side: Field) -> Field:
    """Towards the body from a plane across the arm, at ``share`` of the way from the shoulder to the wrist.

    The plane ends at some distance from the arm and before the trunk, which reaches to ``side`` [m] at each point.
    """
    mirrored = np.abs(points * [1.0, 0.0, 0.0]) + points * [0.0, 1.0, 1.0]
    axis = body.wrist - body.shoulder
    length = float(np.linalg.norm(axis))
    from_shoulder = mirrored - body.shoulder
    along = from_shoulder @ (axis / length)
    across = np.linalg.norm(from_shoulder - along[:, None] * (axis / length), axis=1)
    beside = np.maximum(across - 0.16 * body.scale, side + 0.02 * body.scale - mirrored[:, 0])
    return np.maximum(share * length - along, beside)


def armhole(points: Points, body: Anatomy, style: GarmentStyle, side: Field) -> Field:
    """Inside a tilted plane from the strap's outer edge to below the armpit; farther down all of the trunk.

    ``side`` [m] is how far the trunk reaches at each point.
    """
    scale = body.scale
    top = np.array([collar_half(body, style)[0] + style.strap, body.shoulder[2] + 0.03 * scale])
    armpit = float(body.torso.half[0, 0] + abs(body.torso.centre[0, 0]))
    low = np.array([max(armpit + style.ease, top[0] + 0.01), body.armpit - 0.045 * scale - style.ease])
    normal = np.array([top[1] - low[1], low[0] - top[0]])
    normal /= np.linalg.norm(normal)
    x, z = np.abs(points[:, 0]), points[:, 2]
    plane = (top[0] - x) * normal[0] + (top[1] - z) * normal[1]
    trunk = np.minimum(low[1] - z, side + 0.005 * scale - x)
    return smooth_maximum(plane, trunk, 0.05 * scale)
