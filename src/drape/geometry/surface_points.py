"""Points of the surface of a cloth: its vertices, and between them points of its edges and faces."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.geometry.fixed_size import is_fixed
from drape.geometry.mesh_batch import MeshBatch

Weights = tuple[float, ...]
"""Of the corners of an edge or face."""


class Kind(NamedTuple):
    """The points of all vertices, of all edges, or of faces."""

    first: int
    """Row of the first of them among all points."""
    carriers: Int[Tensor, "carriers corners"]
    """The vertices that each edge or face has."""
    carrier: Int[Tensor, " points"]
    """The vertex, edge or face that each point lies on."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """``y_p = Σ_k w_pk x_k``: each vertex, then ``per_edge`` points inside each edge, then ``per_face`` in each face.

    A cloth whose vertices alone are asked lets bodies into its faces, and hangs too low by what a face sinks in: on
    a body of radius R by l²/(8R) between points that are l apart.
    """

    vertices: Int[Tensor, "points 3"]
    """Corners of the edge or face that a point lies on; repeated where there are fewer."""
    weights: Float[Tensor, "points 3"]
    """Of the corners; they sum to 1."""
    mass_shares: Float[Tensor, "points 3"]
    """Share of the mass of each corner that a point carries; over all points they sum to 1 for each vertex."""
    mesh_of_point: Int[Tensor, " points"]
    kinds: tuple[Kind, ...]
    faces: Int[Tensor, "faces 3"]
    """Of the cloths."""

    @classmethod
    def of(cls, mesh: MeshBatch, per_edge: int = 0, per_face: int = 0) -> SurfacePoints:
        """Of every cloth of a batch; each kind of points that is there carries the same share of the mass.

        Made once for a mesh: who remembers where the pieces of its points go in a matrix, knows them by their tensors.
        """
        return mesh.once(("surface", per_edge, per_face), lambda: cls._made(mesh, per_edge, per_face))

    @classmethod
    def _made(cls, mesh: MeshBatch, per_edge: int, per_face: int) -> SurfacePoints:
        own = torch.arange(mesh.num_vertices, device=mesh.faces.device)[:, None]
        inside: list[Weights] = [((k + 1) / (per_edge + 1), 1 - (k + 1) / (per_edge + 1)) for k in range(per_edge)]
        kinds: list[tuple[Tensor, list[Weights]]]
        kinds = [(own, [(1.0,)]), (mesh.edges, inside), (mesh.faces, IN_FACE[per_face])]
        there = [(carriers, of_kind) for carriers, of_kind in kinds if of_kind]
        rows: list[tuple[Tensor, Tensor, Tensor]] = []
        found: list[Kind] = []
        for carriers, of_kind in there:
            each = torch.arange(len(carriers), device=carriers.device).repeat(len(of_kind))
            found.append(Kind(sum(len(row[0]) for row in rows), carriers, each))
            count = carriers.reshape(-1).bincount(minlength=mesh.num_vertices).clamp(min=1)
            share = 1.0 / (len(there) * len(of_kind) * count[carriers].double())
            for one in of_kind:
                weight = torch.tensor(one, dtype=torch.float64, device=share.device)
                rows.append((carriers, weight.expand(len(carriers), -1), share))
        vertices, weights, shares = (torch.cat([_padded(row[part], part == 0) for row in rows]) for part in range(3))
        dtype = mesh.rest_lengths.dtype
        mesh_of_point = mesh.mesh_of_vertex[vertices[:, 0]]
        return cls(vertices, weights.to(dtype), shares.to(dtype), mesh_of_point, tuple(found), mesh.faces)

    def with_faces(
        self, faces: Int[Tensor, " further"], barycentric: Float[Tensor, "further 3"]
    ) -> SurfacePoints:
        """The same and further points in some of the faces, which carry as much together as another kind would."""
        at_vertex = self.faces.reshape(-1).bincount().clamp(min=1)
        alike = faces.bincount(minlength=len(self.faces))[faces]
        vertices = self.faces[faces]
        shares = 1.0 / (len(self.kinds) * at_vertex[vertices] * alike[:, None])
        return SurfacePoints(
            torch.cat([self.vertices, vertices]),
            torch.cat([self.weights, barycentric.to(self.weights)]),
            torch.cat([self.mass_shares, shares.to(self.mass_shares)]),
            torch.cat([self.mesh_of_point, self.mesh_of_point[vertices[:, 0]]]),
            (*self.kinds, Kind(len(self.vertices), self.faces, faces)),
            self.faces,
        )

    def at(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "points 3"]:
        """Positions of the points for vertices at ``x`` [m]."""
        return (x[self.vertices] * self.weights.to(x)[..., None]).sum(1)

    def chosen(self, points: Int[Tensor, " chosen"], num_vertices: int) -> ChosenPoints:
        """Some of the points, in ascending order."""
        return ChosenPoints(self, points, num_vertices)


class ChosenPoints:
    """Some of the points of a surface, asked again and again: ``y = W x`` and ``f = Wᵀ f_y``.

    By sparse matrices on a CPU; on a device they would take longer to make than they save.
    """

    def __init__(self, surface: SurfacePoints, points: Int[Tensor, " chosen"], num_vertices: int):
        self.surface, self.points = surface, points
        self.vertices, self.weights = surface.vertices[points], surface.weights[points]
        self.first_vertex, self._num_vertices = self.vertices[:, 0], num_vertices
        self._is_fixed = is_fixed(points.device)

    @cached_property
    def _matrices(self) -> tuple[Tensor, Tensor]:
        """W and Wᵀ."""
        rows = torch.arange(len(self.points), device=self.points.device)[:, None].expand(-1, 3).reshape(-1)
        place = torch.stack([rows, self.vertices.reshape(-1)])
        used = (self.weights != 0).reshape(-1)
        entries = place[:, used], self.weights.reshape(-1)[used], (len(self.points), self._num_vertices)
        matrix = torch.sparse_coo_tensor(*entries, check_invariants=False).coalesce()
        with warnings.catch_warnings():  # this layout is in beta, and ten times as fast as the other
            warnings.simplefilter("ignore", UserWarning)
            return matrix.to_sparse_csr(), matrix.T.coalesce().to_sparse_csr()

    def at(self, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "chosen 3"]:
        """Positions of the points for vertices at ``x`` [m]."""
        if self._is_fixed:
            return (x[self.vertices] * self.weights.to(x)[..., None]).sum(1)
        return self._matrices[0].to(x.dtype) @ x

    def spread(self, force: Float[Tensor, "chosen 3"]) -> Float[Tensor, "vertices 3"]:
        """Forces on points as forces on vertices [N]."""
        if self._is_fixed:
            shares = (self.weights.to(force)[..., None] * force[:, None]).flatten(0, 1)
            return force.new_zeros(self._num_vertices, 3).index_add(0, self.vertices.reshape(-1), shares)
        return self._matrices[1].to(force.dtype) @ force

    def mass(self, mass: Float[Tensor, " vertices"]) -> Float[Tensor, " chosen"]:
        """Mass of each of the points, of the ``mass`` of the vertices [kg]."""
        return (mass[self.vertices] * self.surface.mass_shares[self.points].to(mass)).sum(-1)


IN_FACE: dict[int, list[Weights]] = {
    0: [],
    1: [(1 / 3,) * 3],
    3: [(2 / 3, 1 / 6, 1 / 6), (1 / 6, 2 / 3, 1 / 6), (1 / 6, 1 / 6, 2 / 3)],
}
"""Barycentric coordinates of the points in a face, by their number."""


def _padded(rows: Tensor, repeat: bool) -> Tensor:
    """Three columns: the first one again where there are fewer, or zeros."""
    missing = 3 - rows.shape[1]
    return torch.cat([rows, *([rows[:, :1] if repeat else torch.zeros_like(rows[:, :1])] * missing)], 1)
