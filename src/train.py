"""Learn an energy from trajectories: ``python src/train.py model=eunet ablation=no_dissipation material=silk``."""

from __future__ import annotations

import os
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from drape import config as conf
from drape.report.summary import summary
from drape.training.run import train

GROUPS = {
    "model": "model",
    "ablation": "ablation",
    "material": "material",
    "scale": "scale",
    "loss": "loss",
    "potential": "model/potential",
    "dissipation": "model/dissipation",
}
"""Name in the record of a run -> config group."""


@conf.main("train")
def main(config: DictConfig) -> float:
    conf.check_ablation()
    hydra = HydraConfig.get()
    choices = {name: conf.chosen(group) for name, group in GROUPS.items()}
    choices["overrides"] = " ".join(hydra.overrides.task)
    folder = Path(hydra.runtime.output_dir)
    record = train(config, folder, choices)
    print(summary(record))
    print(f"run directory: {os.path.relpath(folder)}")
    return record.metrics["energy_error_J2/overall"]


if __name__ == "__main__":
    main()
