"""The family of energy terms that the contract runs on, and steps that have something for each of them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from drape.energy.law.baked.baking import Resolution, bake
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.edge_law import NetworkLaw
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.step import ObstacleStep, Step
from drape.energy.term import EnergyTerm, Stencils
from drape.energy.terms.bending import Bending
from drape.energy.terms.contact import PaperContact, SurfaceContact
from drape.energy.terms.dissipation import Dissipation
from drape.energy.terms.elastic import ElasticEnergy
from drape.energy.terms.free_motion import ExternalForce, Gravity, Inertia
from drape.energy.terms.friction import Friction
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.energy.terms.stvk import StVK
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.surface_points import SurfacePoints
from drape.linalg.stencil_sum import Filled
from drape.scene.material import Material
from tests.conftest import bent
from tests.energies import make_energy


@dataclass(frozen=True)
class Member:
    """A term and what it promises beyond the contract of all terms."""

    make: Callable[[], EnergyTerm]
    elastic: bool = False
    """Forces of the cloth on itself: no energy and no force at rest, no total force, no total torque."""
    exact: Callable[[Step, Tensor], Tensor] | None = None
    """Positions at the end of the step where the stencils are the Hessian, from those of :func:`make_step`."""


def anywhere(step: Step, x_next: Tensor) -> Tensor:
    return x_next


def at_rest(step: Step, x_next: Tensor) -> Tensor:
    return step.mesh.rest_positions.to(x_next.dtype)


def stretched(step: Step, x_next: Tensor) -> Tensor:
    return at_rest(step, x_next) * torch.tensor([1.1, 1.2, 1.0], dtype=x_next.dtype)


def law() -> NetworkLaw:
    """A law of the paper's with random parameters, of a mesh with longer edges than those of :func:`make_step`."""
    torch.manual_seed(1)
    return NetworkLaw(make_energy("settled", "speed"), face_area=0.02, dt=0.05)


def hinges() -> NetworkHinges:
    """A law of springs and hinges with random parameters, of a mesh like that of :func:`law`."""
    torch.manual_seed(1)
    attributes = torch.linspace(0.1, 0.9, 5, dtype=torch.float64)
    found = NetworkHinges(make_energy("hinge", "none").requires_grad_(False), attributes, face_area=0.02, dt=0.05)
    found.damper, found.drag = 3.0, 0.2
    return found


@functools.cache
def baked() -> BakedHinges:
    """The law of :func:`hinges` as a table."""
    return bake(hinges(), Resolution((-1.0, 4.0), 0.25), fabric=Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15))


def spring_hinge() -> BakedHinges:
    """A spring-hinge law of a mesh with longer edges than those of :func:`make_step`."""
    constants = torch.tensor([[0.0, 300.0, 200.0, 0.1, 2.0, 0.4, 1.5, 0.3]], dtype=torch.float64)
    silk = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
    return SpringHingeLaw(constants).of_fabric(0, silk, face_area=0.02, dt=0.01)


TERMS = {
    "inertia": Member(Inertia, exact=anywhere),
    "gravity": Member(Gravity, exact=anywhere),
    "external": Member(ExternalForce, exact=anywhere),
    "stvk": Member(StVK, elastic=True, exact=stretched),
    "bending": Member(Bending, elastic=True, exact=at_rest),
    "elastic": Member(lambda: ElasticEnergy(law(), transfer=False), elastic=True),
    "elastic, transferred": Member(lambda: ElasticEnergy(law(), transfer=True), elastic=True),
    "dissipation": Member(lambda: Dissipation(law())),
    "hinges": Member(lambda: HingeElastic(hinges(), transfer=False), elastic=True, exact=at_rest),
    "hinges, transferred": Member(lambda: HingeElastic(hinges(), transfer=True), elastic=True, exact=at_rest),
    "baked": Member(lambda: HingeElastic(baked(), transfer=False), elastic=True),
    "baked, transferred": Member(lambda: HingeElastic(baked(), transfer=True), elastic=True),
    "damping": Member(lambda: Damping(hinges(), transfer=False), exact=anywhere),
    "damping, transferred": Member(lambda: Damping(hinges(), transfer=True), exact=anywhere),
    "spring_hinge": Member(lambda: HingeElastic(spring_hinge(), transfer=False), elastic=True),
    "contact_paper": Member(lambda: PaperContact(thickness=0.05), exact=anywhere),
    "contact_surface": Member(lambda: SurfaceContact(thickness=0.05), exact=anywhere),
    "friction": Member(lambda: Friction(0.5, SurfaceContact(thickness=0.05)), exact=anywhere),
    "friction_sticking": Member(lambda: Friction(0.5, SurfaceContact(thickness=0.05), slip_speed=2.0), exact=anywhere),
}
"""Every energy term; a new one gets its line here, and the whole contract runs on it."""


