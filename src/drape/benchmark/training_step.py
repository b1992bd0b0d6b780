"""What a training step costs, and how much of it is not network."""

from __future__ import annotations

import torch
from omegaconf import DictConfig

from drape import config as conf
from drape.benchmark.measured import Circumstances, Measured
from drape.benchmark.simulator_step import SimulatorStep
from drape.data.statistics import training_statistics
from drape.errors import DrapeError
from drape.training.step_cost import StepCost


class TrainingStep:
    """Phases of a training step [ms], medians over ``repeats``; see :class:`StepCost` and :class:`SimulatorStep`.

    Raises:
        DrapeError: no repeats.
    """

    def __init__(self, repeats: int):
        if repeats < 1:
            raise DrapeError(f"repeats: found {repeats}; expected a whole number from 1 on")
        self.repeats = repeats

    def measure(self, config: DictConfig) -> Measured:
        """Of the model, loss and data of ``config``, composed from ``conf/train.yaml``."""
        if "network" in config.model:
            return SimulatorStep(self.repeats).measure(config)
        circumstances = Circumstances()
        torch.manual_seed(config.seed)
        data = conf.instantiate(config.datamodule, fabrics=list(config.material))
        conf.set_statistics(training_statistics(data))
        energy = conf.instantiate(config.model)
        loss = {name: conf.instantiate(term) for name, term in config.loss.items()}
        loader = data.loader(data.train_sequences, data.batch_size, seed=config.seed)
        cost = StepCost(energy, loss, iter(loader)).measure(self.repeats)
        beyond = cost["step"] / cost["networks"] - 1.0
        title = (
            f"A training step of {conf.chosen('model')}: width {config.scale.width}, batch {config.scale.batch_size}, "
            f"{self.repeats} steps; beyond the networks {100 * beyond:.0f} % of their forward and backward time"
        )
        rows = [{"part": name, "ms": 1e3 * seconds} for name, seconds in cost.items()]
        return Measured("training_step", title, rows, circumstances.text())
