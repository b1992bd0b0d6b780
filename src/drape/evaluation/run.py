"""One evaluation from config to record."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from omegaconf import DictConfig

from drape import config as conf
from drape.data.trajectories import open_dressed
from drape.evaluation.garments import evaluate
from drape.evaluation.method import Method
from drape.evaluation.output import save
from drape.evaluation.scored_sequence import ScoredSequence
from drape.metrics.record import EvaluationRecord


class Evaluated(NamedTuple):
    """Result of an evaluation, and its folder."""

    record: EvaluationRecord
    scored: list[ScoredSequence]
    folder: Path


def evaluate_config(config: DictConfig, overrides: list[str], *options: str) -> Evaluated:
    """Animate and score what a config composed from ``conf/evaluate.yaml`` says.

    ``overrides`` are those of its command line; ``options`` those of the groups that :meth:`Method.named` asks for.

    Raises:
        DrapeError: mistakes in the config or the data.
    """
    conf.check_config(config, contents="evaluate")
    file, selection = open_dressed(config.data.path), conf.instantiate(config.selection)
    method = Method(config, file, overrides)
    name = config.name or method.named(*options)
    folder = Path(config.folder or f"{config.runs}/{file.path.stem}_{selection.split}/{name}")
    scored = evaluate(method, selection.of(file), folder)
    command = conf.command_line("evaluate", overrides)
    return Evaluated(save(scored, method, name, selection.split, command, folder), scored, folder)
