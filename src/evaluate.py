"""Scores of animated garments: ``python src/evaluate.py data=garments simulator=implicit energy=eunet_baked``."""

from __future__ import annotations

import os
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf
from drape.data.garment_hdf5 import GarmentFile
from drape.evaluation.garments import evaluate
from drape.evaluation.method import Method
from drape.evaluation.output import save
from drape.report.garment_curves import draw_garment_curves
from drape.report.garment_tables import kinds_table


@conf.main("evaluate")
def main(config: DictConfig) -> None:
    conf.check_config(config, contents="evaluate")
    overrides = list(HydraConfig.get().overrides.task)
    file, selection = GarmentFile(config.data.path), conf.instantiate(config.selection)
    method = Method(config, file, overrides)
    name = config.name or method.named(conf.chosen("simulator"), conf.chosen("energy"))
    folder = Path(config.folder or f"{config.runs}/{file.path.stem}_{selection.split}/{name}")
    scored = evaluate(method, selection.of(file), folder)
    record = save(scored, method, name, selection.split, " ".join(["python src/evaluate.py", *overrides]), folder)
    table = kinds_table(record)
    (folder / "table.md").write_text(table.markdown(), encoding="utf-8")
    draw_garment_curves(scored, folder / "by_frame.png")
    Console().print(table.terminal(), soft_wrap=True)
    names = ("metrics.json", "table.md", "sequences.csv", "by_frame.csv", "by_frame.png", "tensorboard", "sequences")
    print(*(os.path.relpath(folder / name) for name in names), sep="\n")


if __name__ == "__main__":
    main()
