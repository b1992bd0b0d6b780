"""Steps of simulators whose end can be worked out by hand: which frame of body and pins, which power of dt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from drape.data.garment_datamodule import GarmentDataModule
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.step import Step
from drape.energy.terms.bending import Bending
from drape.energy.terms.free_motion import Gravity, Inertia
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import ATTRIBUTES
from drape.scene.state import State
from drape.simulators.advance import advance
from drape.simulators.baselines import Ballistic, Frozen, Skinned
from drape.simulators.kinematic import edge_lengths
from drape.simulators.kinematic.edge_lengths import _next_weight, nearer_to_rest
from drape.simulators.kinematic.prior import KinematicPrior, Nothing
from drape.simulators.neural.cloths import Cloth, RecordedCloths, forced
from drape.simulators.neural.graph_acceleration import _along_edges
from drape.simulators.neural.neural import NeuralSimulator
from drape.simulators.neural.phys_cloths import PhysCloths
from drape.simulators.neural.rollout_step import rollout_step
from drape.simulators.solver.balance import mean_weight
from drape.simulators.solver.energy_limit import without_gain
from tests import garments
from tests.terms import make_step

CLOTHS = RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0))


class Says(nn.Module):
    """Keeps the steps that it is asked for, and accelerates by (0, 0, 5)."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def forward(self, step):
        self.seen.append(step)
        return torch.tensor([0.0, 0.0, 5.0], dtype=step.x.dtype).expand_as(step.x)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> GarmentFile:
    return GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=8))


@pytest.fixture(scope="module")
def skirt(file):
    """With a pinned top and a body that moves."""
    return recorded_scene(file.sequence("00002"))


def flat(**changes: object) -> Step:
    """A sheet at rest of 4 x 4 vertices of 2 kg, a step of a tenth of a second."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 4)])
    x = mesh.rest_positions
    given = {
        "mesh": mesh, "x": x, "v": 0.0 * x, "mass": torch.full((16,), 2.0).double(), "dt": 0.1,
        "free": torch.ones(16, dtype=torch.bool), "attributes": torch.ones(1, 5).double(), "gravity": 0.0 * x[0],
    }  # fmt: skip
    return Step(**(given | changes))


# Networks


def test_a_step_adds_velocity_and_acceleration():
    """0.1 s at 3 m/s, and 5 m/s² · (0.1 s)²."""
    step = flat(v=torch.tensor([3.0, 0.0, 0.0]).double().expand(16, 3))
    moved = advance(Says(), step) - step.x
    torch.testing.assert_close(moved, torch.tensor([0.3, 0.0, 0.05]).double().expand(16, 3))


def test_steps_of_a_rollout_have_the_frames_of_their_own_time(file):
    """Body from t + k to t + k + 1; pinned vertices are led to where the data have them then; the cloth's own mass."""
    data = GarmentDataModule(str(file.path), ["silk"], "recorded", 3, 1, seed=0)
    rollout = data.rollout(np.array([2]))
    rollout = replace(rollout, free=torch.arange(len(rollout.free)) >= 14)
    cloth = CLOTHS.draw(rollout, data.materials, torch.Generator())
    for k in range(3):
        x, v = rollout.x[k + 1] + 0.01, torch.full_like(rollout.x[0], 0.5)
        step = rollout_step(rollout, k, x, v, cloth)
        assert torch.equal(step.obstacle.x, rollout.body[k + 1])
        assert torch.equal(step.obstacle.x_next, rollout.body[k + 2])
        torch.testing.assert_close((x + rollout.dt * step.v)[:14], rollout.x[k + 2][:14])
        assert torch.equal(step.v[14:], v[14:])
        assert torch.equal(step.mass, cloth.mass)


def test_a_network_animates_with_the_body_and_the_pins_of_each_frame(skirt):
    """Frame k: body from k to k + 1, pins at k + 1, velocities those of the step, places in the world."""
    network = Says()
    simulator, state = NeuralSimulator(network, CLOTHS, skirt), skirt.initial
    for frame in range(3):
        before, state = state, simulator.step(state, frame).state
        step, origin = network.seen[-1], before.x.mean(axis=0)
        np.testing.assert_allclose(step.obstacle.x.numpy() + origin, skirt.obstacle.at(frame), atol=1e-12)
        np.testing.assert_allclose(step.obstacle.x_next.numpy() + origin, skirt.obstacle.at(frame + 1), atol=1e-12)
        np.testing.assert_allclose(state.x[garments.TOP], skirt.pins.at(frame + 1))
        np.testing.assert_allclose(state.v, (state.x - before.x) * garments.FPS)
        free = np.setdiff1d(np.arange(len(state.x)), garments.TOP)
        fallen = before.x + skirt.dt * (before.v + skirt.dt * np.array([0.0, 0.0, 5.0]))
        np.testing.assert_allclose(state.x[free], fallen[free], atol=1e-12)


