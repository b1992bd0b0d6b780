"""Rollouts, losses and steps of neural simulators against what is known of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from drape.data.garment_datamodule import GarmentDataModule
from drape.data.hdf5 import GarmentFile
from drape.data.motion import edge_strain
from drape.data.recorded_scene import recorded_scene
from drape.energy.fabric import Fabric
from drape.energy.phys_material import PhysMaterial
from drape.energy.terms.contact import SurfaceContact
from drape.energy.terms.free_motion import Gravity, Inertia
from drape.errors import DrapeError
from drape.loss.collision import Collision
from drape.loss.position import Position
from drape.loss.potential import Potential
from drape.loss.prediction import Prediction
from drape.scene.material import ATTRIBUTES, Material
from drape.simulators.advance import advance
from drape.simulators.neural.cloths import LearnedCloths, RecordedCloths
from drape.simulators.neural.kinematic import kinematic
from drape.simulators.neural.neural import NeuralSimulator
from drape.simulators.neural.phys_cloths import PhysCloths
from drape.simulators.neural.rollout_step import rollout_step
from drape.simulators.simulator import Outcome
from drape.training.curriculum import curriculum
from drape.training.schedule import halving
from tests import garments

ONES = dict.fromkeys(ATTRIBUTES, 1.0)


class Gravitates(nn.Module):
    """The network of free fall."""

    def forward(self, step):
        return step.gravity.expand_as(step.x)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return str(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=9))


@pytest.fixture
def data(path) -> GarmentDataModule:
    return GarmentDataModule(path, ["silk", "denim"], "recorded", 3, 2, seed=0)


def fabric(name: str) -> Material:
    return Material(name, **dict.fromkeys(Material.__dataclass_fields__.keys() - {"name"}, 1.0))


def drawn(data: GarmentDataModule, indices=(0, 2), seed: int = 0):
    rollout = data.rollout(np.array(indices))
    return rollout, RecordedCloths(ONES).draw(rollout, data.materials, torch.Generator().manual_seed(seed))


def predicted(data, x_next_of, terms=(), progress=1.0) -> Prediction:
    rollout, cloth = drawn(data)
    step = rollout_step(rollout, 0, rollout.x[1], (rollout.x[1] - rollout.x[0]) / rollout.dt, cloth)
    return Prediction(x_next_of(rollout, step), step, rollout.x[2], list(terms), progress)


# Rollouts


def test_a_rollout_is_what_was_recorded(data, path):
    """Frames in order, each garment from its own middle at t, both bodies with their own vertices."""
    sequence = GarmentFile(path).sequence(data.train_sequences[0])
    rollout = data.rollout(np.array([1, 3]))
    count = sequence.mesh.num_vertices
    for k, first in enumerate((1, 3)):
        x = sequence.positions[first : first + 5]
        own = rollout.x[:, k * count : (k + 1) * count].numpy()
        np.testing.assert_allclose(own, x - x[1].mean(axis=0), atol=1e-12)
        corners = rollout.body[0][rollout.body_faces[rollout.mesh_of_face == k]].numpy()
        body = sequence.body_positions[first][sequence.body_faces]
        np.testing.assert_allclose(corners, body - x[1].mean(axis=0), atol=1e-12)


def test_at_rest_nothing_moves_in_the_first_step(data):
    rollout = data.rollout(np.array([0]))
    still = rollout.from_rest()
    torch.testing.assert_close(still.body[1], still.body[2])
    torch.testing.assert_close(still.x[1], still.x[2])
    torch.testing.assert_close(still.body[3], rollout.body[2])
    assert still.x.shape == rollout.x.shape


def test_statistics_are_those_of_a_known_motion(path):
    """Carried tubes move as the joint does: the acceleration of the data is that of second differences."""
    data = GarmentDataModule(path, ["silk", "denim"], "carried", 1, 1, seed=0)
    x = np.stack([data.rollout(np.array([k])).x.numpy() for k in range(int(data._first[-1]))])
    dt = data.file.dt
    found = data.statistics()
    speed = np.sqrt((((x[:, 1] - x[:, 0]) / dt) ** 2).sum(-1).mean())
    assert found["vertex_speed"] == pytest.approx(speed, rel=1e-6)
    acceleration = np.sqrt((((x[:, 2] - 2 * x[:, 1] + x[:, 0]) / dt**2) ** 2).sum(-1).mean())
    assert found["vertex_acceleration"] == pytest.approx(acceleration, rel=1e-6)


def test_sequences_too_short_for_the_rollouts_are_refused(path):
    with pytest.raises(DrapeError, match="has 9 frames; expected at least 10, for two to start from and 8 steps"):
        GarmentDataModule(path, ["silk"], "recorded", 8, 1, seed=0)


# Steps


def test_free_fall_is_exact_and_pins_are_led(path):
    """The network of gravity makes the free fall of implicit Euler; pinned vertices go where the scene leads them."""
    sequence = GarmentFile(path).sequence("00002")
    scene = recorded_scene(sequence)
    simulator = NeuralSimulator(Gravitates(), RecordedCloths(ONES), scene)
    state = scene.initial
    for frame in range(3):
        before, state = state, simulator.step(state, frame).state
        free = np.ones(len(state.x), bool)
        free[scene.pins.vertices] = False
        fall = before.x + scene.dt * (before.v + scene.dt * scene.gravity)
        np.testing.assert_allclose(state.x[free], fall[free], atol=1e-12)
        np.testing.assert_array_equal(state.x[~free], scene.pins.at(frame + 1))
        np.testing.assert_allclose(state.v, (state.x - before.x) / scene.dt)


def test_a_prediction_that_is_not_finite_is_told_and_not_taken(path):
    class Broken(nn.Module):
        def forward(self, step):
            return torch.full_like(step.x, torch.nan)

    scene = recorded_scene(GarmentFile(path).sequence("00001"))
    result = NeuralSimulator(Broken(), RecordedCloths(ONES), scene).step(scene.initial, 0)
    assert result.outcome is Outcome.NOT_PREDICTED
    np.testing.assert_array_equal(result.state.x, scene.initial.x)


def test_what_networks_add_to_animates_by_itself(path):
    """Without following and rounds cloth coasts; with rounds its edges come nearer to their rest."""
    scene = recorded_scene(GarmentFile(path).sequence("00001"))
    x, v, free = scene.initial.x, scene.initial.v, np.ones(scene.mesh.num_vertices, dtype=bool)
    if scene.pins is not None:
        free[scene.pins.vertices] = False
    coasting = kinematic(scene, 0.0, 0, 0.2).step(scene.initial, 0).state.x
    np.testing.assert_allclose(coasting[free], (x + scene.dt * v)[free], atol=1e-12)
    kept = kinematic(scene, 0.0, 20, 0.2).step(scene.initial, 0).state.x

    def strain(x: np.ndarray) -> float:
        return float(np.mean(edge_strain(x[None], scene.mesh) ** 2))

    assert strain(kept) < 0.5 * strain(coasting)
    following = kinematic(scene, 1.0, 0, 0.2).step(scene.initial, 0).state.x
    assert np.abs(following - coasting)[free].max() > 1e-4


def test_the_material_of_phys_sets_the_weight(path):
    """The scene has Blender's masses; a network of PHYS animates with the density of its material."""
    scene = recorded_scene(GarmentFile(path).sequence("00001"))
    simulator = NeuralSimulator(Gravitates(), PhysCloths(None), scene)
    area = simulator.steps.mesh.rest_faces.area.sum()
    assert float(simulator.steps.step(scene.initial, 0.0, 1.0).mass.sum()) == (
        pytest.approx(PhysMaterial.default().areal_density * float(area))
    )


