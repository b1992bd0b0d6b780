"""A sequence out of one data set of garments, with its body and its garment, as it goes into another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drape.data.garment_hdf5 import GarmentFile
from drape.data.garment_schema import FIELDS, GROUP_ATTRIBUTES
from drape.data.garment_writer import GarmentWriter, StoredBody, StoredGarment, StoredGarmentSequence

STORED = {"bodies": StoredBody, "garments": StoredGarment, "sequences": StoredGarmentSequence}


class GarmentPart(NamedTuple):
    """All that a sequence brings to a data set; body and garment go by the names that the sequence gives them."""

    body: StoredBody
    garment: StoredGarment | None
    """None: the motion of a body alone."""
    sequence: StoredGarmentSequence

    def add_to(self, writer: GarmentWriter) -> None:
        """Add the sequence, and its body and garment if they are not there yet.

        Raises:
            DrapeError: something does not fit the schema.
        """
        if not writer.has("bodies", self.sequence.body):
            writer.add_body(self.sequence.body, self.body)
        if self.garment is not None and not writer.has("garments", self.sequence.garment):
            writer.add_garment(self.sequence.garment, self.garment)
        writer.add_sequence(self.sequence)


def stored_part(file: GarmentFile, name: str) -> GarmentPart:
    """Sequence ``name`` of a file with everything that it needs."""
    sequence = file.sequence(name)
    garment = _stored(file, "garments", sequence.garment) if sequence.garment else None
    return GarmentPart(_stored(file, "bodies", sequence.body), garment, _stored(file, "sequences", name, name=name))


def _stored(
    file: GarmentFile, kind: str, group: str, **more: str
) -> StoredBody | StoredGarment | StoredGarmentSequence:
    where = f"{kind}/{group}"
    attributes = {key: file.index.groups[kind][group][key] for key in GROUP_ATTRIBUTES[kind]}
    arrays: dict[str, np.ndarray] = {
        entry.name: file.array(f"{where}/{entry.name}")
        for entry in FIELDS[kind]
        if f"{where}/{entry.name}" in file.index.layouts
    }
    return STORED[kind](**attributes, **arrays, **more)
