"""The settings that determine a data set: config nodes ``data`` and ``material``, checked, as plain values."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping, Sequence

from drape.blender.presets import blender_version, fabric_settings
from drape.data.difference import flatten
from drape.errors import DrapeError
from drape.geometry.grid import PATTERNS

Bounds = tuple[type, int | float, int | float]
"""Kind of a number, lowest and highest allowed value."""
NUMBERS = {
    "seed": (int, 0, math.inf),
    "size": (float, 1e-3, math.inf),
    "resolution": (int, 3, math.inf),
    "fps": (float, 1, math.inf),
    "frames": (int, 3, math.inf),
    "gravity": (float, 0, math.inf),
    "counts.train": (int, 0, math.inf),
    "counts.test": (int, 0, math.inf),
    "start.turning": (float, 0, 179),
    "start.stiff_turning": (float, 0, math.inf),
    "start.curvature": (float, 0, math.inf),
    "start.swing": (float, -180, 180),
    "start.preroll": (int, 0, math.inf),
    "start.push": (float, 0, math.inf),
    "reject.strain": (float, 1e-9, math.inf),
    "reject.energy": (float, 1e-9, math.inf),
    "reject.attempts": (int, 1, math.inf),
}
"""Every number of ``data``: kind, lowest and highest allowed value; units stand in ``conf/data/cloth.yaml``."""
RANGES = ("start.swing", "start.preroll")
"""Those that are pairs [lowest, highest]."""
TEXTS = ("name", "path", "pattern")
NOT_IN_REQUEST = ("name", "path")
"""Keys of ``data`` that do not change the data."""


def check_data(data: Mapping) -> None:
    """Refuse a ``data`` node with missing or unknown keys, or with values that no data set can have.

    Raises:
        DrapeError: the key, what was found, what is expected.
    """
    flat = flatten(data)
    check_keys(flat, [*NUMBERS, *TEXTS], "conf/data/cloth.yaml")
    for key, bounds in NUMBERS.items():
        (check_pair if key in RANGES else check_number)(key, flat[key], bounds)
    if flat["pattern"] not in PATTERNS:
        raise DrapeError(f"data.pattern: found {flat['pattern']!r}; expected one of {', '.join(PATTERNS)}")
    if flat["counts.train"] + flat["counts.test"] == 0:
        raise DrapeError("data.counts: no sequences at all; expected at least one")


def check_keys(flat: Mapping[str, object], expected: Sequence[str], page: str) -> None:
    """Refuse a ``data`` node (flattened) that has other keys than those of its ``page`` in conf/.

    Raises:
        DrapeError: the first key that is unknown or missing.
    """
    for key in flat:
        if key not in expected:
            close = difflib.get_close_matches(key, expected, n=1)
            raise DrapeError(f"data.{key}: no such key" + (f"; did you mean data.{close[0]}?" if close else ""))
    for key in expected:
        if key not in flat:
            raise DrapeError(f"data.{key}: missing; see {page}")


def check_pair(key: str, value: object, bounds: Bounds) -> None:
    """Refuse a value of ``data.<key>`` that is not a pair [lowest, highest] of numbers within ``bounds``.

    Raises:
        DrapeError: the key, what was found, what is expected.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise DrapeError(f"data.{key}: found {value!r}; expected [lowest, highest]")
    for number in value:
        check_number(key, number, bounds)
    if value[0] > value[1]:
        raise DrapeError(f"data.{key}: found {value}; expected the lower number first")


def check_number(key: str, value: object, bounds: Bounds) -> None:
    """Refuse a value of ``data.<key>`` that is not of the kind, or not from the lowest to the highest, in ``bounds``.

    Raises:
        DrapeError: the key, what was found, what is expected.
    """
    kind, lowest, highest = bounds
    right = isinstance(value, int if kind is int else (int, float)) and not isinstance(value, bool)
    if not right or not math.isfinite(value) or not lowest <= value <= highest:
        what = "a whole number" if kind is int else "a number"
        bounds = f"from {lowest} on" if highest == math.inf else f"from {lowest} to {highest}"
        raise DrapeError(f"data.{key}: found {value!r}; expected {what} {bounds}")


def make_request(data: Mapping, material: Mapping) -> dict:
    """Request of the user, without names of files: two equal requests give equal data with the same Blender.

    Raises:
        DrapeError: see :func:`check_data`; or a fabric without a preset.
    """
    check_data(data)
    check_material(material)
    request = {"data": {k: v for k, v in data.items() if k not in NOT_IN_REQUEST}, "material": material}
    return json.loads(json.dumps(request))


def check_material(material: Mapping) -> None:
    """Refuse a ``material`` node that names no fabric, or says of one more than its preset and overrides.

    Raises:
        DrapeError: the fabric, what was found, what is expected.
    """
    if not material:
        raise DrapeError("material: no fabric; expected material=all or another of conf/material/*.yaml")
    for fabric, entry in material.items():
        if not isinstance(entry, Mapping) or "preset" not in entry or set(entry) - {"preset", "overrides"}:
            raise DrapeError(f"material.{fabric}: found {entry}; expected the keys preset and overrides only")


def make_plan(request: Mapping) -> dict:
    """A request with what only the installed Blender knows: ``settings`` per fabric and ``blender_version``.

    Raises:
        DrapeError: Blender is missing, or a preset or one of its settings is unknown.
    """
    settings = {
        fabric: fabric_settings(fabric, entry["preset"], entry.get("overrides") or {})
        for fabric, entry in request["material"].items()
    }
    return json.loads(json.dumps({**request, "settings": settings, "blender_version": blender_version()}))
