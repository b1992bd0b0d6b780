"""The settings that determine a data set: config nodes ``data`` and ``material``, checked, as plain values. No bpy."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from drape.blender.presets import blender_version, fabric_settings
from drape.data.blender_friction import HIGHEST_NUMBER, coefficient
from drape.data.difference import flatten
from drape.data.schema import SPLITS
from drape.errors import DrapeError
from drape.figure.measures import ranges_of
from drape.figure.motions import MOTIONS
from drape.garment.style import KINDS
from drape.geometry.grid import PATTERNS

Bounds = tuple[type, int | float, int | float]
"""Kind of a number, lowest and highest allowed value."""
NUMBERS = {
    "seed": (int, 0, math.inf),
    "fps": (float, 1, math.inf),
    "frames": (int, 3, math.inf),
    "gravity": (float, 0, math.inf),
    "counts.train": (int, 0, math.inf),
    "counts.test": (int, 0, math.inf),
    "reject.attempts": (int, 1, math.inf),
}
"""Numbers of every node ``data``; here and below, units and meaning stand in the page."""
SHEET_NUMBERS = {
    "size": (float, 1e-3, math.inf),
    "resolution": (int, 3, math.inf),
    "start.turning": (float, 0, 179),
    "start.stiff_turning": (float, 0, math.inf),
    "start.curvature": (float, 0, math.inf),
    "start.push": (float, 0, math.inf),
    "reject.strain": (float, 1e-9, math.inf),
    "reject.energy": (float, 1e-9, math.inf),
}
SHEET_PAIRS = {"start.swing": (float, -180, 180), "start.preroll": (int, 0, math.inf)}
"""Pairs [lowest, highest]."""
GARMENT_NUMBERS = {
    "bodies.train": (int, 1, math.inf),
    "bodies.test": (int, 1, math.inf),
    "settle": (int, 2, math.inf),
    "edge.garment": (float, 0.005, 0.1),
    "edge.body": (float, 0.005, 0.06),
    "twin": (float, 0, 1e-3),
    "contact.thickness": (float, 1e-3, 0.05),
    "contact.distance": (float, 1e-3, 0.05),
    "contact.self_distance": (float, 1e-3, 0.05),
    "contact.friction": (float, 0, coefficient(HIGHEST_NUMBER)),
    "contact.damping": (float, 0, 1),
    "contact.quality": (int, 1, 20),
    "solver.steps": (int, 1, 80),
    "solver.repair": (int, 1, 80),
    "reject.inside": (float, 0, 1),
    "reject.self_intersection": (float, 0, 1),
    "reject.stretch": (float, 1, math.inf),
    "reject.speed": (float, 0, math.inf),
}
NOT_IN_REQUEST = ("source", "name", "path")
"""Keys of ``data`` that do not change the data."""
MOTION_FILE = ".bvh"


def has_bodies(data: Mapping) -> bool:
    """Whether a node ``data``, or what a request keeps of it, is of garments on bodies; otherwise of sheets."""
    return data.get("source") == "garments" or "kinds" in data


@dataclass(frozen=True)
class Keys:
    """Content of a node ``data``."""

    page: str
    """Page that explains them."""
    numbers: Mapping[str, Bounds]
    pairs: Mapping[str, Bounds]
    others: Sequence[str]
    """Texts and lists."""

    @classmethod
    def of(cls, data: Mapping) -> Keys:
        """Of garments the pairs are the measures of the bodies, which say themselves whose they are."""
        if not has_bodies(data):
            texts = ("name", "path", "pattern")
            return cls("conf/data/cloth.yaml", NUMBERS | SHEET_NUMBERS, SHEET_PAIRS, texts)
        pairs = {f"shape.{key}": (float, *bounds) for key, bounds in ranges_of(data.get("shape") or {}).items()}
        others = ("source", "name", "path", "kinds", *(f"motions.{split}" for split in SPLITS))
        return cls("conf/data/garments.yaml", NUMBERS | GARMENT_NUMBERS, pairs, others)


def check_data(data: Mapping) -> None:
    """Refuse a ``data`` node with missing or unknown keys, or with values that no data set can have.

    Raises:
        DrapeError: the key, what was found, what is expected.
    """
    flat, keys = flatten(data), Keys.of(data)
    _check_keys(flat, [*keys.numbers, *keys.pairs, *keys.others], keys.page)
    for key, bounds in keys.numbers.items():
        _check_number(key, flat[key], bounds)
    for key, bounds in keys.pairs.items():
        _check_pair(key, flat[key], bounds)
    if flat["counts.train"] + flat["counts.test"] == 0:
        raise DrapeError("data.counts: no sequences at all; expected at least one")
    if has_bodies(data):
        _check_garments(flat)
    elif flat["pattern"] not in PATTERNS:
        raise DrapeError(f"data.pattern: found {flat['pattern']!r}; expected one of {', '.join(PATTERNS)}")


def _check_garments(flat: Mapping[str, Any]) -> None:
    _check_names("kinds", flat["kinds"], KINDS)
    for split in SPLITS:
        _check_names(f"motions.{split}", flat[f"motions.{split}"], MOTIONS, or_ending=MOTION_FILE)
    shared = sorted(set(flat["motions.train"]) & set(flat["motions.test"]))
    if shared:
        raise DrapeError(f"data.motions: found {', '.join(shared)} in train and in test; expected no motion in both")
    if flat["solver.repair"] <= flat["solver.steps"]:
        raise DrapeError(
            f"data.solver.repair: found {flat['solver.repair']}; expected more than data.solver.steps, which is "
            f"{flat['solver.steps']}"
        )


def _check_names(key: str, found: object, known: Sequence[str], or_ending: str | None = None) -> None:
    names = found if isinstance(found, list) else []
    wrong = [n for n in names if n not in known and not (or_ending and str(n).endswith(or_ending))]
    if not names or wrong or len(set(names)) < len(names):
        also = f", or names of {or_ending} files" if or_ending else ""
        raise DrapeError(f"data.{key}: found {found!r}; expected a list of different ones of {', '.join(known)}{also}")


def _check_keys(flat: Mapping[str, object], expected: Sequence[str], page: str) -> None:
    for key in flat:
        if key not in expected:
            close = difflib.get_close_matches(key, expected, n=1)
            raise DrapeError(f"data.{key}: no such key" + (f"; did you mean data.{close[0]}?" if close else ""))
    for key in expected:
        if key not in flat:
            raise DrapeError(f"data.{key}: missing; see {page}")


def _check_pair(key: str, value: object, bounds: Bounds) -> None:
    if not isinstance(value, list) or len(value) != 2:
        raise DrapeError(f"data.{key}: found {value!r}; expected [lowest, highest]")
    for number in value:
        _check_number(key, number, bounds)
    if value[0] > value[1]:
        raise DrapeError(f"data.{key}: found {value}; expected the lower number first")


def _check_number(key: str, value: Any, bounds: Bounds) -> None:
    kind, lowest, highest = bounds
    right = isinstance(value, int if kind is int else (int, float)) and not isinstance(value, bool)
    if not right or not math.isfinite(value) or not lowest <= value <= highest:
        what = "a whole number" if kind is int else "a number"
        span = f"from {lowest} on" if highest == math.inf else f"from {lowest} to {highest}"
        raise DrapeError(f"data.{key}: found {value!r}; expected {what} {span}")


def make_request(data: Mapping, material: Mapping) -> dict:
    """Request of the user, without names of files: two equal requests give equal data with the same Blender.

    Raises:
        DrapeError: see :func:`check_data`; or a fabric without a preset.
    """
    check_data(data)
    _check_material(material)
    request = {"data": {k: v for k, v in data.items() if k not in NOT_IN_REQUEST}, "material": material}
    return json.loads(json.dumps(request))


def _check_material(material: Mapping) -> None:
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