def make_step(*meshes: ClothMesh, dtype: torch.dtype = torch.float64) -> tuple[Step, Tensor]:
    """A step of cloths in smooth motion close above moving bodies, in wind, and positions at its end.

    All is a function of the rest positions, so that a cloth has the same step alone and in a batch; the cloths and
    bodies of a batch stand at the same place.
    """
    mesh = MeshBatch.from_meshes(meshes)
    rest = mesh.rest_positions
    x = bent(rest)
    motion = 0.02 * torch.stack([rest[:, 1], rest[:, 0] * rest[:, 1], torch.cos(2 * rest[:, 0])], -1)
    step = Step(
        mesh=mesh,
        x=x,
        v=30.0 * motion,
        mass=0.2 + 0.05 * torch.sin(3 * rest[:, 0] + rest[:, 1]),
        free=rest[:, 1] < 0.4,
        attributes=torch.linspace(0.1, 0.9, 5, dtype=torch.float64).repeat(len(meshes), 1),
        gravity=torch.tensor([1.0, 2.0, -9.81], dtype=torch.float64),
        dt=1.0 / 30.0,
        external_force=torch.stack([rest[:, 1], rest[:, 0], 1.0 + rest[:, 0]], -1),
        obstacle=_bodies(len(meshes)),
        touching=SurfacePoints.of(mesh, per_edge=1, per_face=3),
    )
    x_next = x + 1.1 * motion + 1e-3 * torch.sin(50.0 * rest.roll(1, -1) + 20.0 * rest)
    return converted(step, dtype), x_next.to(dtype)


def _bodies(count: int) -> ObstacleStep:
    """Surfaces of the shape of the cloth a few millimetres below it; the cloth hangs over their border a little."""
    body = square_grid(0.9, 9)
    rest = torch.from_numpy(np.tile(body.rest_positions.astype(np.float64), (count, 1)))
    number = torch.arange(count).repeat_interleave(body.num_faces)
    faces = torch.from_numpy(np.tile(body.faces, (count, 1))) + body.num_vertices * number[:, None]
    x = bent(rest) - torch.tensor([0.0, 0.0, 0.005])
    drift = torch.stack([0.02 + 0 * rest[:, 0], 0.01 * rest[:, 0], 0.01 + 0.02 * rest[:, 1]], -1)
    return ObstacleStep(faces, x, x + drift, number)


def _changed(step: Step, vector: Callable[[Tensor], Tensor], point: Callable[[Tensor], Tensor]) -> Step:
    obstacle = step.obstacle
    return replace(
        step,
        x=point(step.x),
        v=vector(step.v),
        gravity=vector(step.gravity),
        external_force=vector(step.external_force),
        obstacle=replace(obstacle, x=point(obstacle.x), x_next=point(obstacle.x_next)),
    )


def converted(step: Step, dtype: torch.dtype) -> Step:
    """The step in another precision."""
    step = _changed(step, lambda v: v.to(dtype), lambda x: x.to(dtype))
    return replace(step, mass=step.mass.to(dtype), attributes=step.attributes.to(dtype))


def moved(step: Step, rotation: Tensor, translation: Tensor) -> Step:
    """The whole scene turned and moved: cloth, body, gravity, forces."""
    return _changed(step, lambda v: v @ rotation.T, lambda x: x @ rotation.T + translation)


def renumbered(step: Step, order: Tensor) -> Step:
    """A step of one cloth whose vertex i was vertex ``order[i]``; faces in reverse order."""
    place = torch.argsort(order).numpy()
    rest = step.mesh.rest_positions[order].numpy()
    mesh = MeshBatch.from_meshes([ClothMesh.from_faces(rest, place[step.mesh.faces.numpy()][::-1])])
    rows = {name: getattr(step, name)[order] for name in ("x", "v", "mass", "free", "external_force")}
    return replace(step, mesh=mesh, touching=SurfacePoints.of(mesh, per_edge=1, per_face=3), **rows)


def written_out(pieces: Sequence[Stencils | Filled]) -> list[Stencils]:
    """The pieces with the blocks of those that add themselves to a matrix."""
    return [_opened(piece) if isinstance(piece, Filled) else Stencils(*piece) for piece in pieces]


def _opened(piece: Filled) -> Stencils:
    count, corners = piece.vertices.shape
    row, column = torch.triu_indices(3 * corners, 3 * corners)
    places = np.arange(count * len(row), dtype=np.int32).reshape(count, -1)
    data = np.zeros(places.size)
    piece.add(data, places)
    blocks = torch.zeros(count, 3 * corners, 3 * corners, dtype=torch.float64)
    blocks[:, row, column] = torch.from_numpy(data).view(count, -1)
    blocks[:, column, row] = blocks[:, row, column]
    return Stencils(piece.vertices, blocks.view(count, corners, 3, corners, 3))


def assembled(pieces: Sequence[Stencils | Filled], num_vertices: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """The dense matrix of the pieces."""
    matrix = torch.zeros(3 * num_vertices, 3 * num_vertices, dtype=dtype)
    for vertices, blocks in written_out(pieces):
        slots = (3 * vertices[:, :, None] + torch.arange(3)).flatten(1)
        size = slots.shape[1]
        pairs = (slots[:, :, None].expand(-1, -1, size), slots[:, None, :].expand(-1, size, -1))
        matrix.index_put_(pairs, blocks.reshape(-1, size, size), accumulate=True)
    return matrix
