"""The elastic energy of a cloth by the law of its edges: Φp of EUNet, from the networks or from a table."""

from __future__ import annotations

from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from drape.energy.edge_deformation import EdgeDeformation
from drape.energy.edge_law import EdgeLaw
from drape.energy.hessian import from_jacobian
from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.scene.mesh_batch import MeshBatch


class ElasticEnergy(EnergyTerm):
    """``Φp = Σ_edges s² φp(Δl/s, α/s, β/s)`` [J] (paper, eq. 1 and 2).

    s is how long an edge is beside one of the mesh that the law was learned on. ``transfer=False``: s = 1, the paper's
    form, whose units know nothing of their size: twice the resolution makes another cloth. ``transfer=True``: ``s² =
    face area at the edge / face area learned on``. Equal strain and equal curvature then cost equal energy per area
    at any resolution, and on the mesh that was learned on nothing changes.
    """

    name = "elastic"

    def __init__(self, law: EdgeLaw, *, transfer: bool):
        super().__init__()
        self.law = law
        self.transfer = transfer
        self._scaled: tuple[MeshBatch, Tensor | float] | None = None

    def scale(self, mesh: MeshBatch) -> Float[Tensor, " edges"] | float:
        """s of every edge of ``mesh``."""
        if not self.transfer:
            return 1.0
        if self._scaled is None or self._scaled[0] is not mesh:
            faces = 2.0 - mesh.boundary.to(mesh.rest_lengths.dtype)
            self._scaled = mesh, (mesh.rest.area / faces / self.law.face_area).sqrt()
        return self._scaled[1]

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        scale = self.scale(step.mesh)
        deformation = EdgeDeformation(x_next, step.mesh, bends=self.law.bends)
        energy = self.law.potential((deformation.q / scale).T, self._attributes(step))
        return step.sum_stencils(scale**2 * energy, step.mesh.edges[:, 0])

    def _attributes(self, step: Step) -> Tensor:
        return step.attributes[step.mesh.mesh_of_edge]

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        scale = self.scale(step.mesh)
        deformation = EdgeDeformation(x_next.detach(), step.mesh, bends=self.law.bends)
        slopes = self.law.potential_slopes((deformation.q / scale).T, self._attributes(step), hessian=False)
        energy = step.sum_stencils(scale**2 * slopes.energy, step.mesh.edges[:, 0])
        return energy, deformation.pull(scale * slopes.gradient.T)

    def hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array:
        """``Jᵀ H₊ J + max(∂φp/∂Δl, 0)/l (I - y yᵀ)``, J = ∂q/∂x, H₊ the positive part of ∂²φp/∂q²."""
        scale = self.scale(step.mesh)
        deformation = EdgeDeformation(x_next.detach(), step.mesh, bends=self.law.bends)
        slopes = self.law.potential_slopes((deformation.q / scale).T, self._attributes(step), hessian=True)
        tension = (scale * slopes.gradient[:, 0] / deformation.length).clamp(min=0.0)
        return from_jacobian(deformation.jacobian(), slopes.hessian) + deformation.string_hessian(tension)
