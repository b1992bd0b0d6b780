"""A finished sequence while it waits for the others: all that it brings, in one file. Does not import bpy."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.data.whole_file import whole_file

PIECES = {"body": StoredBody, "garment": StoredGarment, "sequence": StoredSequence}


def part_path(parts: Path, index: int) -> Path:
    """Place of a finished sequence until all are there."""
    return Path(parts) / f"{index:06d}.npz"


def save_part(parts: Path, index: int, part: Part) -> None:
    """Store arrays as they are, everything else as JSON, so that the file is either whole or absent."""
    arrays, plain = {}, {}
    for piece in PIECES:
        stored = getattr(part, piece)
        for field in () if stored is None else fields(stored):
            value = getattr(stored, field.name)
            if isinstance(value, np.ndarray):
                arrays[f"{piece}.{field.name}"] = value
            else:
                plain[f"{piece}.{field.name}"] = value
    with whole_file(part_path(parts, index)) as temporary:
        np.savez(temporary, plain=np.array(json.dumps(plain)), **arrays)


def load_part(parts: Path, index: int) -> Part:
    """A part as :func:`save_part` stored it; a field that there was not yet has its default."""
    with np.load(part_path(parts, index), allow_pickle=False) as file:
        values = json.loads(str(file["plain"])) | {name: file[name] for name in file.files if name != "plain"}
    found: dict[str, Any] = {}
    for piece, kind in PIECES.items():
        names = {field.name: f"{piece}.{field.name}" for field in fields(kind)}
        own = {name: values[stored] for name, stored in names.items() if stored in values}
        found[piece] = kind(**own) if own else None
    return Part(**found)
