"""Recordings become a data set: read, checked against gravity, described and drawn."""

from __future__ import annotations

from collections.abc import Mapping

from drape.data.recorded.conversion import convert_recorded
from drape.errors import DrapeError
from drape.report.contact_sheet import draw_contact_sheet
from drape.report.dataset_card import dataset_card
from drape.report.shown_motion import shown_motion


def read_recordings(data: Mapping) -> str:
    """Make the data set of the node ``data`` (conf/data/recorded.yaml) with its contact sheet; returns its card.

    Raises:
        DrapeError: see :func:`convert_recorded`; or its motion shows another gravity, and nothing is left.
    """
    file, made = convert_recorded(data)
    try:
        motion = shown_motion(file)
    except DrapeError:  # the settings are wrong, and so is what was made with them
        file.path.unlink()
        raise
    sheet = file.path.with_suffix(".png")
    if made or not sheet.exists():
        draw_contact_sheet(file, sheet)
    done = "read now" if made else "was already there with this configuration: nothing to read"
    return "\n".join([dataset_card(file), motion, f"contact sheet: {sheet}", done])
