"""The balance of forces of recorded frames under PHYS: linear in the ratios of its material."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.optimize import nnls
from scipy.spatial import cKDTree
from torch import Tensor

from drape.data.garment_frames import GarmentFrames
from drape.energy.phys_material import THICKNESS
from drape.energy.step import ObstacleStep, Step
from drape.energy.terms.bending import Bending
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.nearest_points import APART

CLEARANCE = 0.02
"""Vertices closer than this to the body or to another part of the cloth may feel contact, which is not modelled [m]."""
RINGS = 4
"""So many edges away from such a vertex, contact does not show in the strains any more: Blender moves touched vertices
after it has balanced forces, and with HOOD's constants the cloth around them then pulls tens of times its weight."""
REWEIGHTINGS = 40
SMALLEST = 1e-6
"""Residuals per weight below it weigh as much as this one."""


class ForceBalance(NamedTuple):
    """The vertices of several garments that can be judged, and what balances there under every material.

    Masses are ρ times the area of a vertex, so that the equation knows ratios to the density only.
    """

    columns: Float[Tensor, "4 vertices 3"]
    """``(m a - m g) / (m |g|)``, and the forces per weight of unit ratios μ/ρ, λ/ρ, k/ρ; their sum is the residual."""
    mesh_of_vertex: Int[Tensor, " vertices"]
    """The garment of the batch that each vertex belongs to."""

    def residuals(self, ratios: Float[Tensor, "meshes 4"]) -> Float[Tensor, " vertices"]:
        """``|m a - m g + ∂(StVK + bending)/∂x| / (m |g|)`` for the :func:`material_ratios` of each garment."""
        unbalanced = (self.columns * ratios[self.mesh_of_vertex].T[..., None]).sum(0)
        return (unbalanced.square().sum(-1) + SMALLEST**2).sqrt()


def material_ratios(numbers: Float[Tensor, "... 4"]) -> Float[Tensor, "... 4"]:
    """``(1, μ/ρ, λ/ρ, k/ρ)`` of the fields of a :class:`PhysMaterial`."""
    return torch.cat([torch.ones_like(numbers[..., :1]), numbers[..., 1:] / numbers[..., :1]], -1)


def frames_step(frames: GarmentFrames) -> Step:
    """Recorded frames as the step from t to t + 1 that an energy sees."""
    window = frames.window
    obstacle = ObstacleStep(frames.body_faces, frames.body, frames.body_next, frames.mesh_of_face)
    names = ("mesh", "x", "v", "mass", "free", "attributes", "gravity", "dt")
    return Step(**{name: getattr(window, name) for name in names}, obstacle=obstacle)


def force_balance(frames: GarmentFrames) -> ForceBalance:
    """The balance at the free vertices that feel no contact and are not beside one that does.

    The acceleration is ``((x' - x)/dt - v)/dt``; the elastic forces are those at t + 1, as in implicit Euler.

    Raises:
        DrapeError: frames without gravity, which have no weight to compare with.
    """
    step, x_next = frames_step(frames), frames.window.x_next
    gravity = step.gravity.norm()
    if not gravity > 0:
        raise DrapeError("force balance: the recorded frames have no gravity; expected some, as forces are per weight")
    acceleration = ((x_next - step.x) / step.dt - step.v) / step.dt
    _, shear = StVK(1.0, 0.0, THICKNESS).energy_and_gradient(x_next, step)
    _, both = StVK(1.0, 1.0, THICKNESS).energy_and_gradient(x_next, step)
    _, bending = Bending(1.0).energy_and_gradient(x_next, step)
    forces = torch.stack([shear, both - shear, bending]) / (vertex_areas(step.mesh)[:, None] * gravity)
    columns = torch.cat([(acceleration - step.gravity)[None] / gravity, forces])
    kept = step.free & ~surrounded(feels_contact(x_next, step), step.mesh)
    return ForceBalance(columns[:, kept], step.mesh.mesh_of_vertex[kept])


def vertex_areas(mesh: MeshBatch) -> Float[Tensor, " vertices"]:
    """A third of the rest areas of the faces at each vertex [m²]."""
    area = mesh.rest_faces.area
    return area.new_zeros(mesh.num_vertices).index_add(0, mesh.faces.reshape(-1), area.repeat_interleave(3) / 3.0)


def feels_contact(x_next: Float[Tensor, "vertices 3"], step: Step) -> Bool[Tensor, " vertices"]:
    """Vertices that may be touched, at t or at t + 1.

    By the body: within :data:`CLEARANCE` of a face. By the cloth itself: within it of a vertex that is more than twice
    as far at rest.

    Raises:
        DrapeError: a step without body.
    """
    touched = torch.zeros(len(x_next), dtype=torch.bool, device=x_next.device)
    body, mesh = step.body, step.mesh
    for x, place in ((step.x, body.x), (x_next, body.x_next)):
        near = NearestFaces.find(x, mesh.mesh_of_vertex, body.faces, body.mesh_of_face, place, place)
        touched[near.points[near.distance.abs() <= CLEARANCE]] = True
        tree = cKDTree(torch.cat([x, APART * mesh.mesh_of_vertex[:, None].to(x.dtype)], -1).cpu().numpy())
        first, second = torch.from_numpy(tree.query_pairs(CLEARANCE, output_type="ndarray")).to(x.device).T
        at_rest = (mesh.rest_positions[first] - mesh.rest_positions[second]).norm(dim=-1)
        met = torch.cat([first, second])[(at_rest > 2.0 * CLEARANCE).repeat(2)]
        touched[met] = True
    return touched


def surrounded(chosen: Bool[Tensor, " vertices"], mesh: MeshBatch) -> Bool[Tensor, " vertices"]:
    """The chosen vertices and all that are fewer than :data:`RINGS` edges away from one."""
    for _ in range(RINGS - 1):
        grown = chosen.clone()
        grown[mesh.edges[chosen[mesh.edges].any(-1)]] = True
        chosen = grown
    return chosen


def best_ratios(columns: Float[Tensor, "4 vertices 3"]) -> Float[Tensor, "4"]:
    """The ratios ``(1, μ/ρ, λ/ρ, k/ρ)``, none negative, of least mean residual over all vertices.

    Non-negative least squares, with each vertex weighted by one over its last residual: a few violent vertices must
    not outweigh a whole garment. Where there is an exact solution it is found at once.
    """
    size = columns.square().mean((1, 2)).sqrt().clamp(min=torch.finfo(columns.dtype).tiny)
    scaled, weight = columns / size[:, None, None], columns.new_ones(columns.shape[1])
    for _ in range(REWEIGHTINGS):
        matrix = torch.einsum("ivx,v,jvx->ij", scaled, weight, scaled).cpu().numpy()
        values, vectors = np.linalg.eigh(matrix)
        root = np.sqrt(values.clip(min=0.0))[:, None] * vectors.T
        found = torch.tensor([1.0, *nnls(root[:, 1:], -root[:, 0])[0]], dtype=torch.float64).to(columns)
        weight = 1.0 / torch.einsum("i,ivx->vx", found, scaled).norm(dim=-1).clamp(min=SMALLEST)
        weight = weight / weight.mean()
    return found * size[0] / size
