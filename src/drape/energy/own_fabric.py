"""A fabric that a table or a data set of recordings knows, and no preset."""

from __future__ import annotations

from pathlib import Path

from drape.data.trajectories import open_trajectories
from drape.energy.baked_file import read_baked
from drape.errors import DrapeError
from drape.scene.material import Material


def own_fabric(name: str, source: str) -> Material:
    """The fabric of a table (npz), or the one called ``name`` of a data set (HDF5).

    Raises:
        DrapeError: another kind of file, no such file, or no such fabric in it.
    """
    kind = Path(source).suffix.lower()
    if kind == ".npz":
        return read_baked(source).fabric
    if kind not in (".h5", ".hdf5"):
        raise DrapeError(
            f"fabric.source: found {source}; expected a table of python src/bake.py (npz), or a data set of "
            "python src/generate.py data=recorded (h5)"
        )
    file = open_trajectories(source)
    if name not in file.fabrics:
        raise DrapeError(
            f"{source}: found no fabric {name!r}; expected one of {', '.join(file.fabrics)}: set fabric.name"
        )
    return Material.from_settings(name, file.materials[name])
