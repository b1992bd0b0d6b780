"""Difference of two configurations, as a sentence for whoever asked for the second and found the first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drape.errors import DrapeError


def flatten(tree: Mapping, prefix: str = "") -> dict[str, Any]:
    """``{"a": {"b": 1}}`` as ``{"a.b": 1}``."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        inside = isinstance(value, Mapping) and value
        flat.update(flatten(value, f"{prefix}{key}.") if inside else {f"{prefix}{key}": value})
    return flat


def refuse_difference(found: Mapping, wanted: Mapping, where: Path, remedy: str) -> None:
    """Raise a DrapeError that lists the keys in which two configurations differ, if they do."""
    there, here = flatten(found), flatten(wanted)
    keys = [key for key in sorted(there | here) if there.get(key, "nothing") != here.get(key, "nothing")]
    if keys:
        lines = [f"{key}: {there.get(key, 'nothing')} there, {here.get(key, 'nothing')} asked for" for key in keys[:5]]
        more = f"; and {len(keys) - 5} more" if len(keys) > 5 else ""
        raise DrapeError(f"{where}: was made with another configuration ({'; '.join(lines)}{more}); {remedy}")
