"""A figure from a person of anny: in the rest pose of figures, closed and even, with the same joints."""

from __future__ import annotations

import gpytoolbox
import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

from drape.figure.anny_model import AnnyBody
from drape.figure.distance import SurfaceDistance
from drape.figure.figure import NEIGHBOURS, ROUNDS, Figure, check_edge
from drape.figure.kinematics import forward_kinematics, joint_positions
from drape.figure.level_set import level_surface, sample_mirrored
from drape.figure.phenotype import Phenotype
from drape.figure.retarget import NEXT, shortest_turn
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS, PARENTS, bone_directions
from drape.figure.skinning import pose_vertices, strongest

CELL = 0.007
"""Of the grid on which the surface is found [m]."""
CLOSED = 0.008
"""Clefts narrower than twice this are filled: between fingers and toes, in the mouth and behind the ears [m]."""
ROOM = 0.05
"""Between the body and the sides of the grid [m]."""


def make_person(phenotype: Phenotype, body: AnnyBody, edge: float = 0.0185) -> Figure:
    """A figure with edges of about ``edge`` [m] from ``body``, the person of these measures; deterministic.

    Its limbs at rest point where those of :class:`~drape.figure.shape.FigureShape` point, so that every motion and
    every recording turns both alike.

    Raises:
        DrapeError: edges outside 1 to 4 cm.
    """
    check_edge(edge)
    posed, joints = at_rest(body)
    dense, dense_faces = _closed(posed, body.faces)
    positions, faces = gpytoolbox.remesh_botsch(dense, dense_faces.astype(np.int32), ROUNDS, edge, True)
    bones, weights = strongest(_weights_near(positions, posed, body.weights))
    return Figure(
        shape=phenotype,
        stature=float(np.ptp(dense[:, 2])),
        directions=bone_directions(FigureShape()),
        rest_positions=positions,
        faces=faces.astype(np.int64),
        joints=joints,
        bones=bones,
        weights=weights,
        surface=SurfaceDistance(dense, dense_faces),
    )


def at_rest(body: AnnyBody) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "joints 3"]]:
    """Vertices and joints with the limbs as those of a figure at rest, soles at z = 0, the pelvis at x = y = 0."""
    turns = np.tile(np.eye(3), (len(JOINTS), 1, 1))
    wanted, ends = bone_directions(FigureShape()), _ends(body)
    for joint, end in ends.items():
        number = JOINTS.index(joint)
        above = turns[PARENTS[number]]
        along = above @ (end - body.joints[number])
        turns[number] = shortest_turn(along / np.linalg.norm(along), wanted[joint]) @ above
    parents = np.array(PARENTS)
    local = turns.copy()
    local[1:] = np.swapaxes(turns[parents[1:]], -1, -2) @ turns[1:]
    transforms = forward_kinematics(body.joints, local[None], np.zeros((1, 3)))
    posed = pose_vertices(body.positions, *strongest(body.weights), transforms)[0]
    joints = joint_positions(body.joints, transforms)[0]
    origin = np.array([joints[0, 0], joints[0, 1], posed[:, 2].min()])
    return posed - origin, joints - origin


def _ends(body: AnnyBody) -> dict[str, np.ndarray]:
    """Ends of the bones of the limbs, those of arms and legs before what hangs on them; feet stay level."""
    ends = {}
    for number, side in enumerate(("left", "right")):
        for part in ("upper_arm", "forearm", "thigh", "shin"):
            ends[f"{side}_{part}"] = body.joints[JOINTS.index(f"{side}_{NEXT[part]}")]
        ends[f"{side}_hand"] = body.knuckles[number]
    return ends


def _closed(positions: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The outer surface, dense, after a morphological closing: out by :data:`CLOSED`, and in again.

    What is hollow once the clefts are filled, such as the mouth, is filled, too.
    """
    low, high = positions.min(axis=0) - ROOM, positions.max(axis=0) + ROOM
    values, corner = sample_mirrored(lambda points: _distance(points, positions, faces) - CLOSED, low, high, CELL)
    grown, grown_faces = _outer(values, corner)
    values, corner = sample_mirrored(lambda points: _distance(points, grown, grown_faces) + CLOSED, low, high, CELL)
    return _outer(values, corner)


def _outer(values: np.ndarray, corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest piece of a level surface."""
    pieces = trimesh.Trimesh(*level_surface(values, corner, CELL), process=False).split(only_watertight=False)
    outer = max(pieces, key=lambda piece: len(piece.faces))
    return np.array(outer.vertices), np.array(outer.faces, np.int64)


def _distance(points: np.ndarray, positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Signed distance [m], negative inside of any piece."""
    squared = gpytoolbox.squared_distance(points, positions, F=faces, use_cpp=True)[0]
    inside = gpytoolbox.fast_winding_number(points, positions, faces) > 0.5
    return np.where(inside, -1.0, 1.0) * np.sqrt(squared)


def _weights_near(points: np.ndarray, positions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weights of the nearest vertices, averaged with the inverse squares of their distances."""
    distances, nearest = cKDTree(positions).query(points, k=NEIGHBOURS)
    share = 1.0 / np.maximum(distances, 1e-6) ** 2
    return np.einsum("pk,pkj->pj", share / share.sum(axis=1, keepdims=True), weights[nearest])
