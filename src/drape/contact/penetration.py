"""Penetration of a cloth into the body, and its removal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.surface_points import SurfacePoints
from drape.scene.obstacle import Obstacle


class Body(NamedTuple):
    """The bodies of a batch at one time."""

    faces: Int[Tensor, "body_faces 3"]
    mesh_of_face: Int[Tensor, " body_faces"]
    x: Float[Tensor, "body_vertices 3"]
    """[m]"""


class Penetration:
    """Parts of a cloth that are inside a closed body: its vertices, and the midpoints of its edges and of its faces.

    A coarse cloth over a convex body has faces inside it before a vertex is. The side of a point is that of all
    faces which share its closest point: see :meth:`NearestFaces.find`.
    """

    def __init__(self, mesh: ClothMesh, obstacle: Obstacle):
        batch = MeshBatch.from_meshes([mesh])
        self._points, self._obstacle = SurfacePoints.of(batch, per_edge=1, per_face=1), obstacle
        share = torch.ones(batch.num_vertices, dtype=torch.float64)
        everywhere = torch.arange(len(self._points.vertices))
        self.share = self._points.chosen(everywhere, len(share)).mass(share).numpy() / len(share)
        """Of the surface, that a point stands for; a vertex counts as much as its edges and its faces do."""

    def depth(self, x: Float[np.ndarray, "vertices 3"], frame: int) -> Float[np.ndarray, " points"]:
        """Depth of each point inside the body of a frame [m]; 0 where it is outside."""
        points = self._points.at(torch.tensor(x)).numpy()
        return np.maximum(-distances(points, self._obstacle, frame), 0.0)

    def inside(self, x: Float[np.ndarray, "vertices 3"], frame: int) -> float:
        """Share of the surface that is inside."""
        return float(self.share[self.depth(x, frame) > 0].sum())


def distances(
    points: Float[np.ndarray, "points 3"], obstacle: Obstacle, frame: int
) -> Float[np.ndarray, " points"]:
    """Signed distance of points from the body of a frame [m]; negative inside, infinite far behind open surfaces."""
    found = np.full(len(points), np.inf)
    near = _near(points, obstacle, frame)
    found[near.points.numpy()] = near.distance.numpy()
    return np.where(found < -_deepest(obstacle, frame), np.inf, found)


def push_out(
    x: Float[np.ndarray, "vertices 3"], obstacle: Obstacle, clearance: float
) -> Float[np.ndarray, "vertices 3"]:
    """Vertices inside the body of frame 0 moved to ``clearance`` [m] outside of the face nearest to them.

    The first frame of a garment that was fitted to another pose (docs/sources.md, HOOD): without it, contact would
    shoot out what is deep inside. Closed bodies only; what is far behind an open surface stays where it is.
    """
    near = _near(x, obstacle, 0)
    inside = ((near.distance < 0) & (near.distance >= -_deepest(obstacle, 0))).numpy()
    vertices = near.points.numpy()[inside]
    moved = x.copy()
    moved[vertices] = (near.end.point + clearance * near.end.normal).numpy()[inside]
    return moved


def _deepest(obstacle: Obstacle, frame: int) -> float:
    """Largest possible depth of a point inside a body [m]: half its largest extent."""
    return 0.5 * float(np.ptp(obstacle.at(frame), axis=0).max())


def _near(points: np.ndarray, obstacle: Obstacle, frame: int) -> NearestFaces:
    place, faces = torch.tensor(obstacle.at(frame)), torch.tensor(obstacle.welded_faces)
    mesh = torch.zeros(max(len(points), len(faces)), dtype=torch.long)
    return NearestFaces.find(torch.tensor(points), mesh[: len(points)], faces, mesh[: len(faces)], place, place)


def cleared(
    x: Float[Tensor, "vertices 3"], mesh_of_vertex: Int[Tensor, " vertices"], body: Body, clearance: float, reach: float
) -> Float[Tensor, "vertices 3"]:
    """Vertices nearer to the body than ``clearance`` [m], or inside it by less than ``reach`` [m], moved there."""
    near = NearestFaces.find(x, mesh_of_vertex, body.faces, body.mesh_of_face, body.x, body.x)
    close = (near.distance < clearance) & (near.distance > -reach)
    vertices = near.points[close]
    return x.index_copy(0, vertices, near.end.point[close] + clearance * near.end.normal[close])
