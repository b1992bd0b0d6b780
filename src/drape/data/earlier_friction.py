"""Data sets of garments of version 1, read as files of today.

Version 1 stored as ``friction`` what the maker of the frames had: of Blender its own number, in the sequences and in
the configuration; of CLOTH3D and VTO a coefficient, as today. So the numbers of Blender become coefficients when such a
file is read; the file stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from drape.data.blender_friction import coefficient
from drape.data.schema import GARMENTS, VERSIONS
from drape.errors import DrapeError

MAKERS = ("blender", "cloth3d", "vto")
"""Whose friction of version 1 is understood."""


def mend(attributes: dict[str, Any], sequences: Mapping[str, dict], path: Path) -> None:
    """Give the attributes of a file of version 1 and of its sequences the meaning of today, in place.

    Raises:
        DrapeError: an unknown maker.
    """
    maker = str(attributes["source"]).split(" ")[0]
    if maker not in MAKERS:
        raise DrapeError(
            f"{path}: attribute source: found {attributes['source']!r} in a file of schema version 1; expected one of "
            f"{', '.join(MAKERS)}, whose friction is understood; make the file again"
        )
    if maker == "blender":
        for sequence in sequences.values():
            sequence["friction"] = coefficient(sequence["friction"])
        attributes["config"] = _mended_config(attributes["config"])
    attributes["schema_version"] = VERSIONS[GARMENTS]


def _mended_config(text: str) -> str:
    config = yaml.safe_load(text) or {}
    contact = (config.get("data") or {}).get("contact") or {}
    if "friction" not in contact:
        return text
    contact["friction"] = coefficient(contact["friction"])
    return yaml.safe_dump(config, sort_keys=False)
