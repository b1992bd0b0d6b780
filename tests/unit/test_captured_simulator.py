"""A step of a simulator's training as it is on a GPU: sizes that stay, no waiting, and the numbers of the CPU's."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from drape.data.garment_datamodule import GarmentDataModule
from drape.energy.phys_material import PhysMaterial
from drape.energy.terms.contact import Contact, PaperContact, SurfaceContact
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.geometry.disc import disc
from drape.geometry.grid import square_grid
from drape.loss.collision import Collision
from drape.loss.newton import Newton
from drape.loss.position import Position
from drape.loss.potential import Potential
from drape.loss.prediction import PredictionLoss
from drape.simulators.kinematic.prior import KinematicPrior
from drape.simulators.neural.layers_acceleration import LayersAcceleration
from drape.simulators.solver.solver_prior import SolverPrior
from drape.training.captured_step import CapturedSteps, arrays, kind
from drape.training.simulator_task import Task
from drape.training.simulator_training import SimulatorTraining
from tests import garments
from tests.networks import make_network
from tests.terms import baked, hinges, make_step
from tests.unit.test_captured_step import ON_GPU, NoWaiting
from tests.unit.test_simulator_training import training as make_alone

FABRICS: dict[str, Callable[[], list]] = {
    "hinges": lambda: [HingeElastic(baked(), transfer=True), Damping(hinges(), transfer=True)],
    "phys": lambda: PhysMaterial.default().terms(2),
}
LOSSES: dict[str, Callable[[], PredictionLoss]] = {
    "potential": lambda: potential(SurfaceContact(thickness=0.05)),
    "paper": lambda: potential(PaperContact(thickness=0.05)),
    "position": lambda: Position(1.0, scale=7.0),
    "collision": lambda: Collision(1.0, 0.02, 0.1),
}


def potential(contact: Contact) -> Potential:
    return Potential(1.0, contact, [0.01, 0.3, 1.0], friction=0.5)


class Alone(SimulatorTraining):
    """Only what a step takes."""

    def __init__(self, network: nn.Module, loss: PredictionLoss):
        nn.Module.__init__(self)
        self.network, self.loss = network, nn.ModuleDict({"loss": loss})


def make_task(fabric: str, progress: float = 0.6) -> Task:
    """Of two cloths; parts of both are near their bodies."""
    step, x_next = make_step(square_grid(1.0, 8), disc(0.5, 4, 0.3))
    step = replace(step, fabric=FABRICS[fabric]())
    return Task(step, step.near, x_next, torch.tensor(progress, dtype=torch.float64))


def make_training(schedule: str, loss: str) -> Alone:
    prior = KinematicPrior(make_network(schedule), share=0.5, rounds=4, reach=0.05)
    return Alone(prior, LOSSES[loss]())


def slopes(training: Alone, task: Task) -> tuple[dict[str, Tensor], list[Tensor]]:
    values = training.values(task)
    found = torch.autograd.grad(values["total"], list(training.network.parameters()), allow_unused=True)
    return values, [each for each in found if each is not None]


def on_device(value: Any, made: dict[int, Any], device: str = "meta") -> Any:
    """The same on a device, by default one without memory, with all that meshes have computed."""
    if isinstance(value, Tensor):
        return value.detach().to(device)
    if isinstance(value, nn.Module):
        return made.setdefault(id(value), copy.deepcopy(value).to(device))
    if isinstance(value, dict):
        return {key: on_device(part, made, device) for key, part in value.items()}
    if isinstance(value, list | tuple):
        parts = [on_device(part, made, device) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else type(value)(parts)
    if not type(value).__module__.startswith("drape."):
        return value
    if id(value) not in made:
        made[id(value)] = other = object.__new__(type(value))
        other.__dict__.update(on_device(vars(value), made, device))
    return made[id(value)]


class OnDevice(NoWaiting):
    """Fails too where an array is brought to the device."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        devices = {part.device for part in args if isinstance(part, Tensor)}
        if str(function).startswith(("aten._to_copy", "aten.copy_")):
            devices.add((kwargs or {}).get("device") or next(iter(devices)))
            assert len(devices) == 1, f"{function}: from the CPU"
        return super().__torch_dispatch__(function, types, args, kwargs)


CASES = [
    ("mgn", "hinges", "potential"), ("mgn", "phys", "potential"), ("mgn", "hinges", "paper"),
    ("mgn", "hinges", "position"), ("mgn", "hinges", "collision"), ("mgn_h", "phys", "paper"),
]  # fmt: skip


@pytest.mark.parametrize(("schedule", "fabric", "loss"), CASES)
def test_sizes_that_stay_change_no_number(schedule, fabric, loss, request):
    """Predictions, losses, energies and slopes, with some vertices beyond the reach of everything."""
    training, task = make_training(schedule, loss), make_task(fabric)
    fewer = task.step.near.within(training.network.reach, task.step.mesh.num_vertices)
    assert 0 < len(fewer.points) < task.step.mesh.num_vertices
    expected = slopes(training, Task(task.step, None, task.target, task.progress))
    request.getfixturevalue("fixed")
    found = slopes(training, task)
    assert len(found[1]) == len(expected[1]) > 20
    assert found[0].keys() == expected[0].keys()
    for name, value in expected[0].items():
        torch.testing.assert_close(found[0][name], value, rtol=1e-5, atol=1e-9, msg=lambda text, n=name: f"{n}: {text}")
    largest = max(float(slope.abs().max()) for slope in expected[1])
    for one, other in zip(found[1], expected[1], strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5 * largest)