# Losses


def test_position_counts_in_units_of_the_acceleration(data):
    """Off by half dt² a everywhere: ¼, whatever the number of vertices; at the recorded frame: 0."""
    shift = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    loss = Position(1.0, scale=4.0)
    off = predicted(data, lambda rollout, step: rollout.x[2] + 0.5 * step.dt**2 * 4.0 * shift)
    assert float(loss(off)["position"]) == pytest.approx(0.25)
    assert float(loss(predicted(data, lambda rollout, step: rollout.x[2]))["position"]) == 0.0


def test_collision_counts_the_depth_below_the_thickness(data):
    """At the place of the body's nearest points moved outwards by a third of the thickness: (2/3)²."""
    prediction = predicted(data, lambda rollout, step: rollout.x[2])
    near = prediction.step.near_vertices(0.2)
    assert len(near.points) > 10
    x = prediction.x_next.clone()
    x[near.points] = near.end.point + 1e-3 * near.end.normal
    assert float(Collision(1.0, 3e-3, 0.2)(replace(prediction, x_next=x))["collision"]) == pytest.approx(4 / 9)
    assert float(Collision(1.0, 1e-3 - 1e-9, 0.2)(replace(prediction, x_next=x))["collision"]) == 0.0


def potential(**changes) -> Potential:
    values = {"weight": 1.0, "contact": SurfaceContact(100.0, 5e-3, 0.2, per_edge=0), "ramp": (0.1, 0.2, 0.6)}
    return Potential(**(values | {"friction": None} | changes))


