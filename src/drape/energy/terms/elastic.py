"""The elastic energy of a cloth by the law of its edges: Φp of EUNet."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from scipy import sparse
from torch import Tensor

from drape.energy.law.edge_law import EdgeLaw, Slopes
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.energy.terms.edge_deformation import EdgeDeformation
from drape.energy.terms.edge_scale import ALL, EdgeScale
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.rest_shape import HingeShape
from drape.linalg.stencil_sum import StencilSum, from_jacobian

HINGE = 2.0
"""Stiffness of the hinges that stand for the angles of the edges around them: 0.5 is that of waves much longer than an
edge; four times as stiff, fewer steps of a solver go too far (10 % fewer evaluations for silk, leather and denim)."""


class ElasticEnergy(EnergyTerm):
    """``Φp = Σ_edges w S² φp(q/S)``, q = (Δl, α, β), [J] (paper, eq. 1 and 2).

    ``transfer=False``: w = S = 1, the paper's form, whose units know nothing of their size. ``transfer=True``: w and S
    of :class:`EdgeScale`, with which equal strain and curvature cost equal energy per area at any resolution.

    Where a normal nearly lies along the edge α has no value, and fades out of the energy: see :func:`twist_share`.
    """

    name = "elastic"
    law: EdgeLaw

    def __init__(self, law: EdgeLaw, *, transfer: bool):
        super().__init__(law)
        self.transfer = transfer
        self._scale: tuple[MeshBatch, EdgeScale] | None = None
        self._turning = StencilSum()

    def _scale_of(self, mesh: MeshBatch) -> EdgeScale:
        """That of a mesh; kept for the next time."""
        if self._scale is None or self._scale[0] is not mesh:
            self._scale = mesh, EdgeScale(mesh, self.law.face_area)
        return self._scale[1]

    def _scaled(self, q: Tensor, mesh: MeshBatch, edges: Tensor | slice) -> tuple[Tensor | float, Tensor | None]:
        return self._scale_of(mesh).at(q, edges) if self.transfer else (1.0, None)

    def _shared(self, mesh: MeshBatch, edges: Tensor | slice, dtype: torch.dtype) -> Tensor | float:
        """Share of the energy of ``edges`` that counts."""
        if not self.transfer or self._scale_of(mesh).same:
            return 1.0
        return self._scale_of(mesh).share[edges].to(dtype)

    def _stored(self, q: Float[Tensor, "3 edges"], step: Step, edges: Tensor | slice = ALL) -> Tensor:
        """``S² φp(q/S)`` of ``edges``, differentiable."""
        scale, _ = self._scaled(q, step.mesh, edges)
        energy = scale**2 * self.law.potential((q / scale).T, step.attributes[step.mesh.mesh_of_edge[edges]])
        return self._shared(step.mesh, edges, energy.dtype) * energy

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        deformation = EdgeDeformation(x_next, step.mesh, bends=self.law.bends)
        energy = self._stored(deformation.q, step)
        fading = self._fading(deformation)
        if len(fading):
            share, _ = twist_share(deformation.upright[fading])
            untwisted = self._stored(_untwisted(deformation.q[:, fading]), step, fading)
            energy = energy.index_copy(0, fading, torch.lerp(untwisted, energy[fading], share))
        return step.sum_stencils(energy, step.mesh.edges[:, 0])

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        deformation, slopes, by_upright = self._slopes(x_next, step, hessian=False)
        energy = step.sum_stencils(slopes.energy, step.mesh.edges[:, 0])
        return energy, deformation.pull(slopes.gradient.T, by_upright)

    def hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array:
        """``Jᵀ H₊ J + |∂φp/∂Δl|/l (I - y yᵀ)``, J = ∂q/∂x, H₊ the positive part of ∂²φp/∂q²; its upper triangle.

        Compressed edges are about to turn away; their curvature counts by its size, not as none: a solver would leap.
        """
        deformation, slopes, _ = self._slopes(x_next, step, hessian=True)
        tension = (slopes.gradient[:, 0] / deformation.length).abs()
        string = deformation.spring_blocks(torch.zeros_like(tension), tension)
        turning = self._turning.upper([Stencils(step.mesh.edges, string)], len(x_next))
        return from_jacobian(deformation.jacobian(), slopes.curvature) + turning

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """A rough Hessian of edges and hinges: a quarter of the entries of :meth:`hessian`.

        α and β go through vertex normals and couple all neighbours of both ends; here hinges of stiffness
        ``HINGE (φ_αα + φ_ββ)`` stand for them.
        """
        deformation, slopes, _ = self._slopes(x_next, step, hessian=True)
        stiffness = slopes.curvature.diagonal(dim1=1, dim2=2).clamp(min=0.0)
        tension = (slopes.gradient[:, 0] / deformation.length).abs()
        pieces = [Stencils(step.mesh.edges, deformation.spring_blocks(stiffness[:, 0], tension))]
        if self.law.bends:
            corners, rest = step.mesh.rest_hinges.corners, step.mesh.rest_hinges.shape
            shape = HingeShape(corners.gather(x_next.detach()), rest)
            bending = HINGE * stiffness[~step.mesh.boundary, 1:].sum(1)
            row = shape.angle_slopes(bending.sqrt())
            blocks = (row[:, None] * row).view(4, 3, 4, 3, -1).permute(4, 0, 1, 2, 3)
            pieces.append(Stencils(corners.vertices, blocks))
        return pieces

    def _slopes(
        self, x_next: Tensor, step: Step, *, hessian: bool
    ) -> tuple[EdgeDeformation, Slopes, Tensor | float]:
        """Energies of the edges with their slopes in q, and those in ``upright``."""
        deformation = EdgeDeformation(x_next.detach(), step.mesh, bends=self.law.bends)
        slopes = self._slopes_at(deformation.q, step, ALL, hessian)
        fading = self._fading(deformation)
        if not len(fading):
            return deformation, slopes, 0.0
        untwisted = self._slopes_at(_untwisted(deformation.q[:, fading]), step, fading, hessian)
        share, rise = twist_share(deformation.upright[fading])
        by_upright = torch.zeros_like(slopes.energy)
        by_upright[fading] = rise * (slopes.energy[fading] - untwisted.energy)
        return deformation, _faded(slopes, untwisted, fading, share), by_upright

    def _fading(self, deformation: EdgeDeformation) -> Int[Tensor, " fading"]:
        """Edges whose twist does not count in full."""
        if not self.law.bends:
            return deformation.mesh.edges.new_zeros(0)
        return (deformation.upright.detach() < FADES_BELOW).nonzero()[:, 0]

    def _slopes_at(self, q: Float[Tensor, "3 edges"], step: Step, edges: Tensor | slice, hessian: bool) -> Slopes:
        """Of ``S² φp(q/S)``; the Hessian with S held."""
        scale, turns = self._scaled(q, step.mesh, edges)
        attributes = step.attributes[step.mesh.mesh_of_edge[edges]]
        slopes = self.law.potential_slopes((q / scale).T, attributes, hessian=hessian)
        found = Slopes(scale**2 * slopes.energy, _gradient(q, slopes, scale, turns).T, slopes.hessian)
        share = self._shared(step.mesh, edges, q.dtype)
        if isinstance(share, float):
            return found
        curvature = None if found.hessian is None else share[:, None, None] * found.hessian
        return Slopes(share * found.energy, share[:, None] * found.gradient, curvature)


def _untwisted(q: Float[Tensor, "3 edges"]) -> Float[Tensor, "3 edges"]:
    return torch.stack([q[0], torch.zeros_like(q[1]), q[2]])


def _faded(
    slopes: Slopes, untwisted: Slopes, fading: Int[Tensor, " fading"], share: Float[Tensor, " fading"]
) -> Slopes:
    """``share`` of the slopes of the edges ``fading``, the rest from those without twist, which has no slope there."""
    kept = torch.tensor([1.0, 0.0, 1.0], dtype=share.dtype, device=share.device)

    def mixed(full: Tensor, without: Tensor) -> Tensor:
        weight = share.view(-1, *[1] * (full.dim() - 1))
        return full.index_copy(0, fading, torch.lerp(without, full[fading], weight))

    hessian = None
    if slopes.hessian is not None:
        hessian = mixed(slopes.hessian, untwisted.curvature * kept[:, None] * kept)
    return Slopes(mixed(slopes.energy, untwisted.energy), mixed(slopes.gradient, untwisted.gradient * kept), hessian)


def _gradient(
    q: Float[Tensor, "3 edges"], slopes: Slopes, scale: Tensor | float, turns: Tensor | None
) -> Float[Tensor, "3 edges"]:
    """``d(S² φp(q/S))/dq = S φp' + (2 S φp - φp'·q) dS/dq``."""
    gradient = scale * slopes.gradient.T
    if turns is None:
        return gradient
    by_scale = 2.0 * scale * slopes.energy - (slopes.gradient.T * q).sum(0)
    return torch.cat([gradient[:1], gradient[1:] + by_scale * turns])


FADES_BELOW = 0.25
"""Of :attr:`EdgeDeformation.upright`. Sheets that are learned from stay above 0.9."""


def twist_share(upright: Float[Tensor, " edges"]) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
    """The weight w of the twist, from 0 at ``upright = 0`` to 1 from ``FADES_BELOW`` on, and its slope.

    The twist α is an angle between projections along the edge. A normal that passes through the edge's own direction
    has none, and α jumps by up to half a turn: an energy that sees it has cliffs, which crumpled cloth runs against
    and no line search gets over. ``w φ(Δl, α, β) + (1 - w) φ(Δl, 0, β)`` with ``w = t² (3 - 2t)``, t = upright /
    FADES_BELOW, is continuously differentiable there, and φ itself everywhere else.
    """
    t = (upright / FADES_BELOW).clamp(max=1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / FADES_BELOW
