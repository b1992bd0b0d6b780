"""The elastic energy of a cloth by the law of its edges: Φp of EUNet, from the networks or from a table."""

from __future__ import annotations

import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from drape.energy.baked_kernel import ElasticKernel
from drape.energy.edge_deformation import EdgeDeformation
from drape.energy.edge_law import EdgeLaw, Slopes
from drape.energy.edge_scale import EdgeScale
from drape.energy.hessian import from_jacobian, from_stencils
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.scene.geometry import TINY
from drape.scene.mesh_batch import MeshBatch
from drape.scene.rest_shape import HingeShape

HINGE = 0.5
"""Stiffness of the hinges that stand for the angles of the edges around them."""


class ElasticEnergy(EnergyTerm):
    """``Φp = Σ_edges S² φp(q/S)``, q = (Δl, α, β), [J] (paper, eq. 1 and 2).

    ``transfer=False``: S = 1, the paper's form, whose units know nothing of their size. ``transfer=True``: S of
    :class:`EdgeScale`, with which equal strain and curvature cost equal energy per area at any resolution.
    """

    name = "elastic"

    def __init__(self, law: EdgeLaw, *, transfer: bool):
        super().__init__()
        self.law = law
        self.transfer = transfer
        self._scale: tuple[MeshBatch, EdgeScale] | None = None
        self._kernel: ElasticKernel | None = None

    def _scaled(self, deformation: EdgeDeformation) -> tuple[Tensor | float, Tensor | None]:
        if not self.transfer:
            return 1.0, None
        if self._scale is None or self._scale[0] is not deformation.mesh:
            self._scale = deformation.mesh, EdgeScale(deformation.mesh, self.law.face_area)
        return self._scale[1].at(deformation.q)

    def _attributes(self, step: Step) -> Tensor:
        return step.attributes[step.mesh.mesh_of_edge]

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        deformation = EdgeDeformation(x_next, step.mesh, bends=self.law.bends)
        scale, _ = self._scaled(deformation)
        energy = self.law.potential((deformation.q / scale).T, self._attributes(step))
        return step.sum_stencils(scale**2 * energy, step.mesh.edges[:, 0])

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        if ElasticKernel.fits(self.law, x_next):
            if self._kernel is None or self._kernel.mesh is not step.mesh:
                self._kernel = ElasticKernel(self.law, step.mesh, transfer=self.transfer)
            return self._kernel.energy_and_gradient(x_next, step)
        deformation, slopes, scale, turns = self._slopes(x_next, step, hessian=False)
        energy = step.sum_stencils(scale**2 * slopes.energy, step.mesh.edges[:, 0])
        return energy, deformation.pull(_gradient(deformation.q, slopes, scale, turns))

    def hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array:
        """``Jᵀ H₊ J + |∂φp/∂Δl|/l (I - y yᵀ)``, J = ∂q/∂x, H₊ the positive part of ∂²φp/∂q².

        Compressed edges are about to turn away; their curvature counts by its size, not as none: a solver would leap.
        """
        deformation, slopes, scale, _ = self._slopes(x_next, step, hessian=True)
        tension = (scale * slopes.gradient[:, 0] / deformation.length).abs()
        string = deformation.spring_blocks(torch.zeros_like(tension), tension)
        turning = from_stencils(step.mesh.edges, string, len(x_next))
        return from_jacobian(deformation.jacobian(), slopes.hessian) + turning

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """A rough Hessian of edges and hinges: a quarter of the entries of :meth:`hessian`.

        α and β go through vertex normals and couple all neighbours of both ends. For waves much longer than an edge
        they cost what a hinge of ``HINGE (φ_αα + φ_ββ)`` costs; for shorter ones less.
        """
        deformation, slopes, scale, _ = self._slopes(x_next, step, hessian=True)
        stiffness = slopes.hessian.diagonal(dim1=1, dim2=2).clamp(min=0.0)
        tension = (scale * slopes.gradient[:, 0] / deformation.length).abs()
        pieces = [Stencils(step.mesh.edges, deformation.spring_blocks(stiffness[:, 0], tension))]
        if self.law.bends:
            corners = step.mesh.rest_hinges.corners
            shape = HingeShape(corners.gather(x_next.detach()), TINY * float(step.mesh.length_scale))
            bending = HINGE * stiffness[~step.mesh.boundary, 1:].sum(1)
            row = shape.angle_slopes(bending.sqrt())
            blocks = (row[:, None] * row).view(4, 3, 4, 3, -1).permute(4, 0, 1, 2, 3)
            pieces.append(Stencils(corners.vertices, blocks))
        return pieces

    def _slopes(
        self, x_next: Tensor, step: Step, *, hessian: bool
    ) -> tuple[EdgeDeformation, Slopes, Tensor | float, Tensor | None]:
        deformation = EdgeDeformation(x_next.detach(), step.mesh, bends=self.law.bends)
        scale, turns = self._scaled(deformation)
        slopes = self.law.potential_slopes((deformation.q / scale).T, self._attributes(step), hessian=hessian)
        return deformation, slopes, scale, turns


def _gradient(
    q: Float[Tensor, "3 edges"], slopes: Slopes, scale: Tensor | float, turns: Tensor | None
) -> Float[Tensor, "3 edges"]:
    """``d(S² φp(q/S))/dq = S φp' + (2 S φp - φp'·q) dS/dq``."""
    gradient = scale * slopes.gradient.T
    if turns is None:
        return gradient
    by_scale = 2.0 * scale * slopes.energy - (slopes.gradient.T * q).sum(0)
    return torch.cat([gradient[:1], gradient[1:] + by_scale * turns])
