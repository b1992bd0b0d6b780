"""Data sets for a purpose: cloth alone, that an energy is learned from, or garments on bodies, to animate."""

from __future__ import annotations

from pathlib import Path

from drape.data.hdf5 import GarmentFile
from drape.errors import DrapeError


def open_trajectories(path: Path | str) -> GarmentFile:
    """The data set at ``path``, all its frames checked; no sequence has a body.

    Raises:
        DrapeError: see :class:`GarmentFile`; or a body, a number that is not finite.
    """
    file = GarmentFile(path, f"python src/generate.py data.path={path}")
    for sequence in file.sequences:
        if sequence.body:
            raise DrapeError(
                f"{path}: sequences/{sequence.name}: found the body {sequence.body}; expected cloth without bodies, as "
                "contact is no part of a law; choose a data set of sheets or recordings: python src/generate.py"
            )
        _ = sequence.mesh  # one that is no cloth is refused now
    file.check_frames()
    return file


def open_dressed(path: Path | str) -> GarmentFile:
    """The data set at ``path``; every sequence has a body.

    Raises:
        DrapeError: see :class:`GarmentFile`; or a sheet.
    """
    file = GarmentFile(path)
    for sequence in file.sequences:
        sequence.check_body()
    return file
