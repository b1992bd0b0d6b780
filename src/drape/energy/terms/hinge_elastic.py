"""The elastic energy of a cloth by a law of springs and hinges, and what damps its motion."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.hinge_law import HingeLaw
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array
from drape.energy.terms import damping_kernel
from drape.energy.terms.edge_scale import EdgeScale
from drape.energy.terms.hinge_arrays import Edges, Tables
from drape.energy.terms.hinge_kernel import BLOCK, add_hessian, energies_and_forces
from drape.geometry.corners import Corners, dot
from drape.geometry.edge_geometry import TINY
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.rest_shape import HingeShape
from drape.linalg.stencil_sum import Filled


class HingeEdges:
    """The edges of a mesh with their four corners: both ends, then what lies opposite in both faces.

    On a boundary the only opposite corner stands twice, and the angle does not count.
    """

    def __init__(self, mesh: MeshBatch, face_area: float | None):
        self.mesh = mesh
        opposite = mesh.faces[mesh.edge_faces].sum(-1) - mesh.edges.sum(-1, keepdim=True)
        self.corners = Corners.of(torch.cat([mesh.edges, opposite], -1))
        self.rest = HingeShape(self.corners.gather(mesh.rest_positions))
        self.inner = (~mesh.boundary).double()
        scale = None if face_area is None else EdgeScale(mesh, face_area)
        one = torch.ones_like(mesh.rest_lengths)
        self.size, self.share = (one, one) if scale is None or scale.same else (scale.rest, scale.share)

    @cached_property
    def compiled(self) -> Edges:
        """As the kernels need them."""
        count = self.mesh.num_edges
        padded = -(-count // BLOCK) * BLOCK

        def filled(values: Tensor, fill: float) -> np.ndarray:
            full = np.full((padded, *values.shape[1:]), fill, values.numpy().dtype)
            full[:count] = values.numpy()
            return full

        return Edges(
            corners=filled(self.corners.vertices.int(), 0.0),
            inner=filled(self.inner, 0.0),
            rest_length=filled(self.rest.length, 1.0),
            rest_angle=filled(torch.atan2(*self.rest.angle.mT.flip(0)) * self.inner, 0.0),
            rest_square1=filled(self.rest.double_area1.square(), 1.0),
            rest_square2=filled(self.rest.double_area2.square(), 1.0),
            size=filled(self.size.double(), 1.0),
            share=filled(self.share.double(), 0.0),
        )


class HingeElastic(EnergyTerm):
    """``Φp = Σ_edges w S² φp(Δl/S, Δθ/S)`` [J]: springs along edges, hinges across them.

    ``transfer=False``: w = S = 1. ``transfer=True``: the S and w of :class:`EdgeScale` at rest, with which equal strain
    and curvature cost equal energy per area at any resolution.
    """

    name = "elastic"
    law: HingeLaw

    def __init__(self, law: HingeLaw, *, transfer: bool):
        super().__init__(law)
        self.transfer = transfer
        self._tables: tuple[Tensor, Tables] | None = None

    def edges(self, mesh: MeshBatch) -> HingeEdges:
        """Those of a mesh; made once for all laws that were learned on the same mesh."""
        face_area = self.law.face_area if self.transfer else None
        return mesh.once((HingeEdges, face_area), lambda: HingeEdges(mesh, face_area))

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        edges = self.edges(step.mesh)
        q, *_ = _deformation(x_next, edges)
        size = edges.size.to(q.dtype)
        energy = edges.share.to(q.dtype) * size.square() * self.law.potential((q / size).T)
        return step.sum_stencils(energy, step.mesh.edges[:, 0])

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        edges = self.edges(step.mesh)
        compiled = self._compiled(edges, x_next)
        if compiled is not None:
            found, gradient = energies_and_forces(array(x_next), *compiled)
            energy = torch.from_numpy(found[: step.mesh.num_edges])
            return step.sum_stencils(energy, step.mesh.edges[:, 0]), torch.from_numpy(gradient).to(x_next.dtype)
        q, angle, shape = _deformation(x_next.detach(), edges)
        size, share = edges.size.to(q.dtype), edges.share.to(q.dtype)
        energy, slopes = self.law.energy_and_gradient((q / size).T)
        by_length, by_angle = (share * size * slopes.T).unbind(0)
        pull = shape.change_slopes(by_angle, angle)
        along = (by_length / shape.length) * shape.edge
        pull[0:3] -= along
        pull[3:6] += along
        energy = step.sum_stencils(share * size.square() * energy, step.mesh.edges[:, 0])
        return energy, edges.corners.scatter(pull, len(x_next))

    def kernel(self, step: Step) -> Kernel | None:
        given = self._compiled(self.edges(step.mesh), step.x)
        if given is None:
            return None

        def summed(x: np.ndarray) -> tuple[float, np.ndarray]:
            energies, gradient = energies_and_forces(x, *given)
            return energies.sum(), gradient

        return summed

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils | Filled]:
        """``Jᵀ H₊ J + |∂φp/∂l|/l (I - y yᵀ)``, J = ∂(l, θ)/∂x, H₊ the positive part of ∂²φp/∂(l, θ)².

        Compressed edges are about to turn away; their curvature counts by its size, not as none: a solver would leap.
        """
        edges, count = self.edges(step.mesh), step.mesh.num_edges
        compiled = self._compiled(edges, x_next)
        if compiled is not None:
            x = array(x_next)
            return [Filled(edges.corners.vertices, lambda data, places: add_hessian(x, *compiled, count, data, places))]
        q, angle, shape = _deformation(x_next.detach(), edges)
        size, share = edges.size.to(q.dtype), edges.share.to(q.dtype)
        slopes = self.law.slopes((q / size).T)
        values, vectors = torch.linalg.eigh(share[:, None, None] * slopes.hessian)
        curvature = (vectors * values.clamp(min=0.0)[:, None]) @ vectors.mT
        direction = shape.edge / shape.length
        stretch = torch.cat([-direction, direction, torch.zeros_like(direction), torch.zeros_like(direction)])
        rows = torch.stack([stretch, shape.change_slopes(edges.inner.to(q.dtype), angle)])
        blocks = torch.einsum("ape,eab,bqe->epq", rows, curvature, rows).view(-1, 4, 3, 4, 3)
        string = (share * size * slopes.gradient[:, 0]).abs() / shape.length
        across = torch.eye(3, dtype=q.dtype, device=q.device) - direction.T[:, :, None] * direction.T[:, None]
        across = string[:, None, None] * across
        for a, b, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
            blocks[:, a, :, b] += sign * across
        return [Stencils(edges.corners.vertices, blocks)]

    def _compiled(self, edges: HingeEdges, x: Tensor) -> tuple[Edges, Tables] | None:
        """Arrays of the ``edges`` kept for the kernels; None where there is no table, or not on the CPU."""
        law = self.law
        if not (isinstance(law, BakedHinges) and x.device.type == law.plane.taps.device.type == "cpu"):
            return None
        plane, kept = law.plane, self._tables
        if kept is None or kept[0] is not plane.taps:  # a law may change its precision
            scales = law.stretch_scale, law.angle_scale
            tables = Tables(plane.taps.numpy(), *plane.first, *plane.nodes, *plane.step, *scales)
            self._tables = kept = plane.taps, tables
        return edges.compiled, kept[1]


class Damping(EnergyTerm):
    """``Σ_edges c/(2 dt) ((e' - e)·y)² + Σ_vertices d/(2 dt) |x' - x|²`` [J], e an edge and y its direction at t.

    The axial damper c [kg/s] is that of an edge whatever its length, as that of a spring; the drag d [kg/s] that of a
    vertex of the mesh learned on, and goes with the area that a vertex has.
    """

    name = "damping"
    stores = False
    law: HingeLaw

    def __init__(self, law: HingeLaw, *, transfer: bool):
        super().__init__(law)
        self.transfer = transfer

    def _drag(self, step: Step) -> Float[Tensor, "vertices 1"]:
        """D of each vertex [kg/s]."""
        mesh = step.mesh
        if not self.transfer:
            return torch.full_like(step.x[:, :1], self.law.drag)
        area = mesh.once("mean face", lambda: _mean_face(mesh))
        return (self.law.drag / self.law.face_area) * area.to(step.x)[:, None]

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        moved = x_next - step.x
        air = step.mesh.sum_vertices((0.5 / step.dt) * (self._drag(step) * moved.square()).sum(-1))
        if not self.law.damper:
            return air
        rate, _ = _rates(moved, step)
        axial = (0.5 * self.law.damper / step.dt) * rate.square()
        return step.sum_stencils(axial, step.mesh.edges[:, 0]) + air

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        moved = x_next.detach() - step.x
        drag = (self._drag(step) / step.dt) * moved
        energy = step.mesh.sum_vertices(0.5 * (drag * moved).sum(-1))
        if not self.law.damper:
            return energy, drag
        rate, direction = _rates(moved, step)
        pull = (self.law.damper / step.dt) * rate
        energy = energy + step.sum_stencils(0.5 * pull * rate, step.mesh.edges[:, 0])
        along = pull * direction
        return energy, drag + step.mesh.edge_corners.scatter(torch.stack([-along, along]), len(moved))

    def kernel(self, step: Step) -> Kernel | None:
        if step.x.device.type != "cpu":
            return None
        given = step.once((self, "compiled"), lambda: self._compiled(step))
        return lambda x: damping_kernel.damping(x, *given)

    def _compiled(self, step: Step) -> tuple[np.ndarray | float, ...]:
        """Arrays of a step for the kernel."""
        direction = array(step.once("directions", lambda: _directions(step)).T)
        edges = slice(None) if self.law.damper else slice(0)
        drag = array(self._drag(step)[:, 0] / step.dt)
        return array(step.x), step.mesh.edges.numpy()[edges], direction[edges], self.law.damper / step.dt, drag

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils | Filled]:
        """``c/dt y yᵀ`` on each edge, ``d/dt`` on each vertex: exact."""
        identity = torch.eye(3, dtype=step.x.dtype, device=step.x.device)
        drag = (self._drag(step) / step.dt)[:, :, None] * identity
        on_vertices = Stencils(torch.arange(len(step.x), device=step.x.device)[:, None], drag[:, None, :, None])
        if not self.law.damper:
            return [on_vertices]
        direction = step.once("directions", lambda: _directions(step))
        if x_next.device.type == "cpu":
            _, _, *given, _ = step.once((self, "compiled"), lambda: self._compiled(step))
            add = partial(damping_kernel.add_hessian, direction=given[0], axial=given[1])
            return [Filled(step.mesh.edges, add), on_vertices]
        block = (self.law.damper / step.dt) * direction.T[:, :, None] * direction.T[:, None]
        signs = torch.tensor([[1.0, -1.0], [-1.0, 1.0]], dtype=block.dtype, device=block.device)
        return [Stencils(step.mesh.edges, signs[:, None, :, None] * block[:, None, :, None]), on_vertices]


def _deformation(
    x: Tensor, edges: HingeEdges
) -> tuple[Float[Tensor, "2 edges"], Float[Tensor, " edges"], HingeShape]:
    """Inputs of the law for each edge, the change of its angle, its shape."""
    shape = HingeShape(edges.corners.gather(x), edges.rest)
    seen, angle = shape.change(edges.rest.angle, edges.mesh.boundary)
    return torch.stack([shape.length - edges.rest.length.to(x), seen]), angle, shape


def _mean_face(mesh: MeshBatch) -> Float[Tensor, " vertices"]:
    """Mean area of the faces of the cloth that each vertex is of [m²]."""
    of_face = mesh.mesh_of_vertex[mesh.faces[:, 0]]
    area = mesh.rest_faces.area.new_zeros(mesh.num_meshes).index_add(0, of_face, mesh.rest_faces.area)
    return (area / torch.bincount(of_face, minlength=mesh.num_meshes))[mesh.mesh_of_vertex]


def _rates(moved: Float[Tensor, "vertices 3"], step: Step) -> tuple[Float[Tensor, " edges"], Float[Tensor, "3 edges"]]:
    """``(e' - e)·y`` [m] and y."""
    direction = step.once("directions", lambda: _directions(step))
    first, second = step.mesh.edge_corners.gather(moved)
    return dot(second - first, direction), direction


def _directions(step: Step) -> Float[Tensor, "3 edges"]:
    first, second = step.mesh.edge_corners.gather(step.x)
    vector = second - first
    return vector / (dot(vector, vector) + (TINY * step.mesh.length_scale.to(vector)) ** 2).sqrt()
