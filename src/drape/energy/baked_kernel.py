"""Elastic energy and dissipation of a baked law on the CPU, compiled: the same numbers as by tensors, several times
faster.

A table makes the law so cheap that what is left is the cost of many small tensor operations. Here each edge is
visited twice, by machine code: from positions to (Δl, α, β), and from their slopes to forces. The first call in an
installation compiles it, some seconds for each term; from then on it is read from the disk.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.baked_kernel_geometry import deformations, forces
from drape.energy.baked_kernel_law import Line, Table, drags, potentials
from drape.energy.baked_kernel_motion import drag_forces, speeds
from drape.energy.baked_kernel_vectors import BLOCK
from drape.energy.baked_law import BakedLaw
from drape.energy.edge_law import EdgeLaw
from drape.energy.edge_scale import EdgeScale
from drape.energy.step import Step
from drape.scene.geometry import TINY
from drape.scene.mesh_batch import MeshBatch


class ElasticKernel:
    """``Φp = Σ_edges w S² φp(q/S)`` and its gradient, as :class:`ElasticEnergy` has them; in float64 throughout."""

    def __init__(self, law: BakedLaw, mesh: MeshBatch, *, transfer: bool):
        self.law, self.mesh = law, mesh
        self._faces, self._edges = _numbers(mesh.faces), _numbers(mesh.edges)
        self._rest = _blocks(torch.cat([mesh.rest_lengths.double()[None], mesh.rest_angles.double()]))
        scale = EdgeScale(mesh, law.face_area)
        self._same = scale.same or not transfer
        self._sizes = _blocks(scale.rest.double()[None], fill=1.0)[:, 0].copy()
        self._shares = _blocks(scale.share.double()[None], fill=1.0)
        self._smallest = float(mesh.length_scale) * TINY

    @staticmethod
    def fits(law: EdgeLaw, x: Tensor) -> bool:
        """Whether there is such a kernel for this law, where these positions are."""
        return isinstance(law, BakedLaw) and law.bends and x.device.type == law.table.taps.device.type == "cpu"

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        """Φp of each cloth [J] and its gradient [N], in the precision of ``x_next``."""
        x, faces, edges = _array(x_next), self._faces, self._edges
        q, normals, inverse_sizes = deformations(x, faces, edges, self._rest, self._smallest)
        energy, slopes = potentials(q, self._sizes, self._same, _table(self.law))
        if not self._same:
            energy *= self._shares[:, 0]
            slopes *= self._shares
        gradient = forces(x, faces, edges, normals, inverse_sizes, slopes, self._smallest)
        per_edge = torch.from_numpy(energy).flatten()[: len(edges)]
        return step.sum_stencils(per_edge, self.mesh.edges[:, 0]), torch.from_numpy(gradient).to(x_next.dtype)


class DissipationKernel:
    """``Φd = dt/dt_law Σ_edges γ φd(speed)`` and its gradient, as :class:`Dissipation` has them; float64 throughout."""

    def __init__(self, law: BakedLaw, mesh: MeshBatch):
        self.law, self.mesh = law, mesh
        self._faces, self._edges = _numbers(mesh.faces), _numbers(mesh.edges)
        self._edge_faces = _numbers(mesh.edge_faces)
        self._edge_faces[mesh.boundary.numpy(), 1] = len(mesh.faces)  # a face without area
        self._smallest_area = float(mesh.length_scale) ** 2 * TINY

    @staticmethod
    def fits(law: EdgeLaw, x: Tensor) -> bool:
        """Whether there is such a kernel for this law, where these positions are."""
        return isinstance(law, BakedLaw) and law.dissipates and x.device.type == law.line.taps.device.type == "cpu"

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        """Φd of each cloth [J] and its gradient [N], in the precision of ``x_next``."""
        x = _array(x_next)
        place = x, x - _array(step.x), self._faces, self._edges, self._edge_faces, self._smallest_area, step.dt
        speed, gamma = speeds(*place)
        duration = step.dt / self.law.dt
        density, slope = (duration * part for part in drags(speed, _line(self.law)))
        gradient = drag_forces(*place, speed, gamma, density, slope)
        energy = step.sum_stencils(torch.from_numpy(gamma * density), self.mesh.edges[:, 0])
        return energy, torch.from_numpy(gradient).to(x_next.dtype)


def _table(law: BakedLaw) -> Table:
    """The table as it is now: a law may change its precision."""
    table = law.table
    taps = table.taps.numpy()
    return Table(taps, table.nodes, table.angles, table.first, table.step, law.stretch_scale, law.rest_hessian)


def _line(law: BakedLaw) -> Line:
    line = law.line
    return Line(line.taps.numpy(), line.nodes, line.first, line.step, law.speed_scale, law.rest_drag)


def _array(x: Tensor) -> np.ndarray:
    return x.detach().double().contiguous().numpy()


def _numbers(indices: Tensor) -> np.ndarray:
    return indices.numpy().astype(np.int32)


def _blocks(rows: Float[Tensor, "rows edges"], fill: float = 0.0) -> np.ndarray:
    """``blocks rows BLOCK``; the last block is filled up."""
    count, edges = rows.shape
    blocks = -(-edges // BLOCK)
    filled = np.full((count, blocks * BLOCK), fill)
    filled[:, :edges] = rows.numpy()
    return np.ascontiguousarray(filled.reshape(count, blocks, BLOCK).transpose(1, 0, 2))
