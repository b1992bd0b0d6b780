"""What a training step costs, and how much of it is not network: ``python src/benchmark.py model=eunet_stable``."""

from __future__ import annotations

import torch
from omegaconf import DictConfig
from rich.console import Console
from rich.table import Table

from drape import config as conf
from drape.data.statistics import training_statistics
from drape.training.step_cost import StepCost


@conf.main("benchmark")
def main(config: DictConfig) -> None:
    conf.check_config(config, contents="benchmark", supplied={"datamodule": ["fabrics"], "training": ["metrics"]})
    torch.manual_seed(config.seed)
    data = conf.instantiate(config.datamodule, fabrics=list(config.material))
    conf.set_statistics(training_statistics(data))
    energy = conf.instantiate(config.model)
    loss = {name: conf.instantiate(term) for name, term in config.loss.items()}
    loader = data.loader(data.train_sequences, data.batch_size, seed=config.seed)
    cost = StepCost(energy, loss, iter(loader)).measure(config.repeats)
    beyond = cost["step"] / cost["networks"] - 1.0
    threads, size = torch.get_num_threads(), f"width {config.scale.width}, batch {config.scale.batch_size}"
    table = Table("part", "ms")
    for name, seconds in cost.items():
        table.add_row(name, f"{1e3 * seconds:.1f}")
    heading = f"{conf.chosen('model')}: {size}, {threads} threads, {config.repeats} steps"
    Console().print(heading, table, f"beyond the networks: {100 * beyond:.0f} % of their forward and backward time")


if __name__ == "__main__":
    main()
