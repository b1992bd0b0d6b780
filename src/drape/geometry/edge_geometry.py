"""Geometry of the edges of a deformed cloth: its length, its angles, its area; safe for every input.

All norms are ``sqrt(|v|² + ε²)`` with ε a millionth of the mesh's own size, so values and first and second derivatives
stay finite for zero-length edges, faces without area, folds, isolated vertices and normals along an edge, while the
relative error elsewhere is below 1e-12. Work in float64: length changes are 1e-6 of the coordinates
(docs/sources.md, Precision).

Vectors and pairs have their components in the last dimension, but lie component by component in memory: a sum over
three neighbouring numbers takes ten times as long as the sum of three columns, and training is made of such sums.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol, cast, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

TINY = 1e-6
"""Relative size below which lengths, areas and projections count as zero."""
DEGENERATE = 0.25
"""Below this cos² + sin² of a dihedral angle one of the two faces has no area, and there is no angle."""
HALF_TURN = 1e-5
"""Distance from -π within which a dihedral angle counts as π [rad]: above the rounding of single precision."""


@runtime_checkable
class Topology(Protocol):
    """Indices of a mesh for the geometry of its edges."""

    @property
    def faces(self) -> Int[Tensor, "faces 3"]: ...
    @property
    def edges(self) -> Int[Tensor, "edges 2"]: ...
    @property
    def edge_faces(self) -> Int[Tensor, "edges 2"]: ...
    @property
    def boundary(self) -> Bool[Tensor, " edges"]: ...
    @property
    def length_scale(self) -> Float[Tensor, ""]: ...


class MeshAtRest(Topology, Protocol):
    """A mesh that also knows the geometry of its rest positions."""

    @property
    def rest(self) -> EdgeGeometry: ...
    @property
    def rest_lengths(self) -> Float[Tensor, " edges"]: ...


def safe_norm(vector: Float[Tensor, "..."], smallest: Tensor | float, dim: int = -1) -> Float[Tensor, "..."]:
    """``sqrt(|v|² + smallest²)`` with the components in ``dim``: smooth everywhere, within smallest of the norm."""
    return (vector.square().sum(dim) + smallest**2).sqrt()


def _cross(a: Float[Tensor, "... 3"], b: Float[Tensor, "... 3"]) -> Float[Tensor, "... 3"]:
    return torch.linalg.cross(a.mT, b.mT, dim=-2).mT


def _pick(
    values: Float[Tensor, "... items dims"], numbers: Int[Tensor, "picked lists"]
) -> Float[Tensor, "... dims lists picked"]:
    """``values[..., numbers[:, k], :]`` for each list k, with the dimensions in the order in memory."""
    lists = numbers.mT
    index = lists.reshape(-1).expand(*values.mT.shape[:-1], -1)
    return values.mT.gather(-1, index).unflatten(-1, lists.shape)


def _lists(picked: Float[Tensor, "... dims lists picked"]) -> tuple[Tensor, ...]:
    """One tensor ``... picked dims`` for each list."""
    return tuple(one.mT for one in picked.unbind(-2))


class EdgeGeometry:
    """The edges of positions ``x`` (``... vertices 3``, [m]); each quantity is computed when it is first asked for.

    Angles are pairs (cos, sin). With unit vertex normals n_i, n_j and the unit edge vector y (EUNet, appendix A.1;
    docs/sources.md, Twist and bend): twist α is the rotation about y that takes n_j into the half plane of n_i, bend β
    the difference of the elevations of n_i and n_j above the plane orthogonal to y. Both do not change with the order
    of the ends, with rotation or with translation; reversing the winding of all faces negates β, mirroring negates α.
    """

    def __init__(self, x: Float[Tensor, "... vertices 3"], mesh: Topology):
        self.x = x
        self.mesh = mesh

    @cached_property
    def vectors(self) -> Float[Tensor, "... edges 3"]:
        """Edge vectors, from the first end to the second [m]."""
        first, second = self._ends
        return second - first

    @cached_property
    def _ends(self) -> tuple[Tensor, ...]:
        return _lists(_pick(self.x, self.mesh.edges))

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
        first, second = self._ends
        return 0.5 * (first + second)

    @cached_property
    def _face_normals(self) -> Float[Tensor, "... faces 3"]:
        first, second, third = _lists(_pick(self.x, self.mesh.faces))
        return _cross(second - first, third - first)

    @cached_property
    def _double_areas(self) -> Float[Tensor, "... faces"]:
        return safe_norm(self._face_normals, TINY * self.mesh.length_scale**2)

    @cached_property
    def area(self) -> Float[Tensor, "... edges"]:
        """γ: sum of the areas of the faces at the edge [m²]; a boundary edge has one face (paper, after eq. 3)."""
        first, second = _pick(0.5 * self._double_areas[..., None], self.mesh.edge_faces)[..., 0, :, :].unbind(-2)
        return first + second.masked_fill(self.mesh.boundary, 0.0)

    @cached_property
    def vertex_normals(self) -> Float[Tensor, "... vertices 3"]:
        """Unit vertex normals: area-weighted mean of the adjacent face normals."""
        corners = self.mesh.faces.mT.reshape(-1)
        for_corners = torch.cat(3 * [self._face_normals.mT], -1)
        total = self.x.new_zeros(self.x.mT.shape).scatter_add(-1, corners.expand_as(for_corners), for_corners).mT
        return total / safe_norm(total, TINY * self.mesh.length_scale**2)[..., None]

    @cached_property
    def _angles(self) -> Float[Tensor, "... 2 2 edges"]:
        """(cos α, sin α) and (cos β, sin β), in the order in memory."""
        n = _pick(self.vertex_normals, self.mesh.edges)
        n_i, n_j = _lists(n)
        y = self.direction.mT[..., None, :]
        along = (n * y).sum(-3)
        across = safe_norm(n - along[..., None, :, :] * y, TINY, dim=-3)
        (s_i, s_j), (c_i, c_j) = along.unbind(-2), across.unbind(-2)
        twist = (n_i * n_j).sum(-1) - s_i * s_j, (_cross(n_j, n_i) * self.direction).sum(-1)
        bend = c_i * c_j + s_i * s_j, s_i * c_j - c_i * s_j
        return _unit(torch.stack([*twist, *bend], -2).unflatten(-2, (2, 2)))

    @cached_property
    def twist(self) -> Float[Tensor, "... edges 2"]:
        """(cos α, sin α)."""
        return self._angles[..., 0, :, :].mT

    @cached_property
    def bend(self) -> Float[Tensor, "... edges 2"]:
        """(cos β, sin β)."""
        return self._angles[..., 1, :, :].mT

    @property
    def _at_rest(self) -> EdgeGeometry:
        return cast(MeshAtRest, self.mesh).rest

    @cached_property
    def stretch(self) -> Float[Tensor, "... edges"]:
        """Δl: the change of the length from ``mesh.rest_lengths`` [m]."""
        return self.length - cast(MeshAtRest, self.mesh).rest_lengths

    @cached_property
    def turned(self) -> Float[Tensor, "... edges 4"]:
        """(cos Δα, sin Δα, cos Δβ, sin Δβ): the change of the angles from those of ``mesh.rest``."""
        return subtract_angles(self._angles.mT, self._at_rest._angles.mT).mT.flatten(-3, -2).mT

    @cached_property
    def hinge(self) -> Float[Tensor, "... edges 2"]:
        """(cos θ, sin θ) of the dihedral angle between the two faces of the edge; (1, 0) where flat and on boundaries.

        Positive where the cloth bends away from its normals.
        """
        first, second = _lists(_pick(self._face_normals / self._double_areas[..., None], self.mesh.edge_faces))
        sine = (_cross(first, second) * self.direction).sum(-1)
        return _unit(torch.stack([(first * second).sum(-1), sine], -2)).mT

    @cached_property
    def hinge_change(self) -> Float[Tensor, "... edges"]:
        """Δθ, see :func:`hinge_change`, from ``mesh.rest``; 0 on boundaries."""
        return hinge_change(self.hinge, self._at_rest.hinge, self.mesh.boundary)


def _unit(pair: Float[Tensor, "... 2 edges"]) -> Float[Tensor, "... 2 edges"]:
    return pair / safe_norm(pair, TINY, dim=-2)[..., None, :]


def subtract_angles(angle: Float[Tensor, "... 2"], rest: Float[Tensor, "... 2"]) -> Float[Tensor, "... 2"]:
    """(cos, sin) of the difference of two angles given as (cos, sin)."""
    (c, s), (c_rest, s_rest) = angle.mT.unbind(-2), rest.mT.unbind(-2)
    return torch.stack([c * c_rest + s * s_rest, s * c_rest - c * s_rest], -2).mT


def hinge_change(
    hinge: Float[Tensor, "... edges 2"], rest: Float[Tensor, "edges 2"], without: Bool[Tensor, " edges"] | None = None
) -> Float[Tensor, "... edges"]:
    """Δθ, the change of the dihedral angle from that at ``rest`` [rad], of angles given as (cos, sin).

    0 where there is no angle: ``without``, and where one of the two faces has no area. In (-π, π]: an energy that does
    not know the sides of a fabric goes on continuously through half a turn, at its highest, where its force changes
    sides. A fold of exactly half a turn opens to one side, not each of its edges as the last digit falls: within
    ``HALF_TURN`` of -π, where Δθ is π less as much as it was more than -π, its slope stays that of π.
    """
    cosine, sine = subtract_angles(hinge, rest).mT.unbind(-2)
    flat = cosine.square() + sine.square() < DEGENERATE
    flat = flat if without is None else flat | without
    angle = torch.atan2(sine.masked_fill(flat, 0.0), cosine.masked_fill(flat, 1.0))
    fixed = angle.detach()
    return angle - (2.0 * fixed).masked_fill(fixed > HALF_TURN - torch.pi, 0.0)
