"""Measurements of cost and accuracy, in one run each: ``python src/benchmark.py measure=held_out``."""

from __future__ import annotations

import dataclasses
import os

from omegaconf import DictConfig
from rich.console import Console

from drape import config as conf


@conf.main("benchmark")
def main(config: DictConfig) -> None:
    measured = conf.instantiate(config.measure).measure(config)
    table = measured.table()
    body = dataclasses.replace(table, title="", note="").terminal()
    Console().print(table.title, body, table.note, sep="\n", soft_wrap=True, highlight=False, markup=False)
    print(*(os.path.relpath(path) for path in measured.save(config.folder)), sep="\n")


if __name__ == "__main__":
    main()