def test_the_potential_is_its_terms_per_mass_with_their_gradient(data):
    """Inertia and gravity by hand; the gradient of the sum is what the terms say themselves."""
    prediction = predicted(data, lambda rollout, step: (step.x + 0.01).requires_grad_(), PhysMaterial.default().terms())
    values = potential()(prediction)
    assert list(values) == ["inertia", "gravity", "stvk", "bending", "contact"]
    step = prediction.step
    mass = step.mesh.sum_vertices(step.mass)
    for term in (Inertia(), Gravity()):
        assert float(values[term.name]) == pytest.approx(float((term(prediction.x_next, step) / mass).mean()))
    joules = potential().joules(values, prediction)
    assert list(joules) == list(values)
    assert float(joules["gravity"]) == pytest.approx(float(Gravity()(prediction.x_next, step).mean()))
    sum(values.values()).backward()
    terms = potential().terms(prediction)
    expected = sum(term.energy_and_gradient(prediction.x_next, step)[1] for term in terms)
    scale = (1 / mass / step.mesh.num_meshes)[step.mesh.mesh_of_vertex, None]
    torch.testing.assert_close(prediction.x_next.grad, expected * scale)


def learned(force: float) -> LearnedCloths:
    return LearnedCloths(ONES, lambda material: Fabric([], torch.empty(0)), force)


@pytest.mark.parametrize("cloths", [lambda force: PhysCloths(None, force), learned], ids=["phys", "learned"])
def test_garments_are_drawn_with_forces(data, cloths):
    """One force per mass for each garment of a batch, none beyond the largest, in any direction; 0 draws nothing."""
    rollout, generator = data.rollout(np.array([0, 3])), torch.Generator().manual_seed(0)
    drawn = [cloths(2.0).draw(rollout, data.materials, generator) for _ in range(50)]
    per_mass = torch.stack([cloth.external_force / cloth.mass[:, None] for cloth in drawn])
    for k in range(2):
        own = per_mass[:, rollout.mesh.mesh_of_vertex == k]
        torch.testing.assert_close(own, own[:, :1].expand_as(own))
    one, other = (per_mass[:, rollout.mesh.mesh_of_vertex == k][:, 0] for k in range(2))
    assert (one - other).norm(dim=1).min() > 1e-3
    sizes = torch.cat([one, other]).norm(dim=1)
    assert 1.8 < sizes.max() <= 2.0
    assert (torch.cat([one, other]).mean(0).abs() < 0.4).all()
    assert cloths(0.0).draw(rollout, data.materials, generator).external_force is None


