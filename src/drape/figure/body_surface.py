"""The surface of a body of the reference height: trunk, limbs, hands, feet and face, smoothly united."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.figure.implicit import Loft, ellipsoid, round_cone, smooth_union
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS, arm_direction, reference_skeleton

MIRROR = np.array([-1.0, 1.0, 1.0])
DOWN, LEFT, BACK = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def body_field(points: Float[np.ndarray, "points 3"], shape: FigureShape) -> Float[np.ndarray, " points"]:
    """Implicit surface of a body of the reference height, for points of the left half (x >= 0) [m]."""
    joints, ends = reference_skeleton(shape)
    place, end = dict(zip(JOINTS, joints, strict=True)), dict(zip(JOINTS, ends, strict=True))
    trunk = _trunk(points, shape)
    leg = smooth_union(_leg(points, place, shape), _foot(points, place, end), 0.035)
    other = smooth_union(_leg(points * MIRROR, place, shape), _foot(points * MIRROR, place, end), 0.035)
    body = smooth_union(trunk, smooth_union(leg, other, 0.012), 0.07)
    body = smooth_union(body, _shoulder(points, place, shape), 0.05)
    arm = smooth_union(_arm(points, place, shape), _hand(points, place), 0.02)
    body = smooth_union(body, arm, 0.04)
    return smooth_union(body, _top(points), 0.03)


def _profile(stations: list, *curves: list) -> list[np.ndarray]:
    return [np.array(stations, float), *(np.array(curve, float) for curve in curves)]


def _trunk(points: np.ndarray, shape: FigureShape) -> np.ndarray:
    z, width, depth, middle = _profile(
        [0.78, 0.82, 0.87, 0.92, 0.97, 1.03, 1.09, 1.16, 1.24, 1.31, 1.37, 1.415, 1.45, 1.475],
        [0.060, 0.118, 0.155, 0.169, 0.167, 0.153, 0.139, 0.138, 0.150, 0.159, 0.152, 0.125, 0.085, 0.060],
        [0.050, 0.080, 0.104, 0.113, 0.112, 0.104, 0.097, 0.099, 0.108, 0.112, 0.104, 0.090, 0.074, 0.060],
        [0.010, 0.012, 0.015, 0.016, 0.012, 0.006, 0.003, 0.002, 0.004, 0.008, 0.014, 0.018, 0.020, 0.020],
    )
    hip, waist = _bump(z, 0.92, 0.09), _bump(z, 1.05, 0.10)
    bust, shoulders = _bump(z, 1.28, 0.07), _bump(z, 1.36, 0.11)
    belly, chest = shape.belly - 1, shape.chest - 1
    width = width * (1 + (shape.hip - 1) * hip) * (1 + (shape.shoulder - 1) * shoulders) * (1 + 0.4 * belly * waist)
    depth = depth * (1 + 0.6 * (shape.hip - 1) * hip) * (1 + 0.7 * chest * bust) * (1 + 0.8 * belly * waist)
    middle = middle - 0.035 * belly * waist - 0.04 * chest * bust
    girth = shape.girth
    trunk = Loft(np.zeros(3), -DOWN, LEFT, z, width * girth, depth * girth, np.zeros_like(z), middle)(points)
    for side in (points, points * MIRROR):
        size = 0.046 * (1 + 1.8 * chest) * girth
        breast = np.array([0.068 * girth, -0.064 * girth - 0.045 * chest, 1.283])
        trunk = smooth_union(trunk, ellipsoid(side, breast, size * np.array([1.2, 0.8, 1.05])), 0.05)
        seat = np.array([0.072 * girth * shape.hip, 0.060 * girth, 0.905])
        half = np.array([0.076, 0.068, 0.088]) * girth * shape.hip
        trunk = smooth_union(trunk, ellipsoid(side, seat, half), 0.05)
    return trunk


def _bump(z: np.ndarray, middle: float, width: float) -> np.ndarray:
    return np.exp(-(((z - middle) / width) ** 2))


def _shoulder(points: np.ndarray, place: dict, shape: FigureShape) -> np.ndarray:
    thick = 0.5 + 0.5 * shape.girth * shape.limb
    throat = round_cone(points, np.array([0, 0.026, 1.42]), np.array([0, 0.012, 1.57]), 0.060 * thick, 0.053 * thick)
    slope = round_cone(
        points, np.array([0, 0.028, 1.452]), place["left_upper_arm"] + [0, 0.004, -0.006], 0.052 * thick, 0.050 * thick
    )
    return smooth_union(throat, slope, 0.06)


def _arm(points: np.ndarray, place: dict, shape: FigureShape) -> np.ndarray:
    along, width, depth, deep = _profile(
        [-0.05, -0.02, 0.03, 0.09, 0.15, 0.21, 0.265, 0.30, 0.345, 0.40, 0.46, 0.51, 0.545, 0.56],
        [0.030, 0.048, 0.055, 0.053, 0.050, 0.046, 0.041, 0.041, 0.044, 0.041, 0.034, 0.028, 0.027, 0.027],
        [0.030, 0.044, 0.051, 0.050, 0.047, 0.043, 0.038, 0.038, 0.040, 0.037, 0.029, 0.023, 0.021, 0.021],
        [0.000] * 14,
    )
    thick = shape.girth * shape.limb
    return Loft(place["left_upper_arm"], arm_direction(), BACK, along, width * thick, depth * thick, deep, deep)(points)


def _hand(points: np.ndarray, place: dict) -> np.ndarray:
    along, width, thickness, shift = _profile(
        [-0.015, 0.02, 0.05, 0.085, 0.115, 0.15, 0.175, 0.19],
        [0.026, 0.031, 0.039, 0.042, 0.040, 0.035, 0.027, 0.014],
        [0.021, 0.020, 0.019, 0.018, 0.016, 0.014, 0.012, 0.010],
        [0.0, -0.002, -0.004, -0.004, -0.003, 0.0, 0.003, 0.005],
    )
    wrist, arm = place["left_hand"], arm_direction()
    palm = Loft(wrist, arm, BACK, along, width, thickness, shift, np.zeros_like(along))(points)
    thumb = round_cone(points, wrist + 0.03 * arm - 0.020 * BACK, wrist + 0.095 * arm - 0.062 * BACK, 0.016, 0.011)
    return smooth_union(palm, thumb, 0.02)


def _leg(points: np.ndarray, place: dict, shape: FigureShape) -> np.ndarray:
    hip, ankle = place["left_thigh"], place["left_foot"]
    axis = (ankle - hip) / np.linalg.norm(ankle - hip)
    across = LEFT - (LEFT @ axis) * axis
    across /= np.linalg.norm(across)
    along, width, depth, deep = _profile(
        [-0.10, -0.04, 0.03, 0.10, 0.18, 0.27, 0.35, 0.41, 0.46, 0.52, 0.58, 0.65, 0.72, 0.78, 0.825],
        [0.030, 0.066, 0.082, 0.084, 0.079, 0.070, 0.059, 0.053, 0.052, 0.056, 0.057, 0.049, 0.039, 0.034, 0.034],
        [0.040, 0.078, 0.091, 0.090, 0.085, 0.076, 0.065, 0.060, 0.056, 0.058, 0.060, 0.052, 0.043, 0.038, 0.038],
        [0.0, 0.0, 0.002, 0.006, 0.011, 0.012, 0.010, 0.006, -0.003, -0.013, -0.018, -0.015, -0.008, -0.002, 0.0],
    )
    thick = shape.girth * shape.limb
    forwards = deep * np.sign(np.cross(axis, across) @ -BACK)
    outwards = 0.006 * _bump(along, 0.56, 0.07)
    return Loft(hip, axis, across, along, width * thick, depth * thick, outwards, forwards)(points)


def _foot(points: np.ndarray, place: dict, end: dict) -> np.ndarray:
    ankle, toe = place["left_foot"], end["left_foot"]
    axis = (toe - ankle) * [1, 1, 0]
    axis /= np.linalg.norm(axis)
    along, width, height = _profile(
        [-0.065, -0.055, -0.03, 0.02, 0.07, 0.11, 0.15, 0.185, 0.20],
        [0.020, 0.028, 0.033, 0.036, 0.042, 0.046, 0.043, 0.030, 0.016],
        [0.022, 0.030, 0.038, 0.044, 0.036, 0.027, 0.020, 0.015, 0.011],
    )
    across = np.cross(axis, DOWN)
    return Loft(ankle * [1, 1, 0], axis, across, along, width, height, np.zeros_like(along), height)(points)


def _top(points: np.ndarray) -> np.ndarray:
    skull = ellipsoid(points, np.array([0, 0.004, 1.656]), np.array([0.074, 0.095, 0.094]))
    face = ellipsoid(points, np.array([0, -0.030, 1.604]), np.array([0.058, 0.064, 0.078]))
    chin = round_cone(points, np.array([0, -0.020, 1.565]), np.array([0, -0.058, 1.552]), 0.040, 0.026)
    return smooth_union(smooth_union(skull, face, 0.05), chin, 0.04)
