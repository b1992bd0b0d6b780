"""Simulate cloth or garments in Blender, or convert recorded ones: ``python src/generate.py data=garments``."""

from __future__ import annotations

import time
from typing import Any

from omegaconf import DictConfig, OmegaConf

from drape import config as conf


@conf.main("generate")
def main(config: DictConfig) -> None:
    settings: Any = OmegaConf.to_container(config, resolve=True)
    source = settings["data"].get("source", "cloth")
    if source in ("cloth", "garments"):
        _simulate(source, settings)
    else:
        _read(source, settings["data"])


def _simulate(source: str, settings: dict) -> None:
    from drape.blender.generation import generate
    from drape.report.contact_sheet import draw_contact_sheet
    from drape.report.dataset_card import dataset_card

    began = time.perf_counter()
    file, made = generate(settings["data"], settings["material"], settings["workers"])
    took = f"simulated in {time.perf_counter() - began:.0f} s"
    told = took if made else "was already there with this configuration: nothing to simulate"
    print(dataset_card(file), told, sep="\n")
    sheet = file.path.with_suffix(".png")
    if made or not sheet.exists():
        draw_contact_sheet(file, sheet)
    print(f"contact sheet: {sheet}")
    if settings["clips"].pop("render") and source == "garments":
        from drape.report.garment_clips import render_garment_clips

        print("clips:", *render_garment_clips(file, **settings["clips"]), sep="\n  ")


def _read(source: str, data: dict) -> None:
    if source == "recorded":
        from drape.report.recorded import read_recordings

        return print(read_recordings(data))
    from drape.data.sources import converter

    conversion = converter(source)(data)
    how = "made" if conversion.made else "was already there with this configuration"
    print(f"{conversion.path}: {conversion.converted} sequences; {how}")
    conversion.refuse_left_out()


if __name__ == "__main__":
    main()
