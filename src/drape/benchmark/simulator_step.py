"""Cost of a training step of a simulator, and the share of its network."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Iterator

import numpy as np
import torch
from omegaconf import DictConfig
from torch import nn

from drape import config as conf
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.garment_datamodule import GarmentDataModule
from drape.data.garment_rollout import GarmentRollout
from drape.loss.prediction import Prediction
from drape.simulators.advance import advance
from drape.simulators.neural.cloths import Cloth
from drape.simulators.neural.rollout_step import rollout_step

WARM_UP = 3
"""Steps that are not counted."""
PARTS = ("data", "search", "forward", "loss", "backward", "optimizer")


class SimulatorStep:
    """Phases of one step of a rollout [ms], medians over ``repeats`` rollouts, and of its network alone.

    A rollout has as many steps as the schedule of the config gives on average, from recorded frames; what it needs
    once (``data``: reading it and drawing its cloth; the meshes at rest) is spread over them. ``search`` finds the
    nearest faces of the body. ``networks``: the same layers on the same inputs, ready made, forward and backward;
    steps and networks alternate, so that both see the same machine.
    """

    def __init__(self, repeats: int):
        self.repeats = repeats

    def measure(self, config: DictConfig) -> Measured:
        """Of the model, loss and data of ``config``, composed from ``conf/train.yaml``."""
        circumstances = Circumstances()
        torch.manual_seed(config.seed)
        data = conf.instantiate(config.datamodule, fabrics=list(config.material))
        conf.set_statistics(data.statistics())
        step = _Step(config, data)
        rollouts = itertools.chain.from_iterable(itertools.repeat(data.train_dataloader()))  # epoch after epoch
        rows = [step.costs(rollouts) for _ in range(WARM_UP + self.repeats)][WARM_UP:]
        cost = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
        beyond = cost["step"] / cost["networks"] - 1.0
        scale = config.scale.simulator
        title = (
            f"A training step of {conf.chosen('model')}: width {scale.width}, batch {scale.batch_size}, {self.repeats} "
            f"rollouts of {step.length} steps; beyond the network {100 * beyond:.0f} % of its forward and backward time"
        )
        parts: list[Row] = [{"part": name, "ms": 1e3 * seconds} for name, seconds in cost.items()]
        return Measured("training_step", title, parts, circumstances.text())


class _Step:
    """Everything that a step needs, built once."""

    def __init__(self, config: DictConfig, data: GarmentDataModule):
        self.data = data
        self.network, self.cloths = conf.instantiate(config.model.network), conf.instantiate(config.model.cloths)
        self.losses = [conf.instantiate(term) for term in config.loss.values()]
        self.optimizer = conf.instantiate(config.optimizer)(self.network.parameters())
        self.generator = torch.Generator().manual_seed(config.seed)
        growing = conf.instantiate(config.training.curriculum)
        lengths = [growing.length(k) for k in range(config.scale.simulator.iterations)]
        self.length = max(round(statistics.fmean(lengths)), 1)
        named = self.network.network.named_children()
        self.layers = [module for name, module in named if name in ("net", "decoder")]

    def costs(self, rollouts: Iterator[GarmentRollout]) -> dict[str, float]:
        """Seconds of the :data:`PARTS`, of the ``step``, and of its ``networks`` alone, in the next rollout."""
        began = time.perf_counter()
        rollout = next(rollouts)
        cloth = self.cloths.draw(rollout, self.data.materials, self.generator)
        data = time.perf_counter() - began
        rows = [self._one(rollout, cloth, k) for k in range(self.length)]
        cost = {"data": data / self.length} | {name: statistics.fmean(row[name] for row in rows) for name in rows[0]}
        return cost | {"step": sum(cost[name] for name in PARTS)}

    def _one(self, rollout: GarmentRollout, cloth: Cloth, k: int) -> dict[str, float]:
        """The step from frame k + 1."""
        marks = [time.perf_counter()]
        step = rollout_step(rollout, k, rollout.x[k + 1], (rollout.x[k + 1] - rollout.x[k]) / rollout.dt, cloth)
        _ = step.near
        marks.append(time.perf_counter())
        with _Inputs(self.layers) as calls:
            x_next = advance(self.network, step)
        marks.append(time.perf_counter())
        prediction = Prediction(x_next, step, rollout.x[k + 2], cloth.terms, progress=0.5)
        total = sum(loss.total(loss(prediction)) for loss in self.losses)
        marks.append(time.perf_counter())
        total.backward()
        marks.append(time.perf_counter())
        self.optimizer.step()
        self.optimizer.zero_grad()
        marks.append(time.perf_counter())
        row = dict(zip(PARTS[1:], np.diff(marks).tolist(), strict=True))
        return row | {"networks": _alone(calls)}


class _Inputs:
    """While active, what ``layers`` are called with."""

    def __init__(self, layers: list[nn.Module]):
        self._layers = layers
        self._calls: list[tuple[nn.Module, tuple]] = []

    def __enter__(self) -> list[tuple[nn.Module, tuple]]:
        def keep(module: nn.Module, inputs: tuple) -> None:
            ready = tuple(each.detach() if isinstance(each, torch.Tensor) else each for each in inputs)
            self._calls.append((module, ready))

        self._hooks = [layer.register_forward_pre_hook(keep) for layer in self._layers]
        return self._calls

    def __exit__(self, *_: object) -> None:
        for hook in self._hooks:
            hook.remove()


def _alone(calls: list[tuple[nn.Module, tuple]]) -> float:
    """Seconds that the layers take by themselves, forward and backward."""
    began = time.perf_counter()
    sum((_total(layer(*inputs)) for layer, inputs in calls), torch.zeros(())).backward()
    return time.perf_counter() - began


def _total(output: object) -> torch.Tensor:
    """The sum of all tensors with a graph in an output."""
    if isinstance(output, torch.Tensor):
        return output.sum() if output.requires_grad else torch.zeros(())
    parts = output.values() if isinstance(output, dict) else output if isinstance(output, tuple) else ()
    return sum(map(_total, parts), torch.zeros(()))
