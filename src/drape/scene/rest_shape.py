"""What the rest positions of a cloth say of its faces and of the hinges between them."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.scene.corners import Corners, cross, dot
from drape.scene.geometry import TINY


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
    area: Float[Tensor, " hinges"]
    """Area of the two faces [m²]."""

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
        shape = HingeShape(corners.gather(rest_positions), 0.0)
        area = 0.5 * (shape.double_area1 + shape.double_area2)
        return cls(corners, shape.angle / shape.angle.norm(dim=-1, keepdim=True), area)


class HingeShape:
    """Edge, normals and angle of hinges whose corners stand at ``x``; finite for every input.

    Lengths count as zero below ``smallest`` [m], areas below ``smallest²/TINY``, so with ``smallest = TINY·L`` all is
    judged against the size L of the mesh.
    """

    def __init__(self, x: Float[Tensor, "4 3 hinges"], smallest: Tensor | float):
        start, end, third, fourth = x
        self.edge = end - start
        self.arm1 = third - start
        self.arm2 = fourth - start
        self.length = _size(self.edge, smallest)
        self.normal1 = cross(self.edge, self.arm1)
        self.normal2 = cross(self.arm2, self.edge)
        self.double_area1 = _size(self.normal1, smallest**2 / TINY)
        self.double_area2 = _size(self.normal2, smallest**2 / TINY)
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


def _size(vectors: Float[Tensor, "3 pieces"], smallest: Tensor | float) -> Float[Tensor, " pieces"]:
    return (dot(vectors, vectors) + smallest**2).sqrt()
