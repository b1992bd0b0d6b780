"""Skinning weights of a garment: those of the body below it, made smooth over the cloth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, diags, eye
from scipy.sparse.linalg import splu

from drape.figure.skeleton import JOINTS
from drape.garment.anatomy import LEFT_LEG, RIGHT_LEG, Anatomy
from drape.garment.edges import edges_of
from drape.garment.figure_like import FigureLike

SMOOTHING = 0.04
"""Length over which weights are smoothed [m]."""
BONES = 4
"""Bones of one vertex."""


def garment_weights(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    figure: FigureLike,
    body: Anatomy,
    joined_legs: bool,
) -> tuple[Int[np.ndarray, "vertices 4"], Float[np.ndarray, "vertices 4"]]:
    """Bones and weights (sum 1) of each vertex.

    With ``joined_legs`` (dress, skirt) the cloth between the legs belongs to both of them, so that it does not tear
    when they part: the share of the left leg grows evenly with the angle around the body, from its right to its left.
    """
    bones, weights = figure.skin_weights(vertices)
    dense = np.zeros((len(vertices), len(JOINTS)))
    np.add.at(dense, (np.arange(len(vertices))[:, None], bones), weights)
    if joined_legs:
        dense = _share_legs(dense, vertices, body)
    dense = _smooth(dense, vertices, faces)
    chosen = np.argsort(-dense, axis=1, kind="stable")[:, :BONES]
    kept = np.take_along_axis(dense, chosen, axis=1)
    return chosen.astype(np.int64), kept / kept.sum(1, keepdims=True)


def _share_legs(dense: np.ndarray, vertices: np.ndarray, body: Anatomy) -> np.ndarray:
    left, right = ([JOINTS.index(name) for name in names] for names in (LEFT_LEG, RIGHT_LEG))
    middle = float(body.leg.origin[1])
    share = 0.5 + np.arctan2(vertices[:, :1], np.abs(vertices[:, 1:2] - middle)) / np.pi
    both = dense[:, left] + dense[:, right]
    dense = dense.copy()
    dense[:, left], dense[:, right] = both * share, both * (1.0 - share)
    return dense


def _smooth(values: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Two implicit steps of diffusion on the graph of the edges, each over about :data:`SMOOTHING`."""
    edges, _ = edges_of(faces)
    count = len(vertices)
    i, j = np.concatenate([edges, edges[:, ::-1]]).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), (count, count)).tocsr()
    laplacian = eye(count) - diags(1.0 / np.asarray(graph.sum(1)).ravel()) @ graph
    length = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1).mean()
    solver = splu((eye(count) + (SMOOTHING / length) ** 2 * laplacian).tocsc())
    return np.clip(solver.solve(solver.solve(values)), 0.0, None)
