"""People of anny on their way to Blender's processes, which never load torch: one file of arrays each. No bpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np

from drape.data.whole_file import whole_file
from drape.figure.anny_model import AnnyBody, anny_body
from drape.figure.phenotype import Phenotype


def people_of(parts: Path) -> Path:
    """The folder of the people of a data set, in that of its parts."""
    return parts / "people"


def save_people(parts: Path, shapes: Mapping[int, Phenotype]) -> None:
    """Make the people of these numbers that are not there yet; loads anny, and with it torch.

    Raises:
        DrapeError: anny is missing.
    """
    for number, shape in shapes.items():
        path = people_of(parts) / f"{number:03d}.npz"
        if not path.exists():
            with whole_file(path) as temporary:
                np.savez(temporary, **vars(anny_body(shape)))


def load_person(path: Path) -> AnnyBody:
    """A person as :func:`save_people` stored it."""
    with np.load(path, allow_pickle=False) as file:
        return AnnyBody(**{field.name: file[field.name] for field in fields(AnnyBody)})
