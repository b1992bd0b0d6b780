"""Points of a body that may come through a cloth: corners, sharp edges, and what is curved more than the cloth is fine.

A cloth that is asked at points l apart sinks in between them, on what is curved by a radius R by ``l²/(8R)``, on an
edge where the surface turns by β by ``(l/2) tan(β/2)``. Where that is a good part of the distance that contact keeps,
the body is asked as well: the point of the cloth that is nearest to such a point of the body takes part in contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float, Int
from scipy import sparse
from torch import Tensor
from torch.nn.functional import normalize

from drape.contact.coarseness import Turns, curvatures
from drape.geometry.nearest_faces import Frame, NearestFaces
from drape.geometry.surface_points import SurfacePoints
from drape.scene.obstacle import Obstacle

SHARE = 1.0
"""Of the thickness: a body is asked where the cloth would sink in by more, as then skin shows through."""
MOST = 200
"""Points along one edge of the body, at most: a floor may be two triangles of any size."""
SLANT = 1.5
"""Largest offset of the nearest point of the cloth beside a point of the body, in distances above or below it."""


@dataclass(frozen=True, eq=False)
class SharpPoints:
    """``b_q = (1 - s_q) x_i + s_q x_j`` on vertices and edges of a body, and the normals there."""

    ends: Int[Tensor, "points 2"]
    shares: Float[Tensor, " points"]
    face: Int[Tensor, " points"]
    """One that the point is on."""
    around: Int[Tensor, " some"]
    """The faces at the points."""
    weights: Tensor
    """Of the normals of ``around``, sparse ``points some``: of both at an edge, of all at a vertex by their angles."""

    @classmethod
    def of(cls, obstacle: Obstacle, spacing: float, thickness: float) -> SharpPoints | None:
        """Those of frame 0 that a cloth asked every ``spacing`` [m] needs; None where there are none.

        Along edges they are at most half of ``spacing`` apart, as edges of the cloth run between them, up to ``MOST``.
        """
        x, faces = obstacle.at(0), obstacle.welded_faces
        turns = Turns.of(x, faces)
        curvature, _ = curvatures(turns, len(x), faces)
        across = 0.5 * spacing * np.tan(0.5 * np.clip(turns.angle, 0.0, 0.9 * np.pi))
        angles = trimesh.triangles.angles(x[faces]).ravel()
        at_vertex = sparse.csr_array((angles, (faces.ravel(), np.arange(len(angles)) // 3)), (len(x), len(faces)))
        on_curved = np.minimum(spacing**2 * np.maximum(curvature, 0.0) / 8.0, 0.5 * spacing)
        is_sharp = np.maximum(on_curved, 0.5 * spacing * _steepness(x, faces)) > SHARE * thickness
        sharp = across > SHARE * thickness
        is_sharp[turns.edges[sharp]] = True
        vertices = np.flatnonzero(is_sharp)
        parts = np.clip(np.ceil(2.0 * turns.length[sharp] / spacing), 1, MOST + 1).astype(int)
        edge = np.repeat(np.flatnonzero(sharp), parts - 1)
        if not len(vertices) and not len(edge):
            return None
        shares = np.concatenate([np.arange(1, count) / count for count in parts]) if len(edge) else np.empty(0)
        beside = (np.ones(2 * len(edge)), turns.faces[edge].ravel(), 2 * np.arange(len(edge) + 1))
        weights = sparse.vstack([at_vertex[vertices], sparse.csr_array(beside, (len(edge), len(faces)))], format="csr")
        face = weights.indices[weights.indptr[:-1]].astype(np.int64)
        around = np.unique(weights.indices).astype(np.int64)
        weights = weights[:, around]
        places = torch.from_numpy(np.stack(weights.tocoo().coords).astype(np.int64))  # with the zeros that are stored
        return cls(
            torch.from_numpy(np.concatenate([np.stack([vertices, vertices], 1), turns.edges[edge]])),
            torch.from_numpy(np.concatenate([np.zeros(len(vertices)), shares])),
            torch.from_numpy(face),
            torch.from_numpy(around),
            torch.sparse_coo_tensor(places, torch.from_numpy(weights.data), weights.shape, check_invariants=False),
        )

    def __len__(self) -> int:
        return len(self.shares)

    def at(self, body: Float[Tensor, "body_vertices 3"]) -> Float[Tensor, "points 3"]:
        """Positions of the points for vertices of the body at ``body`` [m]."""
        first, second = body[self.ends.to(body.device)].unbind(1)
        return first + self.shares.to(body)[:, None] * (second - first)

    def frames(self, body: Float[Tensor, "body_vertices 3"], faces: Int[Tensor, "faces 3"]) -> Frame:
        """Their places, normals (0 where those of the faces around cancel), and tangents that turn with the body."""
        a, b, c = body[faces[self.around.to(faces.device)]].unbind(1)
        normal = normalize(torch.linalg.cross(b - a, c - a), dim=-1, eps=1e-30)
        normal = normalize(self.weights.to(body) @ normal, dim=-1, eps=1e-30)
        first, second = body[faces[self.face.to(faces.device), :2]].unbind(1)
        side = second - first
        tangent = normalize(side - (side * normal).sum(-1, keepdim=True) * normal, dim=-1, eps=1e-30)
        return Frame(self.at(body), torch.stack([tangent, torch.linalg.cross(normal, tangent)], 1), normal)

    def meeting(
        self,
        surface: SurfacePoints,
        x: Float[Tensor, "vertices 3"],
        x_next: Float[Tensor, "vertices 3"],
        faces: Int[Tensor, "faces 3"],
        body: Float[Tensor, "body_vertices 3"],
        body_next: Float[Tensor, "body_vertices 3"],
        distance: float,
    ) -> tuple[SurfacePoints, NearestFaces | None]:
        """``surface`` with the points of the cloth that are nearest to some of these, and what they are near to.

        Only where both are at most ``distance`` [m] apart at t, and as much as they approach each other on their ways
        to ``x_next`` and ``body_next``; where the point of the cloth is rather above or below than beside; and, if it
        is below, inside the body, not on the other side of it. What it is near to is the plane through the point of
        the body with the normal there. None where nothing is.
        """
        place, way = self.at(body), self.at(body_next) - self.at(body)
        most = distance + way.norm(dim=-1, keepdim=True) + (x_next - x).norm(dim=-1).amax()
        close = ((place >= x.amin(0) - most) & (place <= x.amax(0) + most)).all(-1).nonzero()[:, 0]
        nobody = surface.with_faces(close[:0], self.shares.new_empty(0, 3)), None
        if not len(close):
            return nobody
        start, end = self.frames(body, faces), self.frames(body_next, faces)
        none = torch.zeros(max(len(close), len(surface.faces)), dtype=torch.long, device=x.device)
        meshes = none[: len(close)], none[: len(surface.faces)]
        found = NearestFaces.find(start.point[close], meshes[0], surface.faces, meshes[1], x, x)
        close = close[found.points]
        corners, shares = surface.faces[found.faces], found.barycentric[..., None]
        place, relative = (shares * x[corners]).sum(1), (shares * (x_next - x)[corners]).sum(1) - way[close]
        arm, normal = place - start.point[close], start.normal[close]
        height, along = (normal * arm).sum(-1), (start.tangents[close] * arm[:, None]).sum(-1)
        chosen = found.distance.abs() <= distance - (relative * normal).sum(-1).clamp(max=0.0)
        chosen &= along.norm(dim=-1) <= SLANT * height.abs()
        chosen &= (height >= 0) | _inside(place, chosen & (height < 0), faces, body)
        chosen = chosen.nonzero()[:, 0]
        if not len(chosen):
            return nobody
        both = surface.with_faces(found.faces[chosen], found.barycentric[chosen])
        close, height = close[chosen], height[chosen]
        of_body = self.face.to(x.device)[close]
        ends, share = self.ends.to(x.device)[close], self.shares.to(x)[close, None]
        first, second = (faces[of_body] == end[:, None] for end in ends.unbind(1))
        near = NearestFaces(
            points=torch.arange(len(surface.vertices), len(both.vertices), device=x.device),
            faces=of_body,
            barycentric=(1.0 - share) * first + share * second,
            distance=height,
            along=along[chosen],
            height=height,
            end=Frame(*(part[close] for part in end)),
        )
        return both, near


def _steepness(x: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]) -> Float[np.ndarray, " vertices"]:
    """Least slope at which all faces fall from each vertex, beside the plane of its normal; 0 where it is no peak."""
    mesh = trimesh.Trimesh(x, faces, process=False)
    normal = mesh.vertex_normals
    along = np.einsum("fci,fi->fc", normal[faces], mesh.face_normals).clip(0.1, 1.0)
    least = np.full(len(x), np.inf)
    np.minimum.at(least, faces.ravel(), np.sqrt(1.0 / along.ravel() ** 2 - 1.0))
    rise = np.einsum("fci,fci->fc", normal[faces], x[np.roll(faces, -1, 1)] + x[np.roll(faces, 1, 1)] - 2.0 * x[faces])
    highest = np.full(len(x), -np.inf)
    np.maximum.at(highest, faces.ravel(), rise.ravel())
    return np.where(highest < 0.0, least, 0.0)


def _inside(
    points: Float[Tensor, "points 3"],
    asked: Bool[Tensor, " points"],
    faces: Int[Tensor, "faces 3"],
    body: Float[Tensor, "body_vertices 3"],
) -> Bool[Tensor, " points"]:
    """Mask of those ``asked`` about that are inside the body."""
    rows = asked.nonzero()[:, 0]
    if not len(rows):
        return asked
    mesh = torch.zeros(max(len(rows), len(faces)), dtype=torch.long, device=points.device)
    near = NearestFaces.find(points[rows], mesh[: len(rows)], faces, mesh[: len(faces)], body, body)
    return torch.zeros_like(asked).index_fill(0, rows[near.points[near.distance < 0]], True)
