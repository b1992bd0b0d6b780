"""Data sets that an energy is learned from: Blender's trajectories of one mesh, or recordings of cloth of any mesh."""

from __future__ import annotations

from pathlib import Path

from drape.data import recording_schema
from drape.data.hdf5 import TrajectoryFile, open_hdf5
from drape.data.recording_hdf5 import RecordingFile
from drape.data.schema import plain

Trajectories = TrajectoryFile | RecordingFile
"""Both know their ``fabrics``, ``materials``, ``gravity`` and ``dt``, and of each sequence its piece and positions."""


def open_trajectories(path: Path | str) -> Trajectories:
    """The data set at ``path``, by what it says it is.

    Raises:
        DrapeError: no such file, or see the two classes.
    """
    with open_hdf5(Path(path), f"python src/generate.py data.path={path}") as file:
        recorded = plain(file.attrs.get("format", "")) == recording_schema.FORMAT
    return RecordingFile(path) if recorded else TrajectoryFile(path)
