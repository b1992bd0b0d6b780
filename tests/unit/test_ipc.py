"""Nothing crosses with contact=ipc: the barrier as a term, in the solver, and where the start crosses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.step import Step
from drape.energy.terms.bending import Bending
from drape.energy.terms.contact import Contact, PaperContact
from drape.energy.terms.ipc import Barrier, IpcContact
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.rollout import first_frame
from drape.simulators.simulator import Outcome, StepResult
from drape.simulators.solver.implicit import ImplicitSolver
from tests.unit.test_contact_motion import falling
from tests.unit.test_implicit import GRAVITY, NO_ATTRIBUTES, SILK, ground

REACH = 4e-3


def ipc(**changes: float) -> IpcContact:
    settings = {"self_distance": REACH, "body_distance": 2e-3, "self_friction": 0.0, "thickness": 9e-3}
    return IpcContact(**(settings | changes))


def two_sheets(height: np.ndarray | float = 0.5 * REACH, **changes: object) -> Scene:
    """One cloth of a sheet and of a larger one below it, turned, ``height`` [m] lower; still, without gravity."""
    upper, lower = square_grid(0.3, 9), square_grid(0.5, 12)
    c, s = np.cos(0.3), np.sin(0.3)
    below = lower.rest_positions @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + [0.003, 0.007, 0]
    rest = np.concatenate([upper.rest_positions + [0, 0, 1.0], below])
    mesh = ClothMesh.from_faces(rest, np.concatenate([upper.faces, lower.faces + upper.num_vertices]))
    x = np.array(rest, np.float64)
    x[: upper.num_vertices, 2] = height
    mass = np.full(len(x), 1e-3)
    base = Scene("sheets", mesh, State.at_rest(x), SILK, mass, np.zeros(3), dt=1 / 30, frames=5)
    return replace(base, **changes)


def dented(depth: float = 0.012, **changes: object) -> Scene:
    """The upper sheet 3 mm above the lower one but for a dent, which passes through it."""
    x = two_sheets().initial.x[: 9 * 9]
    return two_sheets(0.003 - depth * np.exp(-((x[:, :2] - [0.02, 0.01]) ** 2).sum(1) / 0.05**2), **changes)


def solver_of(scene: Scene, contact: Contact, **settings: object) -> ImplicitSolver:
    potential = IncrementalPotential.for_scene(scene, [StVK(), Bending()], contact)
    return ImplicitSolver(potential, scene, NO_ATTRIBUTES, **settings)


def run(scene: Scene, contact: Contact, **settings: object) -> list[StepResult]:
    solver, state, results = solver_of(scene, contact, **settings), scene.initial, []
    for frame in range(scene.frames):
        results.append(solver.step(state, frame))
        state = results[-1].state
    return results


def crossings(scene: Scene, results: list[StepResult]) -> list[int]:
    """Pairs of faces that cross at the end of each frame."""
    count = ipc().beside(scene)[0][0].collisions.crossings
    body = scene.obstacle
    return [len(count(r.state.x, None if body is None else body.at(k + 1)).pairs) for k, r in enumerate(results)]


# The term


def barrier_step(scene: Scene, self_friction: float = 0.0) -> tuple[Barrier, Step, torch.Tensor]:
    """Of cloth that slides and wobbles a little over the step."""
    barrier = ipc(self_friction=self_friction).beside(scene)[0][0]
    step = solver_of(scene, ipc()).steps.step(scene.initial, 0.0, 1.0)
    moves = np.random.default_rng(0).uniform(-1, 1, scene.initial.x.shape)
    x_next = step.x + 2e-4 * torch.from_numpy(moves)
    x_next[:81, 0] += 5e-4
    return barrier, step, x_next


def above_floor() -> Scene:
    scene = two_sheets()
    return replace(scene, obstacle=ground(2.0, -1.5e-3))


SCENES = {"itself": two_sheets, "itself and a body": above_floor}


@pytest.mark.parametrize("self_friction", [0.0, 0.4])
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_the_gradient_is_that_of_the_energy(scene, self_friction):
    """By finite differences; the same by autograd."""
    barrier, step, x_next = barrier_step(scene(), self_friction)
    energy, gradient = barrier.energy_and_gradient(x_next, step)
    assert energy.item() > 0
    assert (energy.dtype, gradient.dtype) == (torch.float64, torch.float64)
    x = x_next.clone().requires_grad_()
    (slow,) = torch.autograd.grad(barrier(x, step).sum(), x)
    torch.testing.assert_close(slow, gradient)
    torch.manual_seed(0)
    for direction in torch.randn(4, *x_next.shape, dtype=torch.float64):
        ends = [barrier.energy_and_gradient(x_next + h * direction, step)[0].item() for h in (1e-8, -1e-8)]
        assert (gradient * direction).sum().item() == pytest.approx((ends[0] - ends[1]) / 2e-8, rel=1e-4)


@pytest.mark.parametrize("self_friction", [0.0, 0.4])
@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_the_hessian_is_positive(scene, self_friction):
    """The upper triangle of a matrix without negative eigenvalues."""
    barrier, step, x_next = barrier_step(scene(), self_friction)
    upper = barrier.loose_hessian(x_next, step).toarray()
    assert upper.shape == (x_next.numel(), x_next.numel())
    assert abs(np.tril(upper, -1)).max() == 0.0
    values = np.linalg.eigvalsh(upper, UPLO="U")
    assert values[-1] > 1.0
    assert values[0] > -1e-9 * values[-1]


def test_the_same_call_gives_the_same_to_the_last_bit():
    """After searches anew as well; sums of several threads would not."""
    barrier, step, x_next = barrier_step(dented(0.002), 0.4)
    answers = set()
    for _ in range(15):
        barrier.collisions.forget()
        energy, gradient = barrier.energy_and_gradient(x_next, step)
        matrix = barrier.loose_hessian(x_next, step)
        answers.add((energy.item(), gradient.numpy().tobytes(), matrix.data.tobytes()))
    assert len(answers) == 1


def test_apart_there_is_nothing():
    barrier, step, x_next = barrier_step(two_sheets(1.01 * REACH + 1e-3), 0.4)
    energy, gradient = barrier.energy_and_gradient(x_next, step)
    assert energy.item() == 0.0
    assert gradient.abs().max() == 0.0
    assert barrier.loose_hessian(x_next, step).nnz == 0


def test_far_from_the_origin_the_barrier_is_the_same():
    here, there = two_sheets(), two_sheets()
    there = replace(there, initial=State.at_rest(there.initial.x + [1e4, -1e4, 1e4]))
    forces = [solver_of(scene, ipc()).potential.barrier for scene in (here, there)]
    steps = [solver_of(scene, ipc()).steps.step(scene.initial, 0.0, 1.0) for scene in (here, there)]
    near, far = (barrier.energy_and_gradient(step.x, step)[1] for barrier, step in zip(forces, steps, strict=True))
    assert (far - near).norm() < 1e-6 * near.norm()


def test_ways_are_free_up_to_what_they_meet():
    """Of the cloth beside a body that has moved, and of both."""
    scene = two_sheets(0.03)
    barrier, step, _ = barrier_step(scene)
    down = step.x.clone()
    down[:81, 2] -= 0.06
    assert 0.4 < barrier.free_share(step.x, down, step) < 0.5
    assert barrier.free_share(step.x, step.x + 1.0, step) == 1.0
    floor = ground(2.0, -0.05)
    rising = Obstacle(floor.faces, floor.positions + np.arange(6)[:, None, None] * [0, 0, 0.1])
    barrier, step, _ = barrier_step(replace(scene, obstacle=rising))
    assert 0.4 < barrier.share_beside_body(step.x, step.x, step) < 0.5
    assert barrier.share_beside_body(step.x, step.x + torch.tensor([0.0, 0.0, 0.1]), step) == 1.0


def test_the_barrier_is_as_stiff_as_the_cloth_is_heavy_and_as_long_as_the_scene_is_large():
    scene = two_sheets()
    forces = []
    for times in (1.0, 500.0):
        barrier, step, x_next = barrier_step(replace(scene, mass=times * scene.mass))
        forces.append(barrier.energy_and_gradient(x_next, step)[1])
    torch.testing.assert_close(forces[1], 500.0 * forces[0])
    large = ipc().beside(replace(scene, enlarged=5.0))[0][0]
    assert large.collisions.cloth.reach == pytest.approx(5 * REACH)


def test_mistakes_are_sentences():
    for changes, words in (({"self_friction": -1.0}, "self_friction"), ({"self_distance": 0.0}, "reach")):
        with pytest.raises(DrapeError, match=words):
            ipc(**changes).beside(two_sheets())


# In the solver


def folding(frames: int = 8) -> Scene:
    """A sheet folded over itself, not quite along its middle, that falls on a floor."""
    mesh = square_grid(0.5, 8)
    x = np.array(mesh.rest_positions, np.float64)
    over = np.maximum(x[:, 0] + 0.1 * x[:, 1], 0.0)
    x[:, 0] -= 1.9 * over
    x[:, 2] += 0.3 * over + 0.02
    return Scene(
        "folding", mesh, State.at_rest(x), SILK, np.full(len(x), 2e-3), GRAVITY, dt=1 / 30, frames=frames,
        obstacle=ground(2.0, 0.0), friction=0.3,
    )  # fmt: skip


def test_a_folded_sheet_never_crosses_itself():
    """It does so without the barrier."""
    scene = folding()
    assert crossings(scene, run(scene, ipc())) == [0] * scene.frames
    assert max(crossings(scene, run(scene, PaperContact(5e6, 9e-3, 0.2)))) > 5


def test_a_fast_sphere_never_crosses_the_sheet():
    """20 cm a frame: steps are cut, or it would be inside. It passes through the sheet where vertices alone are met."""
    scene = falling(resolution=7, subdivisions=1, sway=[0.6, 0.0, 0.3], period=0.4, frames=3)
    results = run(scene, ipc())
    assert crossings(scene, results) == [0] * scene.frames
    assert all(np.isfinite(each.residual) for each in results)
    assert max(crossings(scene, run(scene, PaperContact(5e6, 9e-3, 0.2)))) > 5


def test_interrupted_after_every_frame_is_as_never_interrupted():
    """To the last bit, each frame by another solver."""
    scene = folding(4)
    straight, state = run(scene, ipc(self_friction=0.2), iterations=40), scene.initial
    for frame in range(scene.frames):
        one = solver_of(scene, ipc(self_friction=0.2), iterations=40).step(state, frame)
        state = one.state
        assert np.array_equal(state.x, straight[frame].state.x)
        assert np.array_equal(state.v, straight[frame].state.v)
        assert (one.iterations, one.residual) == (straight[frame].iterations, straight[frame].residual)


# Where the start crosses


def test_a_start_that_crosses_is_untangled_and_stopped():
    """The lower sheet is pinned, and stays."""
    scene = dented(pins=Pins.fixed(np.arange(81, 81 + 144), dented().initial.x))
    scene = replace(scene, initial=replace(scene.initial, v=np.ones_like(scene.initial.x)))
    barrier = ipc().beside(scene)[0][0]
    assert len(barrier.collisions.crossings(scene.initial.x).pairs) > 10
    start = first_frame(scene, barrier)
    assert len(barrier.collisions.crossings(start.x).pairs) == 0
    moved = (start.x != scene.initial.x).any(axis=1)
    assert 0 < moved.sum() < len(moved)
    assert not moved[81:].any()
    assert (start.v[moved] == 0).all()
    assert (start.v[~moved] == 1).all()
    assert np.array_equal(first_frame(scene).x, scene.initial.x), "without a barrier it is left as it is"


def test_cloth_that_crosses_a_body_at_the_start_is_moved_out():
    """Its vertices are outside, and an edge of it cuts through a ridge."""
    scene = two_sheets(0.2)
    corners = np.array([[-1.0, 0.02, -0.1], [1.0, 0.02, -0.1], [0.0, 0.02, 0.004], [0.0, 1.02, -0.1]])
    body = Obstacle(np.array([[0, 1, 2], [1, 3, 2], [3, 0, 2], [0, 3, 1]]), corners[None])
    scene = replace(scene, obstacle=body)
    barrier = ipc().beside(scene)[0][0]
    pushed = first_frame(scene).x
    assert len(barrier.collisions.crossings(pushed, body.at(0)).pairs) > 0
    start = first_frame(scene, barrier)
    assert len(barrier.collisions.crossings(start.x, body.at(0)).pairs) == 0


def test_where_a_body_leaves_no_room_cloth_goes_on_and_says_so():
    """Two blocks close on a sheet and pass through each other: what crosses then is told, and nothing breaks."""
    below = trimesh.creation.box((0.6, 0.6, 0.1))
    below.apply_translation([0.0, 0.0, -0.06])
    faces = np.array(below.faces)
    count, start = len(below.vertices), np.array(below.vertices)
    heights = [0.12, 0.11, 0.02, 0.02]
    bodies = np.stack([np.concatenate([start, start + [0.0, 0.0, height]]) for height in heights])
    sheet = square_grid(0.3, 5)
    scene = Scene(
        "pressed", sheet, State.at_rest(np.array(sheet.rest_positions, np.float64)), SILK, np.full(25, 1e-3),
        np.zeros(3), dt=1 / 30, frames=3, obstacle=Obstacle(np.concatenate([faces, faces + count]), bodies),
    )  # fmt: skip
    results = run(scene, ipc(), iterations=30)
    assert all(np.isfinite(result.state.x).all() for result in results)
    assert [n > 0 for n in crossings(scene, results)] == [r.outcome is Outcome.BLOCKED for r in results]
    assert results[-1].outcome is Outcome.BLOCKED
