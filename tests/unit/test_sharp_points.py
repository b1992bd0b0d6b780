"""Corners and sharp edges of bodies: where they are, which of the cloth meets them, and that none comes through."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh

from drape.contact.sharp_points import SharpPoints
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.terms.bending import Bending
from drape.energy.terms.contact import Contact, PaperContact, SurfaceContact
from drape.energy.terms.ipc import Barrier
from drape.energy.terms.point_stencils import point_stencils
from drape.energy.terms.stvk import StVK
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.surface_points import SurfacePoints
from drape.scene.obstacle import Obstacle
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.solver.implicit import ImplicitSolver
from tests.terms import written_out
from tests.unit.test_implicit import GRAVITY, NO_ATTRIBUTES, SILK

BOX = trimesh.creation.box((0.4, 0.4, 0.4))
SPACING, THICKNESS = 0.03, 8.5e-3


def obstacle(mesh: trimesh.Trimesh) -> Obstacle:
    return Obstacle(mesh.faces, np.asarray(mesh.vertices)[None])


def tensors(body: Obstacle) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.tensor(body.at(0)), torch.tensor(body.welded_faces)


def test_a_box_is_sharp_at_its_corners_and_edges_not_across_its_faces():
    """Points of edges are at most half the spacing apart; normals halve the angles of the faces."""
    sharp = SharpPoints.of(obstacle(BOX), SPACING, THICKNESS)
    inside = math.ceil(2 * 0.4 / SPACING) - 1
    assert len(sharp) == 8 + 12 * inside
    point, _, normal = sharp.frames(*tensors(obstacle(BOX)))
    at_side = (point.abs() > 0.2 - 1e-12).to(point)
    assert sorted(at_side.sum(1).tolist()) == [2.0] * (12 * inside) + [3.0] * 8
    torch.testing.assert_close(normal, torch.nn.functional.normalize(point.sign() * at_side, dim=-1))
    along = point[(at_side[:, 0] > 0) & (point[:, 0] > 0) & (at_side[:, 1] > 0) & (point[:, 1] > 0), 2].sort().values
    assert along.diff().max() <= SPACING / 2


@pytest.mark.parametrize(("radius", "expected"), [(0.1, 642), (1.0, None)])
def test_a_sphere_is_sharp_for_a_cloth_that_is_too_coarse(radius, expected):
    """0.1²/(8 · 0.1) is more than half a thickness of 8.5 mm, 0.1²/8 less."""
    found = SharpPoints.of(obstacle(trimesh.creation.icosphere(3, radius)), 0.1, THICKNESS)
    assert (found and len(found)) == expected


def test_what_is_concave_is_not_sharp():
    room = BOX.copy()
    room.invert()
    assert SharpPoints.of(obstacle(room), SPACING, THICKNESS) is None


def test_frames_turn_with_the_body():
    """Where the cloth was beside a point is told in tangents that the body takes along."""
    sharp, (body, faces) = SharpPoints.of(obstacle(BOX), SPACING, THICKNESS), tensors(obstacle(BOX))
    turn = torch.tensor(trimesh.transformations.rotation_matrix(1.0, [1.0, 2.0, 3.0])[:3, :3])
    before, after = sharp.frames(body, faces), sharp.frames(body @ turn.T, faces)
    torch.testing.assert_close(after.tangents, before.tangents @ turn.T)
    axes = torch.cat([before.tangents, before.normal[:, None]], 1)
    torch.testing.assert_close(axes @ axes.mT, torch.eye(3, dtype=axes.dtype).expand_as(axes))


@pytest.fixture
def sheet() -> SurfacePoints:
    return SurfacePoints.of(MeshBatch.from_meshes([square_grid(0.1, 2)]), per_edge=1)


def standing(flat: float = 1.0) -> trimesh.Trimesh:
    """The box on a corner, another straight up, ``flat`` times as high."""
    box = BOX.copy()
    box.apply_transform(trimesh.geometry.align_vectors([1.0, 1.0, 1.0], [0.0, 0.0, 1.0]))
    box.vertices[:, 2] = 0.2 * 3**0.5 + flat * (box.vertices[:, 2] - 0.2 * 3**0.5)
    return box


def met(sheet: SurfacePoints, shift: list[float], speed: float = 0.0, rise: float = 0.0, flat: float = 1.0) -> tuple:
    """What a sheet of 0.1 m, level and moved by ``shift`` from the corner of a box that points up, meets of it."""
    box = standing(flat)
    body, faces = tensors(obstacle(box))
    x = torch.tensor(square_grid(0.1, 2).rest_positions + np.array(shift) + [0.0, 0.0, 0.2 * 3**0.5])
    move = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    sharp = SharpPoints.of(obstacle(box), 1.0, THICKNESS)
    return sharp.meeting(sheet, x, x + speed * move, faces, body, body + rise * move, 2 * THICKNESS)


def test_the_nearest_point_of_the_cloth_meets_a_corner(sheet):
    """In the inside of a face, with the weights of its corners there, at its height above the corner."""
    both, near = met(sheet, [0.01, -0.02, 0.01])
    assert len(both.vertices) == len(sheet.vertices) + 1
    assert near.points.tolist() == [len(sheet.vertices)]
    x = torch.tensor(square_grid(0.1, 2).rest_positions).double() + torch.tensor([0.01, -0.02, 0.0])
    torch.testing.assert_close(both.at(x)[-1], torch.zeros(3, dtype=torch.float64), atol=1e-8, rtol=0)
    torch.testing.assert_close(near.distance, torch.tensor([0.01], dtype=torch.float64))
    torch.testing.assert_close(near.end.normal[0], torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
    assert met(sheet, [0.01, -0.02, -0.01])[1].distance.item() == pytest.approx(-0.01), "and below it"


@pytest.mark.parametrize(
    ("shift", "ways", "is_met"),
    [
        ([0.0, 0.0, 0.016], (0.0, 0.0), True),
        ([0.0, 0.0, 0.018], (0.0, 0.0), False),
        ([0.0, 0.0, 0.03], (-0.014, 0.0), True),
        ([0.0, 0.0, 0.03], (0.0, 0.014), True),
        ([0.0, 0.0, 0.03], (0.014, 0.014), False),
        ([0.055, 0.0, 0.01], (0.0, 0.0), True),
        ([0.065, 0.0, 0.005], (0.0, 0.0), False),
    ],
)
def test_met_is_what_is_near_enough_and_above(sheet, shift, ways, is_met):
    """As far away as asked and as both approach; not beside the edge of the cloth."""
    assert (met(sheet, shift, *ways)[1] is not None) == is_met


def test_what_is_on_the_other_side_of_a_thin_body_is_not_met(sheet):
    """12 mm below a corner cloth is inside a body, but not of one 10 mm high: it meets the lower corner of that."""
    for flat, expected in ((1.0, -0.012), (0.01 / (0.4 * 3**0.5), 0.002)):
        near = met(sheet, [0.0, 0.0, -0.012], flat=flat)[1]
        torch.testing.assert_close(near.distance, torch.tensor([expected], dtype=torch.float64))


def test_further_points_share_what_their_face_carries(sheet):
    """Together as much as those of another kind; their stiffness goes to the corners of the face, always a piece."""
    faces, shares = torch.tensor([1, 0, 1]), torch.tensor([[0.2, 0.3, 0.5], [1.0, 0.0, 0.0], [0.0, 0.5, 0.5]]).double()
    both = sheet.with_faces(faces, shares)
    mass = torch.ones(4, dtype=torch.float64)
    carried = both.chosen(torch.arange(len(sheet.vertices), len(both.vertices)), 4).mass(mass)
    assert carried.sum() == pytest.approx(mass.sum().item() / 2)
    assert carried[0] == carried[2] == carried[1] / 2
    for some in (both, sheet.with_faces(faces[:0], shares[:0])):
        every = torch.arange(len(some.vertices))
        identity = torch.eye(3, dtype=torch.float64).expand(len(every), 3, 3)
        vertices, blocks = written_out(point_stencils(some.chosen(every, 4), identity, every))[-1]
        assert vertices is sheet.faces
        expected = torch.einsum("pa,pb->ab", shares[[0, 2]], shares[[0, 2]]) * (some is both)
        torch.testing.assert_close(blocks[1, :, 0, :, 0], expected)


def crossings_after_a_fall(contact: Contact) -> int:
    """Of faces of a coarse sheet and of a box that stands on a corner, 12 frames after the sheet fell on it."""
    mesh, body = square_grid(0.6, 6, "alternating"), obstacle(standing())
    start = State.at_rest(mesh.rest_positions + np.array([0.02, 0.03, 0.2 * 3**0.5 + 0.02]))
    masses = np.full(mesh.num_vertices, 2e-3)
    scene = Scene("fall", mesh, start, SILK, masses, GRAVITY, dt=1 / 30, frames=12, obstacle=body, friction=0.3)
    potential = IncrementalPotential.for_scene(scene, [StVK(), Bending()], contact)
    solver, state = ImplicitSolver(potential, scene, NO_ATTRIBUTES, iterations=40), start
    for frame in range(scene.frames):
        state = solver.step(state, frame).state
    barrier = Barrier(scene, 1e-3, 1e-3, 0.0)
    return len(barrier.collisions.crossings(state.x, body.at(0)).pairs)


def test_a_corner_does_not_come_through_a_coarse_cloth():
    """By vertices alone it does."""
    assert crossings_after_a_fall(SurfaceContact(stiffness=5e7, thickness=THICKNESS)) <= 1, "of an edge, 12 cm long"
    assert crossings_after_a_fall(PaperContact(stiffness=5e6, thickness=THICKNESS, reach=0.2)) > 10
