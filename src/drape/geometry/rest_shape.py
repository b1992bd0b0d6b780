"""Rest shape of faces and of the hinges between them."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from drape.geometry.corners import Corners, cross, dot
from drape.geometry.edge_geometry import TINY, hinge_change
from drape.geometry.fixed_size import is_fixed

FADED = 1e-2
"""Share of its area at rest below which a face fades out of the hinges at its edges."""


class RestFaces(NamedTuple):
    """Faces at rest: ``D_m⁻¹ = [[a, b], [0, d]]`` [1/m] of the rest edges in the plane of the face, and areas.

    With the edges ``D_s = [x1 - x0, x2 - x0]`` the deformation gradient is ``F = D_s D_m⁻¹`` (3 x 2), the first axis
    of the plane along the first edge.
    """

    corners: Corners
    a: Float[Tensor, " faces"]
    b: Float[Tensor, " faces"]
    d: Float[Tensor, " faces"]
    area: Float[Tensor, " faces"]
    """[m²]"""

    @classmethod
    def of(cls, rest_positions: Float[Tensor, "vertices 3"], faces: Int[Tensor, "faces 3"]) -> RestFaces:
        """Of faces that have an area (``ClothMesh`` accepts no others)."""
        corners = Corners.of(faces)
        x0, x1, x2 = corners.gather(rest_positions)
        first, second = x1 - x0, x2 - x0
        double_area = dot(cross(first, second), cross(first, second)).sqrt()
        length = dot(first, first).sqrt()
        height = double_area / length
        along = dot(first, second) / length
        return cls(corners, 1.0 / length, -along / (length * height), 1.0 / height, 0.5 * double_area)


class RestHinges(NamedTuple):
    """The interior edges at rest with the four vertices that span them: edge from, edge to, opposite, opposite.

    The third corner belongs to the face along which the edge runs forwards.
    """

    corners: Corners
    angle: Float[Tensor, "hinges 2"]
    """(cos, sin) of the rest angle; (1, 0) where flat, sin positive where the cloth bends away from its normals."""
    shape: HingeShape
    """At rest."""

    @classmethod
    def of(
        cls,
        rest_positions: Float[Tensor, "vertices 3"],
        faces: Int[Tensor, "faces 3"],
        edges: Int[Tensor, "hinges 2"],
        edge_faces: Int[Tensor, "hinges 2"],
    ) -> RestHinges:
        """Of interior ``edges`` with their two faces."""
        opposite = faces[edge_faces].sum(-1) - edges.sum(-1, keepdim=True)
        corners = Corners.of(torch.cat([edges, opposite], -1))
        shape = HingeShape(corners.gather(rest_positions))
        return cls(corners, shape.angle / shape.angle.norm(dim=-1, keepdim=True), shape)

    @property
    def area(self) -> Float[Tensor, " hinges"]:
        """Area of the two faces at rest [m²]."""
        return 0.5 * (self.shape.double_area1 + self.shape.double_area2)


class HingeShape:
    """Edge, normals and angle of hinges whose corners stand at ``x``; finite for every input.

    Lengths and areas count as zero below ``TINY`` times those of the same hinges at ``rest``; None: these are at rest.
    """

    def __init__(self, x: Float[Tensor, "4 3 hinges"], rest: HingeShape | None = None):
        start, end, third, fourth = x
        self.edge = end - start
        self.arm1 = third - start
        self.arm2 = fourth - start
        self.rest = rest
        self.length: Tensor = _size(self.edge, None if rest is None else rest.length)
        self.normal1 = cross(self.edge, self.arm1)
        self.normal2 = cross(self.arm2, self.edge)
        self.double_area1: Tensor = _size(self.normal1, None if rest is None else rest.double_area1)
        self.double_area2: Tensor = _size(self.normal2, None if rest is None else rest.double_area2)
        both = self.double_area1 * self.double_area2
        # sin: e · (n1 x n2) with n2 = arm2 x e and n1 orthogonal to e
        pair = dot(self.normal1, self.normal2), -dot(self.normal1, self.arm2) * self.length
        self.angle = (torch.stack(pair) / both).mT
        """(cos θ, sin θ), component by component in memory."""

    def angle_slopes(self, factor: Float[Tensor, " hinges"]) -> Float[Tensor, "12 hinges"]:
        """``factor ∂θ/∂x``: the far corners move θ by ``-n/h``, n being the unit normals and h the heights."""
        tilt1 = factor / (self.length * self.double_area1.square())
        tilt2 = factor / (self.length * self.double_area2.square())
        square = self.length.square()
        third, fourth = -(square * tilt1) * self.normal1, -(square * tilt2) * self.normal2
        foot1, foot2 = dot(self.arm1, self.edge) * tilt1, dot(self.arm2, self.edge) * tilt2
        end = foot1 * self.normal1 + foot2 * self.normal2
        return torch.cat([-(end + third + fourth), end, third, fourth])

    def change(
        self, rest_angle: Float[Tensor, "hinges 2"], without: Bool[Tensor, " hinges"] | None = None
    ) -> tuple[Float[Tensor, " hinges"], Float[Tensor, " hinges"]]:
        """``s Δθ`` [rad], which a law on hinges sees, and Δθ itself, see :func:`hinge_change`; 0 where ``without``.

        A face without area has no side, and one that rounding gives an area may be on either: s fades a hinge out with
        the area A of its two faces, ``s = Π f(A/(FADED A_rest))``, ``f(t) = t² (3 - 2t)``, 1 from ``t = 1`` on.
        """
        if not self._fades:
            angle = hinge_change(self.angle, rest_angle.to(self.angle), without)
            return angle, angle
        size = self.angle.detach().norm(dim=-1, keepdim=True)
        cosine, sine = self.angle.unbind(-1)
        pair = torch.stack([cosine + (size[..., 0] == 0.0), sine]).mT  # 1 and 0 where there is no angle
        angle = hinge_change(pair / torch.where(size > 0.0, size, 1.0), rest_angle.to(pair), without)
        return self._share(1) * self._share(2) * angle, angle

    @cached_property
    def _fades(self) -> bool:
        """Whether any face does; a GPU is not asked."""
        if is_fixed(self.edge.device):
            return True
        return any(bool((getattr(self, f"double_area{face}") < self._faded(face)).any()) for face in (1, 2))

    def _share(self, face: int) -> Float[Tensor, " hinges"]:
        t = self._part(face)
        return t.square() * (3.0 - 2.0 * t)

    def _part(self, face: int) -> Float[Tensor, " hinges"]:
        """``A/(FADED A_rest)``, at most 1."""
        return (getattr(self, f"double_area{face}") / self._faded(face)).clamp(max=1.0)

    def _faded(self, face: int) -> Float[Tensor, " hinges"]:
        """Twice the area from which on a face counts whole [m²]."""
        return FADED * getattr(self.rest, f"double_area{face}").to(self.edge)

    def change_slopes(
        self, factor: Float[Tensor, " hinges"], angle: Float[Tensor, " hinges"]
    ) -> Float[Tensor, "12 hinges"]:
        """``factor ∂(s Δθ)/∂x`` where Δθ is ``angle``."""
        if not self._fades:
            return self.angle_slopes(factor)
        shares = self._share(1), self._share(2)
        return self.angle_slopes(factor * shares[0] * shares[1]) + self._share_slopes(factor * angle, shares)

    def _share_slopes(self, factor: Tensor, shares: tuple[Tensor, Tensor]) -> Float[Tensor, "12 hinges"]:
        """``factor ∂s/∂x``: ``∂f = 6 (1 - t)/(FADED 2A_rest)² n·∂n``, n a normal as long as 2A."""
        end, opposite = torch.zeros_like(self.edge), list[Tensor]()
        for face, arm, sign in ((1, self.arm1, 1.0), (2, self.arm2, -1.0)):
            by_normal = factor * shares[2 - face] * 6.0 * (1.0 - self._part(face)) / self._faded(face).square()
            normal = sign * by_normal * getattr(self, f"normal{face}")
            end = end + cross(arm, normal)
            opposite.append(cross(normal, self.edge))
        return torch.cat([-(end + opposite[0] + opposite[1]), end, *opposite])


def _size(vectors: Float[Tensor, "3 pieces"], rest: Float[Tensor, " pieces"] | None) -> Float[Tensor, " pieces"]:
    square = dot(vectors, vectors)
    return (square if rest is None else square + (TINY * rest.to(square)).square()).sqrt()
