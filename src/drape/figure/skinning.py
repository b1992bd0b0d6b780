"""Linear blend skinning, and the smooth weights for it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from drape.figure.skeleton import JOINTS

BONES_PER_VERTEX = 4
FULLEST = {"pelvis": 0.15, "spine": 0.14, "chest": 0.15, "throat": 0.075, "skull": 0.07, "clavicle": 0.06,
           "upper_arm": 0.05, "forearm": 0.04, "hand": 0.035, "thigh": 0.08, "shin": 0.055, "foot": 0.04}  # fmt: skip
"""Thickness around each bone [m]: a vertex belongs to the bone that is nearest in units of it."""
SPREAD = 0.05
"""Reach of a joint's bend of the surface to either side of it [m]."""


def pose_vertices(
    rest: Float[np.ndarray, "vertices 3"],
    bones: Int[np.ndarray, "vertices 4"],
    weights: Float[np.ndarray, "vertices 4"],
    transforms: Float[np.ndarray, "frames joints 4 4"],
) -> Float[np.ndarray, "frames vertices 3"]:
    """Linear blend skinning: x_posed = Σ_k w_k (T_k x), with T_k the transform of bone k, rest to posed."""
    frames, count, num_joints = len(transforms), len(rest), transforms.shape[1]
    affine = np.concatenate([rest, np.ones((count, 1))], axis=1)
    values = (weights[:, :, None] * affine[:, None, :]).reshape(-1)
    columns = (bones[:, :, None] * 4 + np.arange(4)).reshape(-1)
    blend = sparse.csr_array(
        (values, columns, np.arange(count + 1) * 4 * bones.shape[1]), shape=(count, 4 * num_joints)
    )
    columns_of_frames = transforms[:, :, :3, :].transpose(1, 3, 0, 2).reshape(4 * num_joints, frames * 3)
    posed = blend @ np.asarray(columns_of_frames, dtype=np.float64)
    return np.ascontiguousarray(posed.reshape(count, frames, 3).transpose(1, 0, 2))


def smooth_weights(
    positions: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    starts: Float[np.ndarray, "joints 3"],
    ends: Float[np.ndarray, "joints 3"],
) -> Float[np.ndarray, "vertices joints"]:
    """Weights of all bones: one at the nearest bone, spread over the surface by two steps of implicit diffusion.

    ``starts`` and ``ends`` of the bones and ``positions`` are those of a body of the reference height [m].
    """
    nearest = _bone_distances(positions, starts, ends).argmin(axis=1)
    weights = np.eye(len(JOINTS))[nearest]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1).mean()
    count = len(positions)
    adjacency = sparse.csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    averages = sparse.diags_array(1.0 / adjacency.sum(axis=1)) @ adjacency
    identity = sparse.eye_array(count)
    solver = splu((identity + (SPREAD / length) ** 2 * (identity - averages)).tocsc())
    return solver.solve(solver.solve(weights))


def strongest(
    weights: Float[np.ndarray, "points joints"],
) -> tuple[Int[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
    """The four strongest bones of each point, and their weights, which add up to one.

    The fifth strongest is subtracted first, so that a bone comes and goes with weight zero.
    """
    order = np.argsort(-weights, axis=1, kind="stable")[:, : BONES_PER_VERTEX + 1]
    chosen = np.take_along_axis(weights, order, axis=1)
    kept = np.maximum(chosen[:, :-1] - chosen[:, -1:], 0.0)
    return order[:, :-1].astype(np.int64), kept / kept.sum(axis=1, keepdims=True)


def _bone_distances(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Distance to each bone in units of its thickness; a limb claims only its own side of the body."""
    along = ends - starts
    offset = points[:, None] - starts
    fraction = np.clip(np.einsum("vjc,jc->vj", offset, along) / (along**2).sum(axis=1), 0.0, 1.0)
    fullest = [FULLEST[name.removeprefix("left_").removeprefix("right_")] for name in JOINTS]
    distances = np.linalg.norm(offset - fraction[..., None] * along, axis=2) / fullest
    side = np.array([name.startswith("left_") * 1.0 - name.startswith("right_") * 1.0 for name in JOINTS])
    distances[side * points[:, :1] < 0] = np.inf
    distances[:, [name.endswith("clavicle") for name in JOINTS]] += 0.15
    return distances
