"""Data sets of recordings of version 1, read as files of today.

Version 1 stored meshes, pins and masses below ``pieces/``, and of a sequence the number of its piece and fabric.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from drape.data.index import Index, layout_of
from drape.data.mesh_check import check_masses, check_mesh
from drape.data.schema import AGAIN, ATTRIBUTES, FIELDS, RECORDED_MATERIAL, SPLITS, plain
from drape.data.schema_check import check_attributes, check_materials
from drape.errors import DrapeError
from drape.stored import attribute

PIECE = tuple(
    replace(field, dtype="float32" if field.name == "rest_positions" else field.dtype)
    for field in FIELDS["garments"]
    if field.name in ("rest_positions", "faces", "pinned", "mass")
)
"""Datasets of each group ``pieces/<number>``."""
LATER = ("source", "seed")
"""Attributes that a file did not have."""


def index_of_recordings(file: h5py.File, path: Path) -> Index:
    """Read and check everything but the values of positions, which are checked where they are read.

    Raises:
        DrapeError: path, name, what was found, what was expected, what to do.
    """
    attributes = check_attributes(file, path, {k: v for k, v in ATTRIBUTES.items() if k not in LATER})
    attributes |= {"source": "recorded", "seed": 0}
    index = Index(attributes, check_materials(file, path, attributes["fabrics"], RECORDED_MATERIAL))
    pieces, count = len(file.get("pieces", ())), len(file.get("sequences", ()))
    if not pieces or not count:
        raise DrapeError(f"{path}: found {pieces} pieces and {count} sequences; expected some; {AGAIN}")
    for number in range(pieces):
        _add_piece(index, file, path, str(number))
    for number in range(count):
        _add_sequence(index, file, path, f"{number:06d}")
    return index


def _add_piece(index: Index, file: h5py.File, path: Path, name: str) -> None:
    where, group = f"pieces/{name}", file[f"pieces/{name}"]
    lengths: dict[str, int] = {}
    for field in PIECE:
        full = replace(field, name=f"{where}/{field.name}")
        index.layouts[f"garments/{name}/{field.name}"] = layout_of(group.get(field.name), path, full, lengths)
    check_mesh({key: dataset[:] for key, dataset in group.items()}, f"{path}: {where}")
    check_masses(group["mass"][:], f"{path}: {where}")
    index.groups["garments"][name] = {"kind": "sheet", "body": "", "style": {}}


def _add_sequence(index: Index, file: h5py.File, path: Path, name: str) -> None:
    where, group = f"{path}: sequences/{name}", file[f"sequences/{name}"]
    limits = {"piece": len(index.groups["garments"]), "fabric": len(index.materials), "split": len(SPLITS)}
    found = {key: plain(group.attrs.get(key, -1)) for key in limits}
    for key, stop in limits.items():
        if not 0 <= found[key] < stop:
            raise DrapeError(f"{where}: attribute {key}: found {found[key]}; expected 0..{stop - 1}; {AGAIN}")
    field = replace(FIELDS["sequences"][0], name=f"sequences/{name}/positions")
    garment = str(found["piece"])
    vertices = index.layouts[f"garments/{garment}/rest_positions"].shape[0]
    index.layouts[field.name] = layout_of(group.get("positions"), path, field, {"vertices": vertices})
    index.groups["sequences"][name] = {
        "garment": garment,
        "body": "",
        "fabric": index.attributes["fabrics"][found["fabric"]],
        "motion": attribute(path, f"name of sequences/{name}", group.attrs.get("name"), "a text"),
        "split": SPLITS[found["split"]],
        "attempts": 1,
        "mass_per_vertex": float(np.mean(file[f"pieces/{garment}/mass"][:])),
        "friction": 0.0,
        "quality": {},
    }
