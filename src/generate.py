"""Simulate cloth or garments in Blender, or convert recorded ones: ``python src/generate.py data=garments``."""

from __future__ import annotations

import time

from omegaconf import DictConfig, OmegaConf

from drape import config as conf
from drape.errors import DrapeError


@conf.main("generate")
def main(config: DictConfig) -> None:
    settings = OmegaConf.to_container(config, resolve=True)
    source = settings["data"].get("source", "cloth")
    if source in ("cloth", "garments"):
        _simulate(source, settings)
    elif source == "recorded":
        _read(settings["data"])
    elif source in ("cloth3d", "vto"):
        _convert(source, settings["data"])
    else:
        known = "garments, recorded, cloth3d, vto, or nothing for a cloth"
        raise DrapeError(f"data.source: found {source!r}; expected {known}")


def _simulate(source: str, settings: dict) -> None:
    if source == "cloth":
        from drape.blender.generation import generate
        from drape.report.contact_sheet import draw_contact_sheet as draw
        from drape.report.dataset_card import dataset_card as card
    else:
        from drape.blender.garment_generation import generate_garments as generate
        from drape.report.garment_card import garment_card as card
        from drape.report.garment_clips import render_garment_clips
        from drape.report.garment_sheet import draw_garment_sheet as draw
    began = time.perf_counter()
    file, made = generate(settings["data"], settings["material"], settings["workers"])
    seconds = time.perf_counter() - began
    print(card(file))
    print(f"simulated in {seconds:.0f} s" if made else "was already there with this configuration: nothing to simulate")
    sheet = file.path.with_suffix(".png")
    if made or not sheet.exists():
        draw(file, sheet)
    print(f"contact sheet: {sheet}")
    if settings["clips"].pop("render") and source == "garments":
        print("clips:", *render_garment_clips(file, **settings["clips"]), sep="\n  ")


def _read(data: dict) -> None:
    from drape.data.recorded.conversion import convert_recorded
    from drape.report.contact_sheet import draw_contact_sheet
    from drape.report.dataset_card import dataset_card
    from drape.report.shown_motion import shown_motion

    file, made = convert_recorded(data)
    try:
        motion = shown_motion(file)
    except DrapeError:  # the settings are wrong, and so is what was made with them
        file.path.unlink()
        raise
    print(dataset_card(file))
    print(motion)
    sheet = file.path.with_suffix(".png")
    if made or not sheet.exists():
        draw_contact_sheet(file, sheet)
    print(f"contact sheet: {sheet}")
    print("read now" if made else "was already there with this configuration: nothing to read")


def _convert(source: str, data: dict) -> None:
    if source == "cloth3d":
        from drape.data.cloth3d.conversion import convert_cloth3d as convert
    else:
        from drape.data.vto.conversion import convert_vto as convert
    conversion = convert(data)
    how = "made" if conversion.made else "was already there with this configuration"
    print(f"{conversion.path}: {conversion.converted} sequences; {how}")
    conversion.refuse_left_out()


if __name__ == "__main__":
    main()
