"""Cost of a training step of a simulator, and the share of its network."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import torch
from omegaconf import DictConfig
from torch import Tensor, nn

from drape import config as conf
from drape.benchmark.calls import calls
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.garment_datamodule import GarmentDataModule
from drape.data.garment_rollout import GarmentRollout
from drape.energy.step import Step
from drape.loss.prediction import Prediction
from drape.nets.products import round_products
from drape.simulators.advance import advance
from drape.simulators.neural.cloths import Cloth
from drape.simulators.neural.rollout_step import rollout_step
from drape.training.captured_step import CapturedSteps
from drape.training.simulator_task import Task, task_values

WARM_UP = 3
"""Rollouts that are not counted."""
PARTS = ("search", "forward", "loss", "backward", "optimizer")
"""Of a step, in this order."""


class SimulatorStep:
    """Phases of one step of a rollout [ms], medians over ``repeats`` rollouts, and of its network alone.

    A rollout has as many steps as the schedule of the config gives on average, from recorded frames; what it needs
    once (``data``: reading it and drawing its cloth; the meshes at rest) is spread over them. ``search`` finds the
    nearest faces of the body. ``networks``: the same layers on the same inputs, ready made, forward and backward;
    steps and networks alternate, so that both see the same machine. Beside them :func:`calls` of a last step. With
    ``trainer=gpu`` all on the GPU, which is waited for after each part; and ``captured``, a step as it is trained:
    search, then the network, the losses and their slopes as one graph, and the optimiser.
    """

    def __init__(self, repeats: int):
        self.repeats = repeats

    def measure(self, config: DictConfig) -> Measured:
        """Of the model, loss and data of ``config``, composed from ``conf/train.yaml``."""
        device = "cuda" if config.trainer.accelerator == "gpu" else "cpu"
        circumstances = Circumstances()
        torch.manual_seed(config.seed)
        data = conf.instantiate(config.datamodule, fabrics=list(config.material))
        conf.set_statistics(data.statistics())
        step = _Step(config, data, device)
        rollouts = itertools.chain.from_iterable(itertools.repeat(data.train_dataloader()))  # epoch after epoch
        rows = [step.costs(rollouts) for _ in range(WARM_UP + self.repeats)][WARM_UP:]
        cost = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
        beyond = cost["step"] / cost["networks"] - 1.0
        scale = config.scale.simulator
        title = (
            f"A training step of {conf.chosen('model')}: width {scale.width}, batch {scale.batch_size}, {self.repeats} "
            f"rollouts of {step.length} steps; beyond the network {100 * beyond:.0f} % of its forward and backward time"
        )
        counts = step.counts(rollouts)
        if device == "cuda":
            cost["captured"], counts["captured"] = step.captured(rollouts, self.repeats), {}
        parts: list[Row] = [{"part": name, "ms": 1e3 * seconds, **counts[name]} for name, seconds in cost.items()]
        return Measured("training_step", title, parts, circumstances.text())


class _Step:
    """Everything that a step needs, built once."""

    def __init__(self, config: DictConfig, data: GarmentDataModule, device: str):
        self.data, self.device = data, device
        round_products(torch.device(device))
        self.network = conf.instantiate(config.model.network).to(device)
        self.cloths = conf.instantiate(config.model.cloths)
        self.losses = [conf.instantiate(term).to(device) for term in config.loss.values()]
        self.optimizer = conf.instantiate(config.optimizer)(self.network.parameters())
        self.generator = torch.Generator().manual_seed(config.seed)
        growing = conf.instantiate(config.training.curriculum)
        lengths = [growing.length(k) for k in range(config.scale.simulator.iterations)]
        self.length = max(round(statistics.fmean(lengths)), 1)
        named = self.network.network.named_children()
        self.layers = [module for name, module in named if name in ("net", "decoder")]

    def costs(self, rollouts: Iterator[GarmentRollout]) -> dict[str, float]:
        """Seconds of ``data``, the :data:`PARTS`, their sum ``step``, and the ``networks``, in the next rollout."""
        began = self._now()
        rollout, cloth = self._drawn(rollouts)
        data, rows = self._now() - began, []
        for k in range(self.length):
            one, row = _One(self, rollout, cloth, k), {}
            for name in (*PARTS, "networks"):
                row[name] = self._seconds(getattr(one, name))
            rows.append(row)
        cost = {"data": data / self.length} | {name: statistics.fmean(row[name] for row in rows) for name in PARTS}
        networks = statistics.fmean(row["networks"] for row in rows)
        return cost | {"step": sum(cost.values()), "networks": networks}

    def counts(self, rollouts: Iterator[GarmentRollout]) -> dict[str, dict[str, int]]:
        """The :func:`calls` of the second step of a rollout, by the same names; of ``data`` the share of a step."""
        rollout, cloth = self._drawn(rollouts)
        for k in range(2):
            one = _One(self, rollout, cloth, k)
            found = {name: calls(getattr(one, name)) for name in (*PARTS, "networks")}
        found["data"] = {name: n // self.length for name, n in calls(lambda: self._drawn(rollouts)).items()}
        names = ("data", *PARTS)
        return found | {"step": {what: sum(found[name][what] for name in names) for what in found["data"]}}

    def captured(self, rollouts: Iterator[GarmentRollout], repeats: int) -> float:
        """Seconds of a step whose :class:`CapturedStep` is made, the GPU waited for after ``repeats`` of them."""
        one = _One(self, *self._drawn(rollouts), 0)
        steps = CapturedSteps[Task](partial(task_values, self.network, self.losses), list(self.network.parameters()))
        before = one.rollout.x[1]

        def step() -> None:
            one.search()
            task = Task(one.step, one.step.near, one.rollout.x[2], before.new_full((), 0.5))
            graph = steps.of(task)
            if graph is not None:
                graph.replay(task)
            one.optimizer()

        def several() -> None:
            for _ in range(repeats):
                step()

        step()
        return self._seconds(several) / repeats

    def _drawn(self, rollouts: Iterator[GarmentRollout]) -> tuple[GarmentRollout, Cloth]:
        rollout = next(rollouts).to(self.device)
        return rollout, self.cloths.draw(rollout, self.data.materials, self.generator)

    def _seconds(self, run: Callable[[], object]) -> float:
        began = self._now()
        run()
        return self._now() - began

    def _now(self) -> float:
        if self.device == "cuda":
            torch.cuda.synchronize()
        return time.perf_counter()


@dataclass
class _One:
    """The step from frame k + 1 of a rollout, in parts to be run in the order of :data:`PARTS`."""

    of: _Step
    rollout: GarmentRollout
    cloth: Cloth
    k: int
    inputs: list[tuple[nn.Module, tuple]] = field(default_factory=list)
    """Layers and the inputs that each was called with."""

    def search(self) -> None:
        before, x = self.rollout.x[self.k : self.k + 2]
        self.step: Step = rollout_step(self.rollout, self.k, x, (x - before) / self.rollout.dt, self.cloth)
        _ = self.step.near

    def forward(self) -> None:
        with _Inputs(self.of.layers) as self.inputs:
            self.x_next = advance(self.of.network, self.step)

    def loss(self) -> None:
        prediction = Prediction(self.x_next, self.step, self.rollout.x[self.k + 2], self.cloth.terms, progress=0.5)
        values = [loss.total(loss(prediction)) for loss in self.of.losses]
        self.total: Tensor = torch.stack(values).sum()

    def backward(self) -> None:
        self.total.backward()

    def optimizer(self) -> None:
        self.of.optimizer.step()
        self.of.optimizer.zero_grad()

    def networks(self) -> None:
        """The layers by themselves, forward and backward."""
        nothing = torch.zeros((), device=self.of.device)
        sum((_total(layer(*inputs), nothing) for layer, inputs in self.inputs), nothing).backward()


class _Inputs:
    """While active, what ``layers`` are called with."""

    def __init__(self, layers: list[nn.Module]):
        self._layers = layers
        self._calls: list[tuple[nn.Module, tuple]] = []

    def __enter__(self) -> list[tuple[nn.Module, tuple]]:
        def keep(module: nn.Module, inputs: tuple) -> None:
            ready = tuple(each.detach() if isinstance(each, Tensor) else each for each in inputs)
            self._calls.append((module, ready))

        self._hooks = [layer.register_forward_pre_hook(keep) for layer in self._layers]
        return self._calls

    def __exit__(self, *_: object) -> None:
        for hook in self._hooks:
            hook.remove()


def _total(output: object, nothing: Tensor) -> Tensor:
    """The sum of all tensors with a graph in an output."""
    if isinstance(output, Tensor):
        return output.sum() if output.requires_grad else nothing
    parts = output.values() if isinstance(output, dict) else output if isinstance(output, tuple) else ()
    return sum((_total(part, nothing) for part in parts), nothing)
