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
    print(dataset_card(file))
    if made:
        print(f"generated in {time.perf_counter() - began:.0f} s")
    else:
        print(f"{file.path} was already there with this configuration; nothing was simulated")
    print(f"contact sheet: {draw_contact_sheet(file, file.path.with_suffix('.png'))}")


if __name__ == "__main__":
    main()
