"""The training of an energy without a trainer: weights, seeds, splits, learning rates; and the curves of rates."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
import torch

from drape.data.datamodule import TrajectoryDataModule
from drape.energy.law.step_energies import StepEnergies
from drape.loss.energy_balance import EnergyBalance
from drape.loss.force_residual import ForceResidual
from drape.metrics.energy_error import EnergyError
from drape.scene.material import ATTRIBUTES
from drape.training import energy_training
from drape.training.curriculum import curriculum
from drape.training.energy_training import EnergyTraining
from drape.training.schedule import cosine, halving
from tests.energies import PAPER, make_energy, make_window
from tests.trajectories import header, sequences, write

FABRICS = ("silk", "denim", "wool", "felt")


class Alone(EnergyTraining):
    """Without a trainer; what is logged is kept."""

    trainer, global_step, global_rank = SimpleNamespace(estimated_stepping_batches=10), 0, 0

    def log_dict(self, values, **_):
        self.logged = getattr(self, "logged", {}) | values


def training(seed: int = 0, schedule=lambda progress: 1.0, **about: int) -> Alone:
    made = Alone(
        make_energy("hinge", "damping"),
        {"balance": EnergyBalance(2.0), "force": ForceResidual(3.0, bend=1.0)},
        lambda parameters: torch.optim.SGD(parameters, lr=0.5),
        schedule,
        {"energy_error": EnergyError},
        {"fabrics": FABRICS},
        seed,
    )
    for name, value in about.items():
        setattr(made, name, value)
    return made


@pytest.mark.parametrize(
    ("processes", "batches", "expected"), [(1, 1, True), (2, 1, False), (1, 2, False)], ids=["alone", "ddp", "sums"]
)
def test_slopes_that_are_added_up_are_not_replayed(processes, batches, expected, cloth_batch, monkeypatch):
    """A replay replaces slopes: neither those of batches before nor those of other processes may be lost."""
    made, window = training(), make_window(cloth_batch)
    made.trainer = SimpleNamespace(world_size=processes, accumulate_grad_batches=batches)
    monkeypatch.setattr(torch.Tensor, "is_cuda", True)
    monkeypatch.setattr(energy_training, "CapturedStep", lambda *_: SimpleNamespace(fits=lambda window: True))
    assert made._captures(window) == expected


def test_the_total_is_weighted_and_its_terms_are_logged_as_they_are(cloth_batch):
    """2 · balance + 3 · force residual; forces have a graph to the parameters."""
    made, window = training(), make_window(cloth_batch)
    total = made.training_step(window, 0)
    step = StepEnergies(made.energy, window, training=True)
    balance, force = (float(made.loss[name](step).detach()) for name in ("balance", "force"))
    assert float(total.detach()) == pytest.approx(2.0 * balance + 3.0 * force)
    assert float(made.logged["train/loss/balance"]) == pytest.approx(balance)
    assert float(made.logged["train/loss/force"]) == pytest.approx(force)
    only_force = made.loss["force"](StepEnergies(made.energy, window, training=True))
    made.loss = torch.nn.ModuleDict({"force": ForceResidual(3.0, bend=1.0)})
    made.training_step(window, 0).backward()
    expected = torch.autograd.grad(3.0 * only_force, list(made.energy.potential.parameters()))
    for parameter, gradient in zip(made.energy.potential.parameters(), expected, strict=True):
        torch.testing.assert_close(parameter.grad, gradient)


def test_disturbances_hang_on_seed_iteration_and_rank(cloth_batch):
    window = make_window(cloth_batch)

    def drawn(seed: int, **about: int) -> float:
        training(seed, **about).on_train_batch_start(window, 0)
        return float(torch.rand(()))

    one = {"seed": 2, "global_step": 5, "global_rank": 1}
    assert drawn(**one) == drawn(**one)
    for change in ({"seed": 3}, {"global_step": 6}, {"global_rank": 0}):
        assert drawn(**one) != drawn(**(one | change))


@pytest.mark.parametrize("stage", ["val", "test"])
def test_each_stage_has_metrics_of_its_own_and_forgets(stage, cloth_batch):
    """Two windows of unlike error: a stage reports its own one, and the second time not the first as well."""
    made, window, other = training(), make_window(cloth_batch), make_window(cloth_batch, dt=1.0)
    step, report, beside = {
        "val": (made.validation_step, made.on_validation_epoch_end, made.test_step),
        "test": (made.test_step, made.on_test_epoch_end, made.validation_step),
    }[stage]
    balances = [EnergyBalance(1.0)(StepEnergies(made.energy, each, training=False)) for each in (window, other)]
    errors = [float(each.detach()) for each in balances]
    assert errors[0] != pytest.approx(errors[1])
    for seen, unseen, error in ((window, other, errors[0]), (other, window, errors[1])):
        beside(unseen, 0)
        step(seen, 0)
        report()
        assert made.logged[f"{stage}/energy_error_J2/silk"] == pytest.approx(error)


def test_the_schedule_is_told_the_share_of_the_training():
    made = training(schedule=lambda progress: 1.0 + progress)
    found = made.configure_optimizers()
    assert found["lr_scheduler"]["interval"] == "step"
    for _ in range(5):
        found["optimizer"].step()
        found["lr_scheduler"]["scheduler"].step()
    assert found["optimizer"].param_groups[0]["lr"] == pytest.approx(0.5 * 1.5)


def test_the_example_of_a_checkpoint_is_one_of_validation(tmp_path, monkeypatch):
    path = tmp_path / "cloth.h5"
    write(path, header(), sequences())
    data = TrajectoryDataModule(str(path), ["silk", "denim"], 2, 2, dict.fromkeys(ATTRIBUTES, 10.0), seed=0)
    asked, windows = [], data.windows
    monkeypatch.setattr(data, "windows", lambda *of: asked.append(of[0].tolist()) or windows(*of))
    training().described({"model": PAPER}, {}, data, 0.0)
    assert asked == [[3]], "the only sequence of the test split"


# Curves


def test_a_cosine_rises_and_falls():
    """Half way up the first tenth: ½. Half way down: the mean of 1 and the last value. At the end: that."""
    rate = cosine(warmup=0.1, final=0.2)
    assert [rate(p) for p in (0.0, 0.05, 0.1, 0.55, 1.0)] == pytest.approx([0.0, 0.5, 1.0, 0.6, 0.2])
    assert rate(0.325) == pytest.approx(0.2 + 0.8 * 0.5 * (1.0 + math.cos(math.pi / 4)))


def test_halving_begins_where_it_is_told():
    """Every quarter since 0.2: ½ from 0.45 on, ¼ from 0.7 on; 0.01 more everywhere."""
    rate = halving(0.25, begin=0.2, extra=0.01)
    assert [rate(p) for p in (0.0, 0.44, 0.46, 0.69, 0.71)] == pytest.approx([1.01, 1.01, 0.51, 0.51, 0.26])


def test_rollouts_grow_after_so_many_iterations():
    grows = curriculum(2, 10, 4, 0.0)
    assert [grows.length(k) for k in (0, 9, 10, 19, 20, 30, 99)] == [2, 2, 3, 3, 4, 4, 4]
