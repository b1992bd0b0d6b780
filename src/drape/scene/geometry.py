"""What an edge of a deformed cloth looks like: its length, its angles, its area; safe for every input.

All norms are ``sqrt(|v|² + ε²)`` with ε a millionth of the mesh's own size, so values and first and second derivatives
stay finite for zero-length edges, faces without area, folds, isolated vertices and normals along an edge, while the
relative error elsewhere is below 1e-12. Work in float64: length changes are 1e-6 of the coordinates (FACTS 10.1).
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

TINY = 1e-6
"""Relative size below which lengths, areas and projections count as zero."""


@runtime_checkable
class Topology(Protocol):
    """What the geometry of edges needs to know of a mesh."""

    faces: Int[Tensor, "faces 3"]
    edges: Int[Tensor, "edges 2"]
    edge_faces: Int[Tensor, "edges 2"]
    boundary: Bool[Tensor, " edges"]
    length_scale: Float[Tensor, ""]


def safe_norm(vector: Float[Tensor, "... dims"], smallest: Tensor | float) -> Float[Tensor, "..."]:
    """``sqrt(|v|² + smallest²)``: smooth everywhere, within smallest of the norm."""
    return (vector.square().sum(-1) + smallest**2).sqrt()


class EdgeGeometry:
    """The edges of positions ``x`` (``... vertices 3``, [m]); each quantity is computed when it is first asked for.

    Angles are pairs (cos, sin). With unit vertex normals n_i, n_j and the unit edge vector y (EUNet, appendix A.1;
    closed form of FACTS 1.3): twist α is the rotation about y that takes n_j into the half plane of n_i, bend β the
    difference of the elevations of n_i and n_j above the plane orthogonal to y. Both do not change with the order of
    the ends, with rotation or with translation; reversing the winding of all faces negates β, mirroring negates α.
    """

    def __init__(self, x: Float[Tensor, "... vertices 3"], mesh: Topology):
        self.x = x
        self.mesh = mesh

    @cached_property
    def vectors(self) -> Float[Tensor, "... edges 3"]:
        """Edge vectors, from the first end to the second [m]."""
        return self._end(self.x, 1) - self._end(self.x, 0)

    def _end(self, per_vertex: Tensor, end: int) -> Tensor:
        return per_vertex.index_select(-2, self.mesh.edges[:, end])

    @cached_property
    def length(self) -> Float[Tensor, "... edges"]:
        """Edge lengths [m]."""
        return safe_norm(self.vectors, TINY * self.mesh.length_scale)

    @cached_property
    def direction(self) -> Float[Tensor, "... edges 3"]:
        """Unit edge vectors, from the first end to the second."""
        return self.vectors / self.length[..., None]

    @cached_property
    def midpoint(self) -> Float[Tensor, "... edges 3"]:
        """Edge midpoints [m]."""
        return 0.5 * (self._end(self.x, 0) + self._end(self.x, 1))

    @cached_property
    def _face_normals(self) -> Float[Tensor, "... faces 3"]:
        corners = [self.x.index_select(-2, self.mesh.faces[:, k]) for k in range(3)]
        return torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])

    @cached_property
    def _double_areas(self) -> Float[Tensor, "... faces"]:
        return safe_norm(self._face_normals, TINY * self.mesh.length_scale**2)

    @cached_property
    def area(self) -> Float[Tensor, "... edges"]:
        """γ: sum of the areas of the faces at the edge [m²]; a boundary edge has one face (paper, after eq. 3)."""
        areas = 0.5 * self._double_areas
        first = areas.index_select(-1, self.mesh.edge_faces[:, 0])
        second = areas.index_select(-1, self.mesh.edge_faces[:, 1])
        return first + second.masked_fill(self.mesh.boundary, 0.0)

    @cached_property
    def vertex_normals(self) -> Float[Tensor, "... vertices 3"]:
        """Unit vertex normals: area-weighted mean of the adjacent face normals."""
        face_normals = self._face_normals
        total = torch.zeros_like(self.x)
        for k in range(3):
            total = total.index_add(-2, self.mesh.faces[:, k], face_normals)
        return total / safe_norm(total, TINY * self.mesh.length_scale**2)[..., None]

    @cached_property
    def _elevations(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Of both end normals: component along the edge and size of the component across it."""
        n_i, n_j = self._end(self.vertex_normals, 0), self._end(self.vertex_normals, 1)
        along = [(n * self.direction).sum(-1) for n in (n_i, n_j)]
        across = [
            safe_norm(n - s[..., None] * self.direction, TINY) for n, s in zip((n_i, n_j), along, strict=True)
        ]
        return along[0], across[0], along[1], across[1]

    @cached_property
    def twist(self) -> Float[Tensor, "... edges 2"]:
        """(cos α, sin α)."""
        n_i, n_j = self._end(self.vertex_normals, 0), self._end(self.vertex_normals, 1)
        s_i, _, s_j, _ = self._elevations
        cosine = (n_i * n_j).sum(-1) - s_i * s_j
        sine = (torch.linalg.cross(n_j, n_i) * self.direction).sum(-1)
        return _unit(torch.stack([cosine, sine], -1))

    @cached_property
    def bend(self) -> Float[Tensor, "... edges 2"]:
        """(cos β, sin β)."""
        s_i, c_i, s_j, c_j = self._elevations
        return _unit(torch.stack([c_i * c_j + s_i * s_j, s_i * c_j - c_i * s_j], -1))

    @cached_property
    def hinge(self) -> Float[Tensor, "... edges 2"]:
        """(cos θ, sin θ) of the dihedral angle between the two faces of the edge; (1, 0) where flat and on boundaries.

        Positive where the cloth bends away from its normals.
        """
        normals = self._face_normals / self._double_areas[..., None]
        first = normals.index_select(-2, self.mesh.edge_faces[:, 0])
        second = normals.index_select(-2, self.mesh.edge_faces[:, 1])
        sine = (torch.linalg.cross(first, second) * self.direction).sum(-1)
        return _unit(torch.stack([(first * second).sum(-1), sine], -1))


def _unit(pair: Float[Tensor, "... 2"]) -> Float[Tensor, "... 2"]:
    return pair / safe_norm(pair, TINY)[..., None]


def subtract_angles(angle: Float[Tensor, "... 2"], rest: Float[Tensor, "... 2"]) -> Float[Tensor, "... 2"]:
    """(cos, sin) of the difference of two angles given as (cos, sin)."""
    cosine = (angle * rest).sum(-1)
    sine = angle[..., 1] * rest[..., 0] - angle[..., 0] * rest[..., 1]
    return torch.stack([cosine, sine], -1)
