"""The solver on cases with a known answer, and what it promises of every other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import optimize

from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.terms.bending import Bending
from drape.energy.terms.contact import SurfaceContact
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.nearest_faces import NearestFaces
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.simulator import Outcome
from drape.simulators.solver.implicit import ImplicitSolver

GRAVITY = np.array([0.0, 0.0, -9.81])
SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
NO_ATTRIBUTES = torch.zeros(5, dtype=torch.float64)


def scene_of(resolution: int = 8, **changes: object) -> Scene:
    mesh = square_grid(1.0, resolution)
    rest = mesh.rest_positions.astype(np.float64)
    mass = np.full(len(rest), 0.01)
    base = Scene("test", mesh, State.at_rest(rest), SILK, mass, GRAVITY, dt=1 / 30, frames=30)
    return replace(base, **changes)


def solver_of(scene: Scene, **settings: object) -> ImplicitSolver:
    potential = IncrementalPotential.for_scene(scene, [StVK(), Bending()])
    return ImplicitSolver(potential, scene, NO_ATTRIBUTES, **settings)


def run(scene: Scene, frames: int, **settings: object) -> list:
    solver, state, results = solver_of(scene, **settings), scene.initial, []
    for frame in range(frames):
        results.append(solver.step(state, frame))
        state = results[-1].state
    return results


def cloth_energy(scene: Scene, state: State) -> float:
    """Kinetic, gravitational and elastic [J]."""
    step = solver_of(scene).steps.step(state, 0.0, 1.0)
    elastic = sum(float(term(step.x, step)) for term in (StVK(), Bending()))
    kinetic = 0.5 * (scene.mass[:, None] * state.v**2).sum()
    return kinetic - (scene.mass[:, None] * state.x * scene.gravity).sum() + elastic


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_free_fall_is_that_of_implicit_euler(precision):
    scene = scene_of()
    results = run(scene, 10, precision=precision, tolerance=1e-6)
    fallen = sum(k * 9.81 / 30**2 for k in range(1, 11))
    expected = scene.initial.x - np.array([0.0, 0.0, fallen])
    np.testing.assert_allclose(results[-1].state.x, expected, atol=1e-9 if precision == "float64" else 1e-5)
    assert results[-1].outcome in (Outcome.CONVERGED, Outcome.PRECISION)


def test_a_hanging_cloth_comes_to_rest_where_forces_balance():
    top = np.arange(8)
    scene = scene_of(dt=1.0)  # long steps damp the swinging
    scene = replace(scene, pins=Pins.fixed(top, scene.initial.x))
    results = run(scene, 60, tolerance=1e-9)
    last = results[-1].state
    assert np.abs(last.v).max() < 1e-3
    hanging = scene.mass.sum() - scene.mass[top].sum()
    step = solver_of(scene).steps.step(last, 0.0, 1.0)
    total = sum(term.energy_and_gradient(step.x, step)[1] for term in (StVK(), Bending()))
    np.testing.assert_allclose(total.numpy()[top].sum(0), -hanging * GRAVITY, rtol=1e-3, atol=1e-3)


def test_two_budgets_reach_the_same_minimum():
    scene = scene_of()
    scene = replace(scene, pins=Pins.fixed(np.array([0, 7]), scene.initial.x))
    exact = run(scene, 5, tolerance=1e-10, iterations=500)
    usual = run(scene, 5, tolerance=1e-6)
    np.testing.assert_allclose(exact[-1].state.x, usual[-1].state.x, atol=1e-4)
    assert exact[-1].residual < 1e-9


def test_any_budget_gives_a_usable_frame():
    scene = scene_of()
    scene = replace(scene, pins=Pins.fixed(np.array([0, 7]), scene.initial.x))
    results = run(scene, 20, iterations=3)
    assert all(np.isfinite(r.state.x).all() and r.iterations <= 5 for r in results)
    assert np.abs(results[-1].state.x).max() < 3
    assert Outcome.ITERATIONS in {r.outcome for r in results}
    assert "simulator.iterations" in Outcome.ITERATIONS.value


@pytest.mark.parametrize("dt", [0.1, 1 / 30, 1 / 960])
@pytest.mark.parametrize("stretch", [0.01, 3.0])
def test_without_work_from_outside_energy_never_grows(dt, stretch):
    scene = scene_of(gravity=np.zeros(3), dt=dt)
    rng = np.random.default_rng(0)
    start = State.at_rest(stretch * scene.initial.x + 0.01 * rng.normal(size=scene.initial.x.shape))
    energies = [cloth_energy(scene, start)]
    state, solver = start, solver_of(scene)
    for frame in range(8):
        state = solver.step(state, frame).state
        energies.append(cloth_energy(scene, state))
    assert (np.diff(energies) <= 1e-9 * energies[0]).all()


def test_far_from_the_origin_nothing_changes():
    scene = scene_of()
    scene = replace(scene, pins=Pins.fixed(np.array([0, 7]), scene.initial.x))
    offset = np.array([1e4, -1e4, 1e4])
    far = replace(scene, initial=State.at_rest(scene.initial.x + offset), pins=None)
    far = replace(far, pins=Pins.fixed(np.array([0, 7]), far.initial.x))
    near, away = run(scene, 5, tolerance=1e-9), run(far, 5, tolerance=1e-9)
    np.testing.assert_allclose(away[-1].state.x - offset, near[-1].state.x, atol=1e-6)


def test_pinned_vertices_are_exactly_where_they_shall_be():
    scene = scene_of()
    path = np.stack([scene.initial.x[[0, 7]] + [0.0, 0.01 * k, 0.0] for k in range(31)])
    scene = replace(scene, pins=Pins(np.array([0, 7]), path))
    for frame, result in enumerate(run(scene, 5)):
        np.testing.assert_array_equal(result.state.x[[0, 7]], path[frame + 1])


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_a_frame_is_cut_into_equal_steps_of_implicit_euler(steps):
    """Free fall of n steps in all: ``g h² n (n + 1) / 2`` with h = dt / steps; and pins on their straight way."""
    results = run(scene_of(), 5, tolerance=1e-9, steps=steps)
    n, h = 5 * steps, 1 / 30 / steps
    fallen = scene_of().initial.x[:, 2] - results[-1].state.x[:, 2]
    np.testing.assert_allclose(fallen, 9.81 * h**2 * n * (n + 1) / 2, atol=1e-9)
    np.testing.assert_allclose(results[-1].state.v[:, 2], -9.81 * h * n, atol=1e-7)
    assert {r.steps for r in results} == {steps}


def test_what_a_stretched_sheet_releases_becomes_motion():
    """It begins to contract, and is as fast as it has moved; its kinetic energy is a part of what it had stored."""
    stretched = scene_of(gravity=np.zeros(3))
    stretched = replace(stretched, initial=State.at_rest(1.1 * stretched.initial.x))
    (result,) = run(stretched, 1, tolerance=1e-9)
    moved = result.state.x - stretched.initial.x
    assert np.abs(moved).max() > 1e-3
    np.testing.assert_allclose(result.state.v, moved / stretched.dt, atol=1e-12)


def test_between_frames_pins_and_body_are_on_a_straight_way():
    """A quarter of the way from frame 2 to frame 3; at whole frames they are exactly where they are given."""
    scene, ramp = scene_of(frames=4), np.arange(5.0)[:, None, None] ** 2
    path, floor = scene.initial.x[[0, 7]] + ramp * [0.0, 0.1, 0.0], ground(2.0, -1.0)
    body = Obstacle(floor.faces, floor.positions + ramp * [0.0, 0.0, 0.01])
    steps = solver_of(replace(scene, pins=Pins(np.array([0, 7]), path), obstacle=body)).steps
    np.testing.assert_allclose(steps.pin_targets(2.25), 0.75 * path[2] + 0.25 * path[3])
    np.testing.assert_allclose(steps.body(2.25)[:, 2], -1.0 + 0.01 * (0.75 * 4 + 0.25 * 9))
    np.testing.assert_array_equal(steps.pin_targets(3.0), path[3])
    step = steps.step(scene.initial, 2.25, 3.0)
    ends = [part[0, 2].item() + steps.origin(scene.initial)[2] for part in (step.obstacle.x, step.obstacle.x_next)]
    assert ends == pytest.approx([-0.9475, -0.91])


def test_a_scene_of_cloth_alone_has_no_pins_and_nothing_near():
    scene = scene_of()
    steps = solver_of(scene).steps
    step = steps.step(scene.initial, 0.0, 1.0)
    assert steps.pin_targets(1.0).shape == (0, 3)
    assert steps.with_near_at(step, step.x, scene.initial.x, 1.0) is step
    assert SurfaceContact().sharp_points(scene) is None


def ground(size: float, height: float) -> Obstacle:
    corners = np.array([[-size, -size, height], [size, -size, height], [size, size, height], [-size, size, height]])
    return Obstacle(np.array([[0, 1, 2], [0, 2, 3]]), corners[None])


def test_cloth_comes_to_rest_on_the_ground_and_not_below():
    scene = scene_of(obstacle=ground(2.0, -0.05), friction=0.5)
    results = run(scene, 40)
    heights = np.array([r.state.x[:, 2] for r in results])
    assert heights.min() > -0.05
    assert np.abs(results[-1].state.v).max() < 0.02
    weight, potential = 0.01 * 9.81, solver_of(scene).potential
    depth = potential.contact.thickness - (heights[-1] + 0.05)
    stiffness = potential.contact.stiffness * 0.01
    np.testing.assert_allclose((3.0 * stiffness * depth**2).mean(), weight, rtol=0.05)


def test_where_no_evaluation_is_left_cloth_is_where_the_body_carries_it():
    """Two starts and no more: ground that rises by 0.1 m and moves aside by as much takes its cloth along."""
    before = ground(2.0, -0.02)
    moving = Obstacle(before.faces, np.concatenate([before.positions, before.positions + [0.1, 0.0, 0.1]]))
    scene = scene_of(obstacle=moving, friction=0.5, frames=1)
    (result,) = run(scene, 1, iterations=2)
    assert result.iterations == 2
    share = 0.9 * (1 - (0.02 / solver_of(scene).potential.contact.reach) ** 2)
    moved = result.state.x - scene.initial.x
    np.testing.assert_allclose(moved, np.tile([0.1 * share, 0.0, 0.1 * share], (64, 1)), atol=1e-6)


@pytest.mark.parametrize(("settings", "count"), [({"iterations": 4}, 3), ({"tolerance": 100.0}, 0)])
def test_each_step_has_factors_of_its_own_unless_it_starts_at_the_minimum(settings, count):
    stretched = State.at_rest(scene_of().initial.x * [1.3, 1.0, 1.0])
    solver, state = solver_of(scene_of(initial=stretched), **settings), stretched
    for frame in range(3):
        state = solver.step(state, frame).state
    assert solver._minimiser.factorisations == count


def test_only_what_the_scene_requires():
    names = IncrementalPotential.for_scene(scene_of(gravity=np.zeros(3)), [StVK()]).names
    assert names == ["inertia", "stvk"]
    force = np.zeros((64, 3))
    full = scene_of(external_force=force, obstacle=ground(1.0, -1.0), friction=0.3)
    potential = IncrementalPotential.for_scene(full, [StVK()])
    assert potential.names == ["inertia", "gravity", "external", "stvk", "contact", "friction"]
    assert set(potential.reasons) == set(potential.names)
    smooth = IncrementalPotential.for_scene(replace(full, friction=None), [StVK()])
    assert "friction" not in smooth.names


def test_without_a_body_nothing_is_searched(monkeypatch):
    monkeypatch.setattr(NearestFaces, "find", lambda *_: pytest.fail("nearest faces were searched"))
    run(scene_of(), 2)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"iterations": 0}, r"simulator\.iterations: found 0; expected a whole number from 1 on"),
        ({"steps": 0}, r"simulator\.steps: found 0"),
        ({"precision": "float16"}, r"simulator\.precision: found 'float16'; expected float32 or float64"),
        ({"tolerance": 0.0}, r"simulator\.tolerance: found 0\.0; expected newtons"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, sentence):
    with pytest.raises(DrapeError, match=sentence):
        solver_of(scene_of(), **settings)


def test_hanging_springs_carry_the_weight():
    """A weight on two springs from pinned corners, as deep as their tension along the vertical holds it."""
    rest = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, -1.0]])
    depth, mass = 1.1, 2.0
    length, rest_length = np.hypot(0.5, depth), np.hypot(0.5, 1.0)
    stiffness = mass * 9.81 / (2.0 * (length - rest_length) * depth / length)
    mesh = ClothMesh.from_faces(rest, np.array([[0, 1, 2]]))
    scene = Scene(
        "springs", mesh, State.at_rest(rest), SILK, np.full(3, mass), GRAVITY, dt=1.0, frames=40,
        pins=Pins.fixed(np.array([0, 1]), rest[:2]),
    )  # fmt: skip
    constants = torch.tensor([[0.0, 0.0, stiffness, 0.0, 0.0, 0.0, 5.0, 0.0]], dtype=torch.float64)
    law = SpringHingeLaw(constants).of_fabric(0, SILK, face_area=0.5, dt=1e-4)
    terms = [HingeElastic(law, transfer=False), Damping(law, transfer=False)]
    potential = IncrementalPotential.for_scene(scene, terms)
    solver, state = ImplicitSolver(potential, scene, NO_ATTRIBUTES, tolerance=1e-10), scene.initial
    for frame in range(scene.frames):
        state = solver.step(state, frame).state
    np.testing.assert_allclose(state.x, [*rest[:2], [0.5, 0.0, -depth]], atol=1e-8)


def test_another_solver_finds_the_same_minimum():
    scene = scene_of(5)
    scene = replace(scene, pins=Pins.fixed(np.array([0, 4]), scene.initial.x))
    solver = solver_of(scene, tolerance=1e-10)
    found = solver.step(scene.initial, 0)
    step, potential = solver.steps.step(scene.initial, 0.0, 1.0), solver.potential
    free = step.free.numpy()

    def at(values: np.ndarray) -> torch.Tensor:
        x = step.x.clone()
        x[step.free] = torch.from_numpy(values.reshape(-1, 3))
        return x

    def energy_and_slope(values: np.ndarray) -> tuple[float, np.ndarray]:
        there = potential.evaluate(at(values), step)
        return there.energy, there.gradient.numpy()[free].reshape(-1)

    start = step.x.numpy()[free].reshape(-1)
    other = optimize.minimize(energy_and_slope, start, jac=True, method="L-BFGS-B", options={"ftol": 0, "gtol": 1e-9})
    x = at(other.x).numpy() + solver.steps.origin(scene.initial)
    np.testing.assert_allclose(found.state.x, x, atol=1e-6)
    assert sum(found.energies.values()) == pytest.approx(other.fun, abs=1e-10)
