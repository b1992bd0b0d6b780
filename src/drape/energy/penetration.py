"""How much of a cloth is inside the body, and getting it out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.nearest_faces import NearestFaces
from drape.energy.step import Step


class Body(NamedTuple):
    """The bodies of a batch at one time."""

    faces: Int[Tensor, "body_faces 3"]
    mesh_of_face: Int[Tensor, " body_faces"]
    x: Float[Tensor, "body_vertices 3"]
    """[m]"""


def faces_at_end(x_next: Float[Tensor, "vertices 3"], step: Step, search_range: float) -> NearestFaces:
    """The faces of the body at t + dt nearest to ``x_next``, at most ``search_range`` [m] away."""
    body = step.obstacle
    return NearestFaces.find(
        x_next, step.mesh.mesh_of_vertex, body.faces, body.mesh_of_face, body.x_next, body.x_next, search_range
    )


def push_out(
    x: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    clearance: float,
    search_range: float,
) -> Float[np.ndarray, "vertices 3"]:
    """Vertices inside the body moved to ``clearance`` [m] outside of the face nearest to them, the others as they are.

    The first frame of a garment that was fitted to another pose (FACTS 2.5): without it, contact would shoot out what
    is deep inside. Closed bodies only; a vertex more than ``search_range`` [m] inside stays where it is.
    """
    near = _near(x, faces, body, search_range)
    inside = (near.distance < 0).numpy()
    vertices = near.vertices.numpy()[inside]
    moved = x.copy()
    moved[vertices] = (near.end.point + clearance * near.end.normal).numpy()[inside]
    return moved


def inside_fraction(
    x: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    search_range: float,
) -> float:
    """Share of the vertices that are inside the body."""
    return float((depth_inside(x, faces, body, search_range) > 0).mean())


def depth_inside(
    x: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    search_range: float,
) -> Float[np.ndarray, " vertices"]:
    """How far each vertex is inside a closed body [m]; 0 where it is outside, or deeper than ``search_range`` [m].

    The signed distance to the nearest face, its sign from all faces that share the closest point: see
    :meth:`NearestFaces.find`.
    """
    near = _near(x, faces, body, search_range)
    depth = np.zeros(len(x))
    depth[near.vertices.numpy()] = near.distance.clamp(max=0.0).abs().numpy()
    return depth


def _near(x: np.ndarray, faces: np.ndarray, body: np.ndarray, search_range: float) -> NearestFaces:
    points, places, triangles = torch.tensor(x), torch.tensor(body), torch.tensor(faces)
    zeros = torch.zeros(max(len(points), len(triangles)), dtype=torch.long)
    meshes = zeros[: len(points)], zeros[: len(triangles)]
    return NearestFaces.find(points, meshes[0], triangles, meshes[1], places, places, search_range)


def cleared(
    x: Float[Tensor, "vertices 3"], mesh_of_vertex: Int[Tensor, " vertices"], body: Body, clearance: float, reach: float
) -> Float[Tensor, "vertices 3"]:
    """Vertices nearer to the body than ``clearance`` [m], or inside, moved there; looked for up to ``reach`` [m]."""
    near = NearestFaces.find(x, mesh_of_vertex, body.faces, body.mesh_of_face, body.x, body.x, reach)
    close = near.distance < clearance
    vertices = near.vertices[close]
    return x.index_copy(0, vertices, near.end.point[close] + clearance * near.end.normal[close])

