"""Recordings become a data set: read, checked against gravity, described and drawn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch

from drape.data.datamodule import TrajectoryDataModule
from drape.data.hdf5 import GarmentFile
from drape.data.recorded.conversion import convert_recorded
from drape.data.recorded.shown_gravity import shown_gravity
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.errors import DrapeError
from drape.report.contact_sheet import draw_contact_sheet
from drape.report.dataset_card import dataset_card
from drape.scene.material import ATTRIBUTES

WINDOWS = 300
"""Triplets of frames that the spring-hinge law is fitted on, evenly spaced over the training sequences."""


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


def shown_motion(file: GarmentFile) -> str:
    """The gravity that it shows, and how much of the internal forces of each fabric springs and hinges explain.

    Raises:
        DrapeError: the motion shows another gravity than the file says.
    """
    gravity = shown_gravity(file)
    lines = ["gravity: pins are not on one line, so the motion cannot tell whether rate and unit are right"]
    if gravity is not None:
        lines = [f"gravity: the motion shows {np.linalg.norm(gravity):.2f} m/s2"]
    for number, fabric in enumerate(file.fabrics):
        data = TrajectoryDataModule(str(file.path), [fabric], 1, 50, dict.fromkeys(ATTRIBUTES, 1.0), seed=None)
        windows = list(data.spaced_windows(WINDOWS, 50))
        law = SpringHingeLaw.fit([(window,) for window in windows], len(file.fabrics))
        force, left = (
            float(torch.cat([vectors[window.free] for vectors, window in pairs]).norm(dim=-1).mean())
            for pairs in ([(w.inertial_force, w) for w in windows], [(law.force_residual(w), w) for w in windows])
        )
        springs, hinges = law.stiffness[number].tolist()
        lines.append(
            f"{fabric}: a fit of springs ({springs:.3g} N/m) and hinges ({hinges:.2g} J) leaves "
            f"{100 * left / force:.1f} % of the internal forces ({force:.2g} N on a vertex)"
        )
    return "\n".join(lines)
