"""CLOTH3D into one file: ``python src/generate.py data=cloth3d data.root=...``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import yaml

from drape.data.cloth3d.bodies import Bodies, MeshBodies, SmplBodies
from drape.data.cloth3d.sequence import SequenceReader
from drape.data.conversion import Conversion, convert, frame_range
from drape.data.split_lists import read_splits
from drape.data.stored_part import Header
from drape.errors import DrapeError

FPS = 30.0
"""CLOTH3D's frames per second [1/s]."""


def convert_cloth3d(data: Mapping) -> Conversion:
    """Convert the sequences that the config node names into ``data.path``; those that cannot be read are left out.

    Raises:
        DrapeError: a mistake in the config, no sequence that can be converted, another data set in the way.
    """
    root, path = Path(data["root"]), Path(data["path"])
    first, stop = frame_range(data["frames"])
    if not root.is_dir():
        raise DrapeError(
            f"data.root: {root}: no such folder; expected CLOTH3D, one folder a sequence with an info.mat in it"
        )
    splits = read_splits({path.parent.name for path in root.glob("*/info.mat")}, data["train"], data["test"])
    materials = {fabric: _settings(fabric, node) for fabric, node in data["fabrics"].items()}
    config = {"data": {key: value for key, value in data.items() if key != "path"}}
    header = Header(
        source="cloth3d",
        fps=FPS,
        gravity=(0.0, 0.0, -float(data["gravity"])),
        materials=materials,
        config=yaml.safe_dump(config, sort_keys=False),
    )
    reader = SequenceReader(
        root=root,
        bodies=_bodies(data),
        first=first,
        stop=stop,
        fabrics=materials,
        friction=float(data["friction"]),
        splits=splits,
    )
    return convert(path, config, header, splits, reader.read)


def _settings(fabric: str, node: Mapping) -> dict[str, float | int | str]:
    """Blender's settings of a fabric; CLOTH3D does not say how many solver steps it took (0: not known)."""
    settings = {key: value for key, value in node.items() if key not in ("_target_", "name")}
    return settings | {"preset": fabric.capitalize(), "quality": 0}


def _bodies(data: Mapping) -> Bodies:
    if data["bodies"] == "smpl":
        return SmplBodies(data["smpl"])
    folder = Path(data["bodies"])
    if not folder.is_dir():
        raise DrapeError(
            f"data.bodies: {folder}: no such folder; expected smpl, or a folder with <sequence>.npz (faces, positions "
            "[m], fps)"
        )
    return MeshBodies(folder, 1.0 / FPS)
