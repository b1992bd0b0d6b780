"""A fabric that a table or a data set of recordings knows, and no preset."""

from __future__ import annotations

from pathlib import Path

from drape.data.trajectories import open_trajectories
from drape.energy.law.baked.file import read_baked
from drape.errors import DrapeError
from drape.scene.material import Material


def own_fabric(name: str, source: str, mass_per_vertex: float = 1.0) -> Material:
    """The fabric of a table (npz), or the one called ``name`` of a data set (HDF5).

    ``mass_per_vertex`` [kg] stands in the config for scenes that weigh by vertex; the fabric keeps that of its data.

    Raises:
        DrapeError: another kind of file, no such file, no such fabric in it, or a mass that is not positive.
    """
    if not mass_per_vertex > 0:
        raise DrapeError(f"fabric.mass_per_vertex: found {mass_per_vertex}; expected a positive number")
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
