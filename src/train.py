"""Learn an energy, or a simulator: ``python src/train.py model=eunet ablation=no_dissipation material=silk``."""

from __future__ import annotations

import os
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from lightning.pytorch.utilities.rank_zero import rank_zero_only
from omegaconf import DictConfig

from drape import config as conf
from drape.evaluation.run import evaluate_config
from drape.metrics.record import VARIANT, EvaluationRecord, SimulatorRecord
from drape.report.garment_tables import kinds_table
from drape.report.summary import summary
from drape.training.run import train

GROUPS = {name: name for name in ("model", "ablation", "material", "scale")} | VARIANT
"""Name in the record of a run -> config group."""


@conf.main("train")
def main(config: DictConfig) -> None:
    conf.check_ablation()
    choices = {name: conf.chosen(group) for name, group in GROUPS.items()}
    choices["label"] = conf.label(config)
    choices["command"] = conf.command_line("train", conf.typed())
    folder = Path(HydraConfig.get().runtime.output_dir)
    finish(config, folder, train(config, folder, choices))


@rank_zero_only
def finish(config: DictConfig, folder: Path, record: Path) -> None:
    """Say what was learned; animate the test split by a simulator. One process of many does."""
    print(summary(record))
    if config.evaluate and record.name == SimulatorRecord.FILE and record.is_file():
        print(kinds_table(scored(config, folder)).markdown())
    print(f"run directory: {os.path.relpath(folder)}")


def scored(config: DictConfig, folder: Path) -> EvaluationRecord:
    """The record of the trained simulator of ``folder`` on the test split, as src/evaluate.py would leave it."""
    place = os.path.relpath(folder)
    told = ["simulator=neural", f"simulator.checkpoint={place}/checkpoints/last.ckpt", f"data.path={config.data.path}"]
    told.append(f"folder={place}/evaluation")
    return evaluate_config(hydra.compose("evaluate", told), told, "neural").record


if __name__ == "__main__":
    main()
