"""Scores of animated garments: ``python src/evaluate.py data=garments simulator=implicit energy=eunet_baked``."""

from __future__ import annotations

import os

from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf
from drape.evaluation.run import evaluate_config
from drape.report.garment_curves import draw_garment_curves
from drape.report.garment_tables import kinds_table


@conf.main("evaluate")
def main(config: DictConfig) -> None:
    options = [conf.chosen(group) for group in ("simulator", "energy", "contact")]
    record, scored, folder = evaluate_config(config, conf.typed(), *options)
    table = kinds_table(record)
    (folder / "table.md").write_text(table.markdown(), encoding="utf-8")
    draw_garment_curves(scored, folder / "by_frame.png")
    Console().print(table.terminal(), soft_wrap=True)
    names = ("metrics.json", "table.md", "sequences.csv", "by_frame.csv", "by_frame.png", "tensorboard", "sequences")
    print(*(os.path.relpath(folder / name) for name in names), sep="\n")


if __name__ == "__main__":
    main()
