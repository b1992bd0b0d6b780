"""The deformation q = (Δl, α, β) of every edge, with its derivatives in the positions written out."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from drape.geometry.corners import cross, dot
from drape.geometry.edge_geometry import TINY
from drape.geometry.mesh_batch import MeshBatch


class EdgeDeformation:
    """(Δl [m], Δα, Δβ [rad]) of the edges of ``x``, the changes of length, twist and bend from rest (paper, eq. 2).

    The same quantities as in :class:`~drape.geometry.edge_geometry.EdgeGeometry`, laid out component by component and
    with hand-written derivatives, several times faster than autograd. With unit vertex normals n_i, n_j, the unit edge
    y, ``e = n·y`` and ``c = sqrt(1 - e²)``::

        α = atan2((n_j x n_i)·y, n_i·n_j - e_i e_j)        β = atan2(e_i, c_i) - atan2(e_j, c_j)

    Finite for every input: sizes are rounded up by a millionth of the mesh's own, sines and cosines by 1e-6.

    Args:
        x: positions, any floating type.
        mesh: the cloths.
        bends: compute α and β as well; without them no normal is computed, and both are 0.
    """

    def __init__(self, x: Float[Tensor, "vertices 3"], mesh: MeshBatch, *, bends: bool):
        self.mesh = mesh
        self.bends = bends
        self.num_vertices = len(x)
        self._smallest = float(mesh.length_scale) * TINY
        first, second = mesh.edge_corners.gather(x)
        self.vector = second - first
        self.length = (dot(self.vector, self.vector) + self._smallest**2).sqrt()
        self.direction = self.vector / self.length
        self._x = x

    @cached_property
    def q(self) -> Float[Tensor, "3 edges"]:
        """(Δl, Δα, Δβ); angles in (-π, π]."""
        stretch = self.length - self.mesh.rest_lengths.to(self.length.dtype)
        if not self.bends:
            return torch.stack([stretch, torch.zeros_like(stretch), torch.zeros_like(stretch)])
        alpha = torch.atan2(self._sine, self._cosine)
        beta = torch.atan2(self._e_i, self._c_i) - torch.atan2(self._e_j, self._c_j)
        rest = self.mesh.rest_angles.to(stretch.dtype)
        return torch.stack([stretch, _wrapped(alpha - rest[0]), _wrapped(beta - rest[1])])

    @cached_property
    def _faces(self) -> tuple[Tensor, Tensor]:
        x0, x1, x2 = self.mesh.face_corners.gather(self._x)
        return x1 - x0, x2 - x0

    @cached_property
    def _sum(self) -> Float[Tensor, "vertices 3"]:
        """Sum of the normals of the faces at each vertex, each as long as twice its area."""
        normal = cross(*self._faces)
        return self.mesh.face_corners.scatter(normal.expand(3, -1, -1).contiguous(), self.num_vertices)

    @cached_property
    def _size(self) -> Float[Tensor, "vertices 1"]:
        return (self._sum.square().sum(-1, keepdim=True) + (self._smallest**2 / TINY) ** 2).sqrt()

    @cached_property
    def _normals(self) -> Float[Tensor, "vertices 3"]:
        return self._sum / self._size

    @cached_property
    def _ends(self) -> Float[Tensor, "2 3 edges"]:
        return self.mesh.edge_corners.gather(self._normals)

    @cached_property
    def _e_i(self) -> Float[Tensor, " edges"]:
        return dot(self._ends[0], self.direction)

    @cached_property
    def _e_j(self) -> Float[Tensor, " edges"]:
        return dot(self._ends[1], self.direction)

    @cached_property
    def _c_i(self) -> Float[Tensor, " edges"]:
        return _cosine_of(self._e_i)

    @cached_property
    def _c_j(self) -> Float[Tensor, " edges"]:
        return _cosine_of(self._e_j)

    @cached_property
    def _cross(self) -> Float[Tensor, "3 edges"]:
        return cross(self._ends[1], self._ends[0])

    @cached_property
    def _sine(self) -> Float[Tensor, " edges"]:
        return dot(self._cross, self.direction)

    @cached_property
    def _cosine(self) -> Float[Tensor, " edges"]:
        return dot(self._ends[0], self._ends[1]) - self._e_i * self._e_j

    @cached_property
    def upright(self) -> Float[Tensor, " edges"]:
        """``c_i c_j``: 1 where both normals are orthogonal to the edge, 0 where one lies along it and α is nothing."""
        return (self._sine.square() + self._cosine.square() + TINY**2).sqrt()

    def _angle_slopes(
        self, by_alpha: Tensor, by_beta: Tensor, by_upright: Tensor | float = 0.0
    ) -> tuple[Tensor, Tensor, Tensor]:
        """``by_alpha dα + by_beta dβ + by_upright d(c_i c_j)`` as coefficients of dn_i, dn_j and dx_j (-dx_i)."""
        n_i, n_j = self._ends
        y, e_i, e_j = self.direction, self._e_i, self._e_j
        turn, lift = by_alpha / self.upright.square(), by_upright / self.upright
        by_sine, by_cosine = turn * self._cosine + lift * self._sine, lift * self._cosine - turn * self._sine
        up_i, up_j = by_beta / self._c_i, -by_beta / self._c_j
        # elevations and the products with y in the cosine both come through e_i and e_j
        by_e_i, by_e_j = up_i - by_cosine * e_j, up_j - by_cosine * e_i
        on_i = by_sine * cross(y, n_j) + by_cosine * n_j + by_e_i * y
        on_j = by_sine * cross(n_i, y) + by_cosine * n_i + by_e_j * y
        on_y = by_sine * self._cross + by_e_i * n_i + by_e_j * n_j
        return on_i, on_j, (on_y - y * dot(y, on_y)) / self.length

    def pull(
        self, slopes: Float[Tensor, "3 edges"], by_upright: Float[Tensor, " edges"] | float = 0.0
    ) -> Float[Tensor, "vertices 3"]:
        """``(∂q/∂x)ᵀ slopes``: the gradient of an energy in the positions from its slopes in q and :attr:`upright`."""
        along = slopes[0] * self.direction
        if not self.bends:
            return self.mesh.edge_corners.scatter(torch.stack([-along, along]), self.num_vertices)
        on_i, on_j, turn = self._angle_slopes(slopes[1], slopes[2], by_upright)
        along = along + turn
        on_normals = self.mesh.edge_corners.scatter(torch.stack([on_i, on_j]), self.num_vertices)
        normals = self._normals
        on_sum = (on_normals - normals * (normals * on_normals).sum(-1, keepdim=True)) / self._size
        a, b = self._faces
        on_face = self.mesh.face_corners.gather(on_sum).sum(0)
        on_1, on_2 = cross(b, on_face), cross(on_face, a)
        gradient = self.mesh.edge_corners.scatter(torch.stack([-along, along]), self.num_vertices)
        return gradient + self.mesh.face_corners.scatter(torch.stack([-(on_1 + on_2), on_1, on_2]), self.num_vertices)

    def jacobian(self) -> tuple[sparse.csr_array, ...]:
        """∂Δl/∂x and, where the edges bend, ∂α/∂x and ∂β/∂x; each ``edges`` x ``3 vertices``."""
        columns = 3 * self.mesh.num_vertices
        ends = self.mesh.edges.cpu().numpy()

        def rows(on_i: Tensor, on_j: Tensor) -> sparse.csr_array:
            values = torch.stack([on_i, on_j]).permute(2, 0, 1).reshape(-1).double().cpu().numpy()
            indices = (3 * ends[:, :, None] + np.arange(3)).reshape(-1)
            return sparse.csr_array((values, indices, np.arange(0, 6 * len(ends) + 1, 6)), (len(ends), columns))

        stretch = rows(-self.direction, self.direction)
        if not self.bends:
            return (stretch,)
        one, zero = torch.ones_like(self.length), torch.zeros_like(self.length)
        normals = self._normal_jacobian()
        angles = []
        for slopes in ((one, zero), (zero, one)):
            on_i, on_j, turn = self._angle_slopes(*slopes)
            angles.append(rows(on_i, on_j) @ normals + rows(-turn, turn))
        return (stretch, *angles)

    def spring_blocks(
        self, stiffness: Float[Tensor, " edges"], tension: Float[Tensor, " edges"]
    ) -> Float[Tensor, "edges 2 3 2 3"]:
        """``stiffness y yᵀ + tension (I - y yᵀ)`` on the difference of the ends: springs, and what turns taut edges.

        ``tension`` is the force along an edge over its length [N/m].
        """
        y = self.direction.T
        along = y[:, :, None] * y[:, None, :]
        block = (stiffness - tension)[:, None, None] * along
        block = block + tension[:, None, None] * torch.eye(3, dtype=y.dtype, device=y.device)
        signs = torch.tensor([[1.0, -1.0], [-1.0, 1.0]], dtype=y.dtype, device=y.device)
        return signs[:, None, :, None] * block[:, None, :, None, :]

    def _normal_jacobian(self) -> sparse.csr_array:
        """∂n/∂x, ``3 vertices`` x ``3 vertices``."""
        n, size = self._normals, self._size[..., None]
        project = (torch.eye(3, dtype=n.dtype, device=n.device) - n[:, :, None] * n[:, None, :]) / size
        a, b = (edge.T for edge in self._faces)
        arms = torch.stack([b - a, -b, a], 1)  # dN = Σ_c arm_c x dx_c
        faces = self.mesh.faces
        # P_v [arm]x: each row of P crossed with the arm
        blocks = torch.linalg.cross(project[faces][:, :, None, :, :], arms[:, None, :, None, :], dim=-1)
        corners = faces.cpu().numpy()
        rows = 3 * corners[:, :, None, None, None] + np.arange(3)[:, None]
        columns = 3 * corners[:, None, :, None, None] + np.arange(3)
        shape = blocks.shape
        indices = (np.broadcast_to(rows, shape).reshape(-1), np.broadcast_to(columns, shape).reshape(-1))
        entries = sparse.coo_array((blocks.reshape(-1).double().cpu().numpy(), indices), (3 * len(n), 3 * len(n)))
        return entries.tocsr()


def _cosine_of(sine: Tensor) -> Tensor:
    return ((1.0 - sine.square()).clamp(min=0.0) + TINY**2).sqrt()


def _wrapped(angle: Tensor) -> Tensor:
    return angle - 2.0 * torch.pi * torch.round(angle / (2.0 * torch.pi))
