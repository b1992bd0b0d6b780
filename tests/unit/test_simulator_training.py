"""One iteration of the training of a simulator by networks that are formulas: what steps see, and what is done."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from drape.data.garment_datamodule import GarmentDataModule
from drape.data.sequence_loader import Watched
from drape.energy.fabric import Fabric
from drape.energy.terms.contact import SurfaceContact
from drape.energy.terms.free_motion import Inertia
from drape.errors import DrapeError
from drape.loss.potential import Potential
from drape.loss.prediction import PredictionLoss
from drape.metrics.rollout_scores import rollout_scores
from drape.scene.material import ATTRIBUTES
from drape.simulators.neural.cloths import LearnedCloths, RecordedCloths
from drape.training.curriculum import curriculum
from drape.training.simulator_training import SimulatorTraining
from tests import garments

CLOTHS = RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0))
STEPS = 100
"""Iterations of the training that these are of."""


class Pushes(nn.Module):
    """The same acceleration ``by`` [m/s²] upwards everywhere; keeps the steps that it was asked for."""

    def __init__(self, by: float = 0.0):
        super().__init__()
        self.by, self.seen = nn.Parameter(torch.tensor(by, dtype=torch.float64)), []

    def forward(self, step):
        self.seen.append(step)
        return torch.zeros_like(step.x) + self.by * torch.tensor([0.0, 0.0, 1.0], dtype=step.x.dtype)


class Height(PredictionLoss):
    """The mean height, in units of dt²: its derivative in ``by`` is 1. Keeps the predictions."""

    def __init__(self, weight: float = 1.0):
        super().__init__(weight)
        self.seen = []

    def forward(self, prediction):
        self.seen.append(prediction)
        return {"height": prediction.x_next[:, 2].mean() / prediction.step.dt**2}


class Alone(SimulatorTraining):
    """Without a trainer: what is logged is kept, and the optimiser says of which steps Lightning would be told."""

    trainer, global_step, global_rank = SimpleNamespace(max_steps=STEPS), 0, 0

    def optimizers(self):
        return self.optimizer

    def manual_backward(self, loss):
        loss.backward()

    def log_dict(self, values, **_):
        self.logged = values

    def log(self, name, value, **_):
        self.logged = getattr(self, "logged", {}) | {name: value}


class Told(torch.optim.Optimizer):
    """An optimiser as Lightning wraps it: counts the steps that go through it."""

    def __init__(self, optimizer):
        self.optimizer, self.param_groups, self.count = optimizer, optimizer.param_groups, 0

    def step(self):
        self.count += 1
        self.optimizer.step()

    def zero_grad(self):
        self.optimizer.zero_grad()


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> GarmentDataModule:
    path = garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=9)
    return GarmentDataModule(str(path), ["silk", "denim"], "recorded", 3, 2, seed=0)


def test_fabrics_that_the_file_lacks_are_refused(data):
    with pytest.raises(DrapeError, match=r"no fabric wool; it has silk, denim; choose material"):
        GarmentDataModule(str(data.file.path), ["silk", "wool"], "recorded", 3, 2, seed=0)


def training(data: GarmentDataModule, **changes) -> Alone:
    settings = {
        "network": Pushes(), "cloths": CLOTHS, "loss": {"height": Height()}, "schedule": lambda progress: 1.0,
        "optimizer": lambda parameters: torch.optim.SGD(parameters, lr=1.0), "curriculum": curriculum(3, 1, 3, 0.0),
        "updates": "step", "noise": 0.0, "clip": 1e9, "clearance": 1e-3, "seed": 0,
    }  # fmt: skip
    about = {name: changes.pop(name) for name in ("global_step", "global_rank") if name in changes}
    made = Alone(**(settings | changes), data=data)
    for name, value in about.items():
        setattr(made, name, value)
    made.optimizer = Told(made.configure_optimizers())
    return made


def after(data: GarmentDataModule, index: int = 3, **changes) -> Alone:
    """A training after one iteration on the rollout ``index``."""
    made = training(data, **changes)
    made.training_step(data.rollout(np.array([index])), 0)
    return made


def test_each_step_has_the_target_and_the_body_of_its_own_time(data):
    """Step k goes from frame t + k to t + k + 1, and begins where and as fast as the one before has ended."""
    found, rollout = after(data, network=Pushes(3.0), updates="rollout"), data.rollout(np.array([3]))
    x, v = rollout.x[1], (rollout.x[1] - rollout.x[0]) / rollout.dt
    up = torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    assert len(found.loss["height"].seen) == 3
    for k, prediction in enumerate(found.loss["height"].seen):
        step = prediction.step
        assert torch.equal(prediction.target, rollout.x[k + 2])
        assert torch.equal(step.obstacle.x, rollout.body[k + 1])
        assert torch.equal(step.obstacle.x_next, rollout.body[k + 2])
        torch.testing.assert_close(step.x, x)
        torch.testing.assert_close(step.v, v)
        before, x = x, x + rollout.dt * (v + rollout.dt * up)
        v = (x - before) / rollout.dt
        torch.testing.assert_close(prediction.x_next.detach(), x)
        assert not step.x.requires_grad
        assert not step.v.requires_grad


@pytest.mark.parametrize("per_edge", [0, 2])
def test_steps_ask_the_points_of_the_cloth_that_the_contact_of_the_loss_asks(data, per_edge):
    """Vertices, or two points inside each edge too; a network is told of vertices whatever the loss asks."""
    contact = SurfaceContact(100.0, 5e-3, 0.2, per_edge)
    loss = {"potential": Potential(1.0, contact, (1.0, 0.0, 0.0), None)}
    cloths = LearnedCloths(dict.fromkeys(ATTRIBUTES, 1.0), lambda material: Fabric([Inertia()], torch.empty(0)))
    for step in after(data, loss=loss, cloths=cloths).network.seen:
        assert len(step.near.distance) == step.mesh.num_vertices + per_edge * len(step.mesh.edges)


def test_losses_know_how_far_the_training_is(data):
    seen = after(data, global_step=30).loss["height"].seen
    assert [prediction.progress for prediction in seen] == [0.3] * 3


@pytest.mark.parametrize(
    ("updates", "moved", "told"),
    [("step", 3 * 2.0, 1), ("rollout", 2.0, 1)],
)
def test_updates_after_steps_add_up_and_one_after_the_rollout_is_their_mean(data, updates, moved, told):
    """A loss of weight 2 with derivative 1 moves ``by`` by 2 an update; Lightning counts the iteration once."""
    found = after(data, updates=updates, loss={"height": Height(2.0)})
    assert float(found.network.by.detach()) == pytest.approx(-moved)
    assert found.optimizer.count == told
    assert found.network.by.grad is None or float(found.network.by.grad) == 0.0


def test_what_is_logged_is_the_mean_over_the_steps_without_weights(data):
    found = after(data, loss={"height": Height(2.0)}, updates="rollout")
    heights = [float(each.x_next[:, 2].detach().mean()) / each.step.dt**2 for each in found.loss["height"].seen]
    assert float(found.logged["train/loss/height"]) == pytest.approx(np.mean(heights))
    assert found.logged["train/rollout_length"] == 3.0


def test_gradients_are_clipped(data):
    """The derivative is 1, an update of the length 1e-3."""
    assert float(after(data, clip=1e-3, updates="rollout").network.by.detach()) == pytest.approx(-1e-3)


def test_the_learning_rate_is_the_first_one_times_the_schedule(data):
    """After three tenths of the training, in every iteration anew."""
    made = training(data, schedule=lambda progress: 0.1 + progress, global_step=3 * STEPS // 10)
    for _ in range(2):
        made.training_step(data.rollout(np.array([0])), 0)
        assert made.optimizer.param_groups[0]["lr"] == pytest.approx(0.4)


def test_rollouts_are_as_long_as_the_curriculum_says(data):
    """One step in the iterations 0 and 1, two in 2 and 3, three from 4 on; and no longer than the data."""
    lengths = [len(after(data, curriculum=curriculum(1, 2, 9, 0.0), global_step=k).network.seen) for k in range(8)]
    assert lengths == [1, 1, 2, 2, 3, 3, 3, 3]


def test_all_that_is_random_hangs_on_seed_iteration_and_rank(data):
    """The first positions of a rollout with noise: the same for the same three, others if one differs."""

    def first(**changes) -> torch.Tensor:
        return after(data, noise=1e-4, curriculum=curriculum(1, 1, 1, 0.0), **changes).network.seen[0].x

    one = {"seed": 2, "global_step": 5, "global_rank": 1}
    assert torch.equal(first(**one), first(**one))
    for change in ({"seed": 3}, {"global_step": 6}, {"global_rank": 0}):
        assert not torch.equal(first(**one), first(**(one | change)))


def test_noise_is_on_both_frames_on_its_own_and_not_on_pins(data):
    """σ on the positions at t, √2 σ on the displacement since t-1; nothing where a vertex is led."""
    rollout, noise = data.rollout(np.array([3])), 1e-4
    free = torch.ones_like(rollout.free)
    free[:20] = False
    made = training(data, noise=noise)
    made.training_step(replace(rollout, free=free), 0)
    step = made.network.seen[0]
    moved = rollout.dt * step.v - (rollout.x[1] - rollout.x[0])
    assert torch.equal(step.x[:20], rollout.x[1][:20])
    assert float((step.x - rollout.x[1])[20:].std()) == pytest.approx(noise, rel=0.2)
    assert float(moved[20:].std()) == pytest.approx(2**0.5 * noise, rel=0.2)


def test_a_rollout_begins_outside_of_the_body_as_that_is_at_t(data):
    """3 cm from a ball, where cloth is 2 cm away: moved cloth keeps its recorded velocity."""
    rollout = data.rollout(np.array([3]))
    step = after(data, clearance=0.03).network.seen[0]
    moved = (step.x - rollout.x[1]).norm(dim=-1) > 1e-6
    assert moved.sum() > 20
    distance = (step.x - rollout.body[1].mean(0)).norm(dim=-1)
    assert float(distance[moved].min()) > garments.RADIUS + 0.027
    assert float((step.x - rollout.body[0].mean(0)).norm(dim=-1)[moved].min()) < garments.RADIUS + 0.0265
    torch.testing.assert_close(step.v[moved], ((rollout.x[1] - rollout.x[0]) / rollout.dt)[moved])


def test_at_rest_neither_cloth_nor_body_move_at_first(data):
    rollout = data.rollout(np.array([3]))
    resting, going = (after(data, curriculum=curriculum(3, 1, 3, share)).network.seen for share in (1.0, 0.0))
    assert float(resting[0].v.abs().max()) == 0.0
    assert torch.equal(resting[0].obstacle.x, resting[0].obstacle.x_next)
    assert torch.equal(resting[1].obstacle.x_next, rollout.body[2])
    assert float(going[0].v.abs().max()) > 0.0


def test_as_many_rollouts_begin_at_rest_as_are_asked_for(data):
    """A fifth of 60: between 4 and 20 of them."""
    made = training(data, curriculum=curriculum(1, 1, 1, 0.2))
    for made.global_step in range(60):
        made.training_step(data.rollout(np.array([3])), 0)
    resting = sum(float(step.v.abs().max()) == 0.0 for step in made.network.seen)
    assert 4 <= resting <= 20


def test_validation_animates_whole_sequences_of_the_test_split(data):
    made = training(data, network=Pushes(1.0))
    names = data.file.split("test")
    assert set(data.validation_sequences) <= set(names)
    assert not set(data.validation_sequences) & set(data.train_sequences)
    sequence = data.file.sequence(names[0])
    made.validation_step(Watched(sequence), 0)
    assert len(made.watched[0].x) == sequence.num_frames - 1
    expected = rollout_scores(Pushes(1.0), CLOTHS, sequence).scores
    for name in ("error_mm", "last_error_mm", "collision_percent"):
        assert made.logged[f"val/{name}"] == pytest.approx(expected[name])
