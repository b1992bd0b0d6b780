"""One training from config to record: data, statistics, fit (or its continuation), what is left at the end."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import lightning
import torch
from omegaconf import DictConfig, OmegaConf

from drape import config as conf
from drape.config.target import locate
from drape.errors import DrapeError
from drape.nets.products import products_of_training
from drape.stored import reading
from drape.training.callbacks import SelfDescription, Stopwatch
from drape.training.continuation import alone, newest
from drape.training.loggers import close_loggers, open_loggers
from drape.training.messages import silence

UNTOLD = ("callbacks", "logger", "label", "ablation")
"""Nodes of a config that change no number."""


def train(config: DictConfig, folder: Path, choices: Mapping[str, str]) -> Path:
    """Train what ``config`` says, in ``folder``; continue there if it was interrupted, return the record if finished.

    The LightningModule of the node ``training`` knows what it needs of the data (``supplied``), what its checkpoints
    say of themselves (``described``), and what is left in the end (``finish``, in the file ``RECORD``).

    Args:
        config: composed from ``conf/train.yaml``.
        folder: run directory; gets ``config.yaml`` (resolved), ``checkpoints/``, logs and the record.
        choices: options of the groups, label and command, for the record.

    Raises:
        DrapeError: mistakes in the config, faulty data, or another config in the folder.
    """
    conf.check_config(config)
    with alone(folder), products_of_training():
        return _train(config, folder, choices)


def _train(config: DictConfig, folder: Path, choices: Mapping[str, str]) -> Path:
    silence()
    lightning.seed_everything(config.seed, verbose=False)
    data = conf.instantiate(config.datamodule, fabrics=list(config.material))
    conf.set_statistics(data.statistics())
    plain: Any = OmegaConf.to_container(config, resolve=True)
    kind, is_trial = locate(config.training._target_), bool(config.trainer.get("fast_dev_run"))
    record = folder / kind.RECORD
    if not is_trial and _finished(plain, folder, record):
        print(f"finished before with this configuration: {record}", file=sys.stderr)
        return record
    training = conf.instantiate(OmegaConf.create(plain["training"]), **kind.supplied(data))
    stopwatch = Stopwatch()
    description = SelfDescription(lambda: training.described(plain, choices, data, stopwatch.seconds))
    trainer = _trainer(plain, folder, [stopwatch, description])
    try:
        trainer.fit(training, data, ckpt_path=newest(folder / "checkpoints"), weights_only=True)
        seconds = stopwatch.seconds
        if trainer.interrupted:
            raise KeyboardInterrupt
        result = training.finish(plain, choices, data, seconds)
    finally:
        close_loggers(trainer.loggers)
    if trainer.is_global_zero and not is_trial:
        result.save(folder)
    if torch.distributed.is_initialized():  # what comes after is the work of one process, which waits for no other
        torch.distributed.destroy_process_group()
    return record


def _finished(plain: dict[str, Any], folder: Path, record: Path) -> bool:
    """Whether the folder holds the result of this config; leaves the config there if the folder has none yet.

    Raises:
        DrapeError: the folder belongs to another config.
    """
    path = folder / "config.yaml"
    begun = record.is_file() or any(folder.glob("checkpoints/*.ckpt"))  # a run that left nothing is in nobody's way
    if path.is_file() and begun:
        with reading(path, "delete the folder"):
            before: Any = OmegaConf.to_container(OmegaConf.load(path))
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
    return record.is_file()


def _result(config: dict[str, Any]) -> set[tuple[str, str]]:
    """The values that decide what comes out; who watches, where it is logged and what it is called does not."""
    return set(_leaves({name: node for name, node in config.items() if name not in UNTOLD}).items())


def _leaves(tree: Any, path: str = "") -> dict[str, str]:
    if isinstance(tree, dict):
        nodes = {f"{path}.{name}" if path else str(name): node for name, node in tree.items()}
        return {leaf: value for name, node in nodes.items() for leaf, value in _leaves(node, name).items()}
    return {path: repr(tree)}


def _trainer(plain: dict[str, Any], folder: Path, added: Sequence[lightning.Callback]) -> lightning.Trainer:
    callbacks = [conf.instantiate(OmegaConf.create(node)) for node in plain["callbacks"].values()]
    loggers = open_loggers(plain, folder)
    return conf.instantiate(OmegaConf.create(plain["trainer"]), callbacks=[*callbacks, *added], logger=loggers)
