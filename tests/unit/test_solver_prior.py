"""A cheap step of the solver with a network on top: against free fall, stiff cloth and the solver itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.energy.phys_material import PhysMaterial
from drape.energy.step import ObstacleStep, Step
from drape.energy.terms.contact import SurfaceContact
from drape.geometry.grid import square_grid
from drape.geometry.nearest_faces import NearestFaces
from drape.scene.material import ATTRIBUTES
from drape.simulators.advance import advance
from drape.simulators.kinematic.prior import KinematicPrior, Nothing
from drape.simulators.neural.cloths import RecordedCloths
from drape.simulators.neural.neural import NeuralSimulator
from drape.simulators.solver.batch_solver import BatchSolver
from drape.simulators.solver.solver_prior import SolverPrior
from tests import garments
from tests.terms import make_step

CONTACT = SurfaceContact(5e7, 9.5e-3, 0.2)


class Pull(nn.Module):
    """Accelerates the first vertex along x, and remembers what it was told."""

    def __init__(self, acceleration: float):
        super().__init__()
        self.acceleration = acceleration

    def forward(self, step: Step) -> Tensor:
        self.told = step
        pulled = torch.zeros_like(step.x)
        pulled[0, 0] = self.acceleration
        return pulled * step.free[:, None]


def prior(network: nn.Module, evaluations: int = 3, contact: SurfaceContact = CONTACT) -> SolverPrior:
    return SolverPrior(network, 0.9, 16, contact, 0.02, evaluations)


def at_rest(fabric: list = (), side: float = 0.2) -> Step:
    """A flat sheet of 16 vertices without velocity; all are free."""
    step, _ = make_step(square_grid(side, 4))
    x = step.mesh.rest_positions.double()
    free = torch.ones_like(step.free)
    light = 0.02 * step.mass
    return replace(step, x=x, v=0.0 * x, mass=light, free=free, fabric=fabric, obstacle=None, external_force=None)


def test_without_a_fabric_cloth_falls_and_a_network_adds_its_acceleration():
    step = at_rest()
    fallen = step.x + step.dt**2 * step.gravity
    torch.testing.assert_close(advance(prior(Nothing()), step), fallen)
    pulled = fallen.clone()
    pulled[0, 0] += 2.0 * step.dt**2
    torch.testing.assert_close(advance(prior(Pull(2.0)), step), pulled)


def test_the_network_is_told_where_the_solver_comes_to():
    step, network = at_rest(), Pull(2.0)
    advance(prior(network), step)
    torch.testing.assert_close(network.told.inertial, step.x + step.dt**2 * step.gravity)
    assert network.told.x is step.x


def test_stiff_cloth_answers_as_a_whole():
    """A force on one vertex: its acceleration is shared, and momentum is that of the force."""
    step = at_rest(PhysMaterial.default().terms())
    moved = (advance(prior(Pull(50.0)), step) - advance(prior(Nothing()), step)) / step.dt**2
    momentum = (step.mass[:, None] * moved).sum(0)
    torch.testing.assert_close(momentum[0], step.mass[0] * 50.0, rtol=1e-6, atol=0.0)
    assert float(moved[0, 0]) < 0.5 * 50.0
    assert float(moved[1:, 0].abs().max()) > 0.5


def test_pinned_vertices_go_where_they_are_led():
    step = at_rest(PhysMaterial.default().terms())
    led = torch.zeros_like(step.v)
    led[3] = torch.tensor([0.1, 0.2, 0.3])
    step = replace(step, free=torch.arange(16) != 3, v=led)
    x = advance(prior(Pull(5.0)), step)
    torch.testing.assert_close(x[3], step.x[3] + step.dt * led[3])


def test_response_is_symmetric_and_differentiable():
    step = at_rest(PhysMaterial.default().terms())
    solver = BatchSolver(CONTACT, 0.02, 0.9, 16)
    solver.end(step, 3)
    generator = torch.Generator().manual_seed(0)
    one, other = torch.randn(2, 16, 3, generator=generator, dtype=torch.float64)
    torch.testing.assert_close(
        (one * solver.response(other, step)).sum(), (other * solver.response(one, step)).sum()
    )
    one.requires_grad_()
    assert torch.autograd.gradcheck(lambda force: 1e3 * solver.response(force, step), one)


def test_more_evaluations_come_nearer_to_balance():
    """A sheet that has been pulled apart by a tenth."""
    step = at_rest(PhysMaterial.default().terms())
    step = replace(step, x=1.1 * step.x)
    exact = advance(prior(Nothing(), 100), step)
    off = [float((advance(prior(Nothing(), count), step) - exact).norm()) for count in (2, 3, 8)]
    start = float((advance(KinematicPrior(Nothing(), 0.9, 16, 0.2), step) - exact).norm())
    assert start > off[0] > off[2]
    assert off[1] <= off[0]


def test_a_body_holds_the_cloth():
    """Cloth that falls onto a floor 2 mm below stays above it, at the vertices and between them."""
    step, floor = at_rest(PhysMaterial.default().terms()), square_grid(2.0, 2)
    below = torch.from_numpy(floor.rest_positions.astype(float)) - torch.tensor([0.31, 0.2, 0.002])
    faces = torch.from_numpy(floor.faces.copy())
    body = ObstacleStep(faces, below, below, torch.zeros(len(faces), dtype=torch.long))
    falling = replace(step, v=torch.tensor([0.0, 0.0, -1.0]).double().expand(16, 3), obstacle=body)
    x = advance(prior(Nothing(), 8), falling)
    assert float(x[:, 2].min()) > -0.002
    assert float((falling.x + falling.dt * falling.v)[:, 2].max()) < -0.02


@pytest.mark.parametrize("contact", [None, CONTACT])
def test_a_frame_searches_the_body_once(tmp_path, monkeypatch, contact):
    """And the search of the next frame is that of its own start: two searches for two frames."""
    file = GarmentFile(str(garments.write(tmp_path / "garments.h5", frames=5)))
    scene = recorded_scene(file.sequence(file.split("test")[0]))
    network = prior(Nothing()) if contact else KinematicPrior(Nothing(), 0.9, 16, 0.2)
    simulator = NeuralSimulator(network, RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0)), scene)
    asked, find = [], NearestFaces.find
    monkeypatch.setattr(NearestFaces, "find", lambda *given: asked.append(len(given[0])) or find(*given))
    state = scene.initial
    for frame in range(2):
        state = simulator.step(state, frame).state
    points = scene.mesh.num_vertices + (len(scene.mesh.edges) if contact else 0)
    assert asked == [points, points]
    assert np.isfinite(state.x).all()