def test_answers_of_edges_pull_along_them():
    """There 1, back 3: 2 along each edge, opposite at its ends; the directions are those without forces."""
    step = flat(v=torch.stack([flat().x[:, 0], 0.0 * flat().x[:, 0], 0.0 * flat().x[:, 0]], 1))
    first, second = step.mesh.edges.T
    found = _along_edges(torch.tensor([1.0, 3.0]).double().repeat_interleave(len(first)), step)
    flown = step.x + 0.1 * step.v
    arm = torch.nn.functional.normalize(flown[second] - flown[first], dim=-1)
    expected = torch.zeros_like(step.x)
    for edge, (i, j) in enumerate(step.mesh.edges.tolist()):
        expected[i] += 2.0 * arm[edge]
        expected[j] -= 2.0 * arm[edge]
    torch.testing.assert_close(found, expected)


def test_a_prior_brings_edges_back_within_the_step():
    """Its acceleration is that after which the cloth is where the rounds leave it, whatever dt is."""
    step = flat(x=1.1 * flat().x, dt=0.5)
    x_next = advance(KinematicPrior(Nothing(), 0.0, 8, 0.1), step)
    expected = nearer_to_rest(step.x, step.mesh, step.free, 8)
    torch.testing.assert_close(x_next, expected)


def test_a_round_takes_the_mean_of_what_the_edges_want():
    """One edge of 1 m stretched to 1.5 at a vertex with n edges: it moves by 0.5/n of a metre towards the other end."""
    mesh = flat().mesh
    x, first, second = mesh.rest_positions.clone(), *mesh.edges[0].tolist()
    only = torch.zeros(16, dtype=torch.bool)
    only[first] = True
    degree = int((mesh.edges == first).sum())
    grown = mesh.rest_lengths.clone()
    grown[0] *= 0.5
    found = nearer_to_rest(x, replace(mesh, rest_lengths=grown), only, 1)
    arm = x[second] - x[first]
    torch.testing.assert_close(found[first] - x[first], 0.5 * arm / degree)
    torch.testing.assert_close(found[~only], x[~only])


def test_rounds_have_the_weights_of_chebyshev():
    """Of radius 0.97: 1, 2/(2 - 0.97²), then 4/(4 - 0.97² w)."""
    second = 2.0 / (2.0 - 0.9409)
    assert [_next_weight(k, w) for k, w in ((0, 1.0), (1, 1.0), (2, second), (3, 1.5))] == pytest.approx(
        [1.0, second, 4.0 / (4.0 - 0.9409 * second), 4.0 / (4.0 - 0.9409 * 1.5)]
    )


def test_kernel_and_tensors_relax_alike(monkeypatch):
    """Positions and their derivative, of the kernels and of the operations on tensors that a GPU runs."""
    mesh, free = flat().mesh, torch.arange(16) > 2
    towards = torch.randn(16, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)

    def relaxed() -> tuple[Tensor, Tensor]:
        x = (flat().x * torch.tensor([1.3, 0.8, 1.0]).double()).requires_grad_()
        after = nearer_to_rest(x, mesh, free, 9)
        (after * towards).sum().backward()
        return after.detach(), x.grad

    by_kernel = relaxed()
    monkeypatch.setattr(edge_lengths, "_Compiled", edge_lengths._OnTensors)
    torch.testing.assert_close(relaxed(), by_kernel)


# Cloths


def test_forces_go_with_mass(file):
    """Vertices of 1, 2, 3, ... g of one garment: one force per mass."""
    data = GarmentDataModule(str(file.path), ["silk"], "recorded", 3, 1, seed=0)
    rollout = data.rollout(np.array([0]))
    mass = 1e-3 * torch.arange(1, len(rollout.free) + 1).double()
    cloth = forced(Cloth(torch.ones(1, 5).double(), mass, []), rollout, 2.0, torch.Generator().manual_seed(0))
    per_mass = cloth.external_force / mass[:, None]
    torch.testing.assert_close(per_mass, per_mass[:1].expand_as(per_mass))
    assert 0.0 < float(per_mass[0].norm()) <= 2.0


