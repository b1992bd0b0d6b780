"""A finished sequence of a garment while it waits for the others: body, garment and frames in one file. No bpy."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np

from drape.blender.sequence import part_path
from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.data.whole_file import whole_file

PIECES = {"body": StoredBody, "garment": StoredGarment, "sequence": StoredSequence}


def save_garment_part(parts: Path, index: int, part: Part) -> None:
    """Store arrays as they are, everything else as JSON."""
    arrays, plain = {}, {}
    for piece in PIECES:
        stored = getattr(part, piece)
        for field in fields(stored):
            value = getattr(stored, field.name)
            if isinstance(value, np.ndarray):
                arrays[f"{piece}.{field.name}"] = value
            else:
                plain[f"{piece}.{field.name}"] = value
    with whole_file(part_path(parts, index)) as temporary:
        np.savez(temporary, plain=np.array(json.dumps(plain)), **arrays)


def load_garment_part(parts: Path, index: int) -> Part:
    """A part as :func:`save_garment_part` stored it."""
    with np.load(part_path(parts, index), allow_pickle=False) as file:
        values = json.loads(str(file["plain"])) | {name: file[name] for name in file.files if name != "plain"}
    pieces = {
        piece: kind(**{field.name: values[f"{piece}.{field.name}"] for field in fields(kind)})
        for piece, kind in PIECES.items()
    }
    return Part(**pieces)
