"""Cost of a training step, and the share of its networks."""

from __future__ import annotations

import itertools

import torch
from omegaconf import DictConfig

from drape import config as conf
from drape.benchmark.device_step import DeviceStep
from drape.benchmark.measured import Circumstances, Measured
from drape.benchmark.simulator_step import SimulatorStep
from drape.data.statistics import training_statistics
from drape.errors import DrapeError
from drape.nets.products import multiply_by_onednn, products_of_training
from drape.training.step_cost import StepCost


class TrainingStep:
    """Phases of a training step [ms], medians over ``repeats``; see :class:`StepCost` and :class:`SimulatorStep`.

    With ``trainer=gpu`` on the GPU, the step of an energy eager and captured: :class:`DeviceStep`.

    Raises:
        DrapeError: no repeats, or no GPU.
    """

    def __init__(self, repeats: int):
        if repeats < 1:
            raise DrapeError(f"repeats: found {repeats}; expected a whole number from 1 on")
        self.repeats = repeats

    @products_of_training()
    def measure(self, config: DictConfig) -> Measured:
        """Of the model, loss and data of ``config``, composed from ``conf/train.yaml``."""
        on_gpu = config.trainer.accelerator == "gpu"
        if on_gpu and not torch.cuda.is_available():
            raise DrapeError("trainer.accelerator: found gpu, but PyTorch sees none here; use trainer=cpu")
        if "network" in config.model:
            return SimulatorStep(self.repeats).measure(config)
        circumstances = Circumstances()
        torch.manual_seed(config.seed)
        data = conf.instantiate(config.datamodule, fabrics=list(config.material))
        conf.set_statistics(training_statistics(data))
        energy = conf.instantiate(config.model)
        loss = {name: conf.instantiate(term) for name, term in config.loss.items()}
        loader = data.loader(data.train_sequences, data.batch_size, seed=config.seed)
        windows = itertools.chain.from_iterable(itertools.repeat(loader))  # epoch after epoch
        title = (
            f"A training step of {conf.chosen('model')}: width {config.scale.width}, batch {config.scale.batch_size}, "
            f"{self.repeats} steps"
        )
        if on_gpu:
            rows = DeviceStep(energy, loss, windows, torch.device("cuda")).measure(self.repeats)
            return Measured("training_step", title, rows, f"{torch.cuda.get_device_name()}; {circumstances.text()}")
        multiply_by_onednn()
        cost = StepCost(energy, loss, windows).measure(self.repeats)
        beyond = cost["step"] / cost["networks"] - 1.0
        title += f"; beyond the networks {100 * beyond:.0f} % of their forward and backward time"
        rows = [{"part": name, "ms": 1e3 * seconds} for name, seconds in cost.items()]
        return Measured("training_step", title, rows, circumstances.text())