def test_garments_of_a_batch_have_the_mass_of_their_own_fabric(file):
    data = GarmentDataModule(str(file.path), ["silk", "denim"], "recorded", 3, 1, seed=0)
    rollout = replace(data.rollout(np.array([0, 1])), fabrics=("silk", "denim"))
    mass = CLOTHS.draw(rollout, data.materials, torch.Generator()).mass
    own = [mass[rollout.mesh.mesh_of_vertex == k].unique().tolist() for k in range(2)]
    assert own == [[data.materials[name].mass_per_vertex] for name in ("silk", "denim")]
    assert own[0] != own[1]


def test_phys_weighs_by_area(file):
    """All vertices together: the density that was drawn times the area of the garment."""
    data = GarmentDataModule(str(file.path), ["silk"], "recorded", 3, 1, seed=0)
    rollout, cloths = data.rollout(np.array([0])), PhysCloths(None)
    cloth = cloths.draw(rollout, data.materials, torch.Generator().manual_seed(3))
    density = cloth.terms[0]
    assert density.name == "stvk"
    area = float(rollout.mesh.rest_faces.area.sum())
    low, high = 4.34e-2, 7e-1
    position = float(cloth.attributes[0, 0])
    assert float(cloth.mass.sum()) / area == pytest.approx(low * (high / low) ** position)


# Baselines


def test_baselines_move_as_their_formulas_say(file, skirt):
    """Pins as led in the frame that is reached; velocities those of the step; the rest flies, or stays."""
    sequence, free = file.sequence("00002"), np.setdiff1d(np.arange(70), garments.TOP)
    state = State(skirt.initial.x, np.full((70, 3), [0.3, 0.0, 0.0]))
    dt = 1.0 / garments.FPS
    expected = {Ballistic: state.x + dt * np.array([0.3, 0, 0]) + dt**2 * np.array([0, 0, -9.81]), Frozen: state.x}
    for kind, x in expected.items():
        for frame in (0, 2):
            found = kind(skirt, sequence).step(state, frame).state
            np.testing.assert_allclose(found.x[free], x[free], atol=1e-12)
            np.testing.assert_allclose(found.x[garments.TOP], skirt.pins.at(frame + 1))
            np.testing.assert_allclose(found.v, (found.x - state.x) / dt)


def test_a_skinned_garment_goes_with_its_joint_frame_by_frame(file):
    """The first frame of the scene, carried from recorded frame 1 to frame k + 1 by one joint."""
    sequence = file.sequence("00001")
    scene = recorded_scene(sequence)
    moves, start = garments.transforms(8)[:, 0], scene.initial.x
    local = np.linalg.solve(moves[1], np.c_[start, np.ones(len(start))].T)
    for frame in range(scene.frames):
        found = Skinned(scene, sequence).step(scene.initial, frame).state.x
        np.testing.assert_allclose(found, (moves[frame + 2] @ local)[:3].T, atol=1e-6)


# Solver


def test_the_weight_is_the_mean_of_free_vertices(skirt):
    """Pinned vertices of 100 kg do not count; 20 g of the others do."""
    mass = np.full(70, 0.02)
    mass[garments.TOP] = 100.0
    assert mean_weight(replace(skirt, mass=mass)) == pytest.approx(0.02 * 9.81)
    assert mean_weight(replace(skirt, mass=mass, gravity=np.zeros(3))) == pytest.approx(0.02 * 9.81)


def test_prices_of_motions_are_not_stored():
    step, x_next = make_step(square_grid(0.5, 4))
    found = IncrementalPotential([Inertia(), Gravity(), Bending(1e-3)]).evaluate(x_next, step)
    assert found.terms["inertia"] > 0.0
    assert found.stored == pytest.approx(found.terms["gravity"] + found.terms["bending"])


def test_what_is_gained_is_taken_from_the_motion_about_the_centre():
    """Two vertices of 1 kg. Before (1, 1) m/s: 1 J; after (3, -1): 5 J, of which 1 J of the centre; 2 J are released.

    So 3 J may be left: 2 J about the centre instead of 4, a factor of √½. With a pin the whole is slowed: √(3/5).
    """
    x, mass, both = np.zeros((2, 3)), np.ones(2), np.ones(2, bool)
    before, after = State(x, np.array([[1.0, 0, 0], [1, 0, 0]])), State(x, np.array([[3.0, 0, 0], [-1, 0, 0]]))
    free = without_gain(before, after, 2.0, mass, both, 0.0)
    np.testing.assert_allclose(free.v[:, 0], 1.0 + 2.0 * np.sqrt(0.5) * np.array([1.0, -1.0]))
    pinned = without_gain(before, after, 2.0, mass, np.array([True, False]), 0.0)
    np.testing.assert_allclose(pinned.v, np.sqrt(3.0 / 5.0) * after.v)
    assert without_gain(before, after, 4.0, mass, both, 1e-9) is after