def test_the_network_is_told_of_the_force_and_the_potential_counts_it(data):
    rollout = data.rollout(np.array([0]))
    cloth = PhysCloths(None, 3.0).draw(rollout, data.materials, torch.Generator().manual_seed(1))
    step = rollout_step(rollout, 0, rollout.x[1], torch.zeros_like(rollout.x[1]), cloth)
    assert torch.equal(step.external_force, cloth.external_force)
    moved = torch.tensor([0.01, -0.02, 0.03], dtype=torch.float64)
    values = potential()(Prediction(step.x + moved, step, rollout.x[2], [], 1.0))
    per_mass = (cloth.external_force / cloth.mass[:, None])[0]
    assert float(values["external"]) == pytest.approx(-float(per_mass @ moved))


@pytest.mark.parametrize(("progress", "share"), [(0.0, 0.1), (0.2, 0.1), (0.4, 0.55), (0.6, 1.0), (1.0, 1.0)])
def test_contact_stiffens_over_the_training(data, progress, share):
    prediction = predicted(data, lambda rollout, step: step.x, progress=progress)
    contact = potential().terms(prediction)[-1]
    assert contact.stiffness == pytest.approx(share * 100.0)


def test_friction_is_there_only_where_it_is_asked_for(data):
    prediction = predicted(data, lambda rollout, step: step.x)
    assert "friction" not in potential()(prediction)
    assert "friction" in potential(friction=0.5)(prediction)


# Cloths and curriculum


def test_phys_draws_within_the_ranges_and_weighs_by_area(data):
    rollout = data.rollout(np.array([0, 1]))
    cloth = PhysCloths(None).draw(rollout, data.materials, torch.Generator().manual_seed(1))
    other = PhysCloths(None).draw(rollout, data.materials, torch.Generator().manual_seed(2))
    assert cloth.attributes.shape == (2, 4)
    assert ((cloth.attributes >= 0) & (cloth.attributes <= 1)).all()
    assert not torch.equal(cloth.attributes, other.attributes)
    area = float(rollout.mesh.rest_faces.area.sum())
    assert float(cloth.mass.sum()) == pytest.approx(area * PhysMaterial.at(cloth.attributes[0]).areal_density, rel=0.5)


def test_estimates_are_those_of_the_fabric():
    numbers = PhysMaterial(0.3, 2e4, 3e4, 1e-5)._asdict()
    cloths = PhysCloths({"silk": numbers})
    assert cloths.of(fabric("silk")).areal_density == 0.3
    with pytest.raises(DrapeError, match="no estimate for denim; expected one of silk"):
        cloths.of(fabric("denim"))
    with pytest.raises(DrapeError, match="expected positive numbers for areal_density"):
        PhysCloths({"silk": {"areal_density": 0.3}})


def test_rollouts_grow_up_to_the_last():
    grows = curriculum(1, 5000, 5, 0.5)
    assert [grows.length(k) for k in (0, 4999, 5000, 19999, 20000, 10**6)] == [1, 1, 2, 4, 5, 5]
    with pytest.raises(DrapeError, match="1 <= first <= last"):
        curriculum(3, 1, 2, 0.5)


def test_the_published_learning_rate_of_simulators():
    """5.05e-5 below 65 000 of 150 000 iterations, 2.55e-5 below 115 000, 1.30e-5 after (docs/sources.md)."""
    schedule = halving(1 / 3, begin=0.1, extra=0.01)
    rates = [5e-5 * schedule(k / 150_000) for k in (0, 64_999, 65_001, 114_999, 115_001)]
    assert rates == pytest.approx([5.05e-5, 5.05e-5, 2.55e-5, 2.55e-5, 1.30e-5])


def test_advance_leads_pinned_vertices_whatever_the_network_says(data):
    rollout, cloth = drawn(data)
    free = rollout.free.clone()
    free[:3] = False
    rollout = replace(rollout, free=free)
    step = rollout_step(rollout, 1, rollout.x[2], torch.ones_like(rollout.x[2]), cloth)
    torch.testing.assert_close(advance(Gravitates(), step)[:3], rollout.x[3][:3])