@pytest.mark.usefixtures("fixed")
@pytest.mark.parametrize(("schedule", "fabric", "loss"), CASES)
def test_nothing_is_asked_of_the_device(schedule, fabric, loss):
    """On a device without memory no number can be asked for; nor is one brought there."""
    training, task = make_training(schedule, loss), make_task(fabric)
    slopes(training, task)  # what meshes compute once
    made: dict[int, Any] = {}
    training, task = on_device(training, made), on_device(task, made)
    slopes(training, task)
    with OnDevice():
        values, found = slopes(training, task)
    assert values["x_next"].device.type == "meta"
    assert len(found) > 20


def test_inputs_of_the_same_kind_differ_in_their_arrays_only():
    task = make_task("hinges")
    other = replace(task, target=task.target + 1.0, step=replace(task.step, x=task.step.x + 1.0))
    assert kind(task) == kind(other)
    assert len(arrays(task)) == len(arrays(other)) > 15
    assert any(each is task.near.end.normal for each in arrays(task))
    assert not any(each is task.step.mesh.faces for each in arrays(task)), "meshes stay"
    assert kind(replace(task, target=task.target[:-1])) != kind(task)
    for step in (
        replace(task.step, dt=0.5), replace(task.step, external_force=None), replace(task.step, fabric=[]),
        make_task("hinges").step,
    ):  # fmt: skip
        assert kind(replace(task, step=step)) != kind(task)


class Graph:
    """What a captured step does, without a GPU: all that it gives lies where it lay before."""

    def __init__(self, training: SimulatorTraining):
        self.training, self.kept = training, None

    def replay(self, task: Task) -> dict[str, Tensor]:
        values = self.training.values(task)
        parameters = list(self.training.network.parameters())
        found = [each.detach().clone() for each in values.values()]
        found += torch.autograd.grad(values["total"], parameters, materialize_grads=True)
        self.kept = self.kept or found
        torch._foreach_copy_(self.kept, found)
        for parameter, slope in zip(parameters, self.kept[len(values) :], strict=True):
            parameter.grad = slope
        return dict(zip(values, self.kept, strict=False))


@pytest.mark.parametrize("updates", ["step", "rollout"])
def test_a_training_with_replays_is_the_same_training(updates, tmp_path):
    """Rollouts of three steps, each from where the network has come to, and updates in between or at the end."""
    path = garments.write(tmp_path / "garments.h5", frames=9)
    data = GarmentDataModule(str(path), ["silk", "denim"], "recorded", 3, 2, seed=0)
    trained = []
    for replays in (False, True):
        settings = {"network": make_network(), "loss": {"position": Position(1.0, 7.0)}, "updates": updates}
        training = make_alone(data, optimizer=lambda parameters: torch.optim.SGD(parameters, lr=1e-3), **settings)
        graph = Graph(training)
        training._graph = lambda _, replays=replays, graph=graph: graph if replays else None
        for first in (0, 2):
            training.training_step(data.rollout(np.array([first, first + 1])), 0)
        trained.append([*training.network.parameters(), training.logged["train/loss/position"]])
    for one, other in zip(*trained, strict=True):
        torch.testing.assert_close(one, other)


def test_each_evaluation_begins_with_a_step_of_which_nothing_is_known():
    """Positions of a captured step change in their place: what it has computed from the last ones would be stale."""
    task = make_task("hinges")
    task.step.inertial.add_(0.0)
    first, second = task.started, task.started
    assert first is not second
    assert first.near is second.near is task.near
    assert "inertial" not in vars(first)
    assert task.started.surface is task.step.surface


def test_what_asks_the_device_and_the_cpu_have_no_graph():
    assert all(part.asks_device for part in (LayersAcceleration, SolverPrior, Newton))
    assert make_training("mgn", "potential")._graph(make_task("hinges")) is None


@ON_GPU
@pytest.mark.parametrize(("schedule", "fabric", "loss"), CASES)
def test_replayed_steps_have_the_numbers_of_eager_ones(schedule, fabric, loss):
    """Two tasks of one kind in turn, then one of another: one graph for the first two."""
    training, task = make_training(schedule, loss), make_task(fabric)
    slopes(training, task)
    training, made = training.cuda(), {}
    tasks = [on_device(task, made, "cuda")]
    tasks.append(replace(tasks[0], step=replace(tasks[0].step, x=tasks[0].step.x + 1e-3)))
    steps = CapturedSteps[Task](training.values, list(training.network.parameters()))
    for each in (*tasks, tasks[0]):
        expected, wanted = slopes(training, each)
        graph = steps.of(each)
        found = graph.replay(each)
        for name, value in expected.items():
            torch.testing.assert_close(found[name], value.detach(), rtol=1e-4, atol=1e-7)
        got = [p.grad for p in training.network.parameters() if p.grad is not None]
        largest = max(float(slope.abs().max()) for slope in wanted)
        for one, other in zip(got, wanted, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-4 * largest)
    assert steps.of(tasks[0]) is steps.of(tasks[1])
