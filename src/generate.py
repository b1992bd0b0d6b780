"""Simulate a piece of cloth in Blender and store its trajectories: ``python src/generate.py data=cloth``."""

from __future__ import annotations

import time

from omegaconf import DictConfig, OmegaConf

from drape import config as conf
from drape.blender.generation import generate
from drape.report.contact_sheet import draw_contact_sheet
from drape.report.dataset_card import dataset_card


@conf.main("generate")
def main(config: DictConfig) -> None:
    settings = OmegaConf.to_container(config, resolve=True)
    began = time.perf_counter()
    file, made = generate(settings["data"], settings["material"], settings["workers"])
    seconds = time.perf_counter() - began
    print(dataset_card(file))
    print(f"simulated in {seconds:.0f} s" if made else "was already there with this configuration: nothing to simulate")
    sheet = file.path.with_suffix(".png")
    if made or not sheet.exists():
        draw_contact_sheet(file, sheet)
    print(f"contact sheet: {sheet}")


if __name__ == "__main__":
    main()
