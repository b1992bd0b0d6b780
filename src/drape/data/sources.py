"""Data sets of others: each is a folder of ``drape.data`` whose module ``conversion`` reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from drape.config.target import locate
from drape.data.conversion import Conversion
from drape.errors import DrapeError


def converter(source: str) -> Callable[[Mapping], Conversion]:
    """The function ``convert_<source>`` of ``drape.data.<source>.conversion``.

    Raises:
        DrapeError: there is none.
    """
    found = locate(f"drape.data.{source}.conversion.convert_{source}")
    if found is None:
        known = ", ".join(sorted(file.parent.name for file in Path(__file__).parent.glob("*/conversion.py")))
        raise DrapeError(f"data.source: found {source!r}; expected garments, {known}, or nothing")
    return found
