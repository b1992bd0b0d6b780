"""One training from config to record: data, statistics, fit (or its continuation), test."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import lightning
import numpy as np
from omegaconf import DictConfig, OmegaConf

from drape import config as conf
from drape.data.datamodule import TrajectoryDataModule
from drape.data.statistics import training_statistics
from drape.energy.checkpoint import versions
from drape.energy.mass_spring import MassSpringLaw
from drape.errors import DrapeError
from drape.loss.contrastive import Contrastive
from drape.metrics.family import energy_metrics
from drape.metrics.record import FILE, RunRecord
from drape.training.callbacks import SelfDescription, Stopwatch
from drape.training.energy_training import EnergyTraining
from drape.training.loggers import close_loggers, open_loggers
from drape.training.messages import silence

LAW_WINDOWS = 1024
"""Training windows that the mass-spring law is fitted on, evenly spaced."""
METRIC_SIGMA = 1e-5
"""Largest standard deviation of the disturbances whose violations are counted [m]."""


def train(config: DictConfig, folder: Path, choices: Mapping[str, str]) -> RunRecord:
    """Train what ``config`` says, in ``folder``; continue there if it was interrupted, return its record if finished.

    Args:
        config: composed from ``conf/train.yaml``.
        folder: run directory; gets ``config.yaml`` (resolved), ``checkpoints/``, logs and ``metrics.json``.
        choices: options of the groups, for the record.

    Raises:
        DrapeError: mistakes in the config, faulty data, or another config in the folder.
    """
    conf.check_config(config, supplied={"datamodule": ["fabrics"], "training": ["metrics"]})
    silence()
    lightning.seed_everything(config.seed, verbose=False)
    data: TrajectoryDataModule = conf.instantiate(config.datamodule, fabrics=list(config.material))
    conf.set_statistics(training_statistics(data))
    plain = OmegaConf.to_container(config, resolve=True)
    if not config.trainer.get("fast_dev_run") and _finished(plain, folder):
        print(f"finished before with this configuration: {folder / FILE}", file=sys.stderr)
        return RunRecord.load(folder)
    metrics = energy_metrics(
        data.file.fabrics,
        contrastive=Contrastive(weight=1.0, sigma=METRIC_SIGMA),
        tension={name: float(material["tension_stiffness"]) for name, material in data.file.materials.items()},
        law=_mass_spring_law(data),
    )
    training: EnergyTraining = conf.instantiate(OmegaConf.create(plain["training"]), metrics=metrics)
    trainer = _trainer(plain, folder, data)
    last = folder / "checkpoints" / "last.ckpt"
    try:
        trainer.fit(training, data, ckpt_path=last if last.is_file() else None, weights_only=True)
        seconds = next(c.seconds for c in trainer.callbacks if isinstance(c, Stopwatch))
        if trainer.interrupted:
            raise KeyboardInterrupt
        results = trainer.test(training, data, verbose=False)[0]
    finally:
        close_loggers(trainer.loggers)
    record = _record(plain, choices, training, data, results, seconds)
    if trainer.is_global_zero and not config.trainer.get("fast_dev_run"):
        record.save(folder)
    return record


def _finished(plain: dict[str, Any], folder: Path) -> bool:
    """Whether the folder holds the result of this config; leaves the config there if the folder has none yet.

    Raises:
        DrapeError: the folder belongs to another config.
    """
    path = folder / "config.yaml"
    if path.is_file():
        before = OmegaConf.to_container(OmegaConf.load(path))
        different = sorted(_result(before) ^ _result(plain))
        if different:
            names = ", ".join(dict.fromkeys(name for name, _ in different))
            raise DrapeError(
                f"{folder}: holds a run with other values of {names}; "
                "give this one another name=..., or delete the folder"
            )
    else:
        folder.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}.tmp")
        OmegaConf.save(plain, temporary)
        os.replace(temporary, path)
    return (folder / FILE).is_file()


def _result(config: dict[str, Any]) -> set[tuple[str, str]]:
    """The values that decide what comes out; who watches and where it is logged does not."""
    return set(_leaves({name: node for name, node in config.items() if name not in ("callbacks", "logger")}).items())


def _leaves(tree: Any, path: str = "") -> dict[str, str]:
    if isinstance(tree, dict):
        nodes = {f"{path}.{name}" if path else str(name): node for name, node in tree.items()}
        return {leaf: value for name, node in nodes.items() for leaf, value in _leaves(node, name).items()}
    return {path: repr(tree)}


def _trainer(plain: dict[str, Any], folder: Path, data: TrajectoryDataModule) -> lightning.Trainer:
    callbacks = [conf.instantiate(OmegaConf.create(node)) for node in plain["callbacks"].values()]
    example = data.windows(data.validation_sequences, np.arange(1))
    callbacks += [SelfDescription(plain, example), Stopwatch()]
    loggers = open_loggers(plain, folder)
    return conf.instantiate(OmegaConf.create(plain["trainer"]), callbacks=callbacks, logger=loggers)


def _mass_spring_law(data: TrajectoryDataModule) -> MassSpringLaw:
    return MassSpringLaw.fit(data.spaced_windows(LAW_WINDOWS, data.eval_batch_size), len(data.file.fabrics))


def _record(
    plain: dict[str, Any],
    choices: Mapping[str, str],
    training: EnergyTraining,
    data: TrajectoryDataModule,
    results: Mapping[str, float],
    seconds: float,
) -> RunRecord:
    return RunRecord(
        model=choices["model"],
        ablation=choices["ablation"],
        seed=plain["seed"],
        variant={name: choices[name] for name in ("potential", "dissipation", "loss") if name in choices},
        setting={
            "data": plain["data"]["name"],
            "material": choices["material"],
            "scale": choices["scale"],
            "width": plain["scale"]["width"],
            "steps": training.global_step,
        },
        metrics={name.removeprefix("test/"): float(value) for name, value in results.items()},
        provenance={
            "command": "python src/train.py " + choices["overrides"],
            "data": plain["data"]["path"],
            "train_sequences": len(data.train_sequences),
            "test_sequences": len(data.test_sequences),
            "seconds": round(seconds, 1),
            "parameters": sum(p.numel() for p in training.energy.parameters()),
            "versions": versions(),
        },
    )
