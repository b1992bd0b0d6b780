"""The settings that determine a data set of garments: nodes ``data`` and ``material``, checked; no bpy."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence

from drape.blender.plan import check_keys, check_material, check_number, check_pair
from drape.data.blender_friction import HIGHEST_NUMBER, coefficient
from drape.data.difference import flatten
from drape.data.schema import SPLITS
from drape.errors import DrapeError
from drape.figure.measures import ranges_of
from drape.figure.motions import MOTIONS
from drape.garment.style import KINDS

NUMBERS = {
    "seed": (int, 0, math.inf),
    "fps": (float, 1, math.inf),
    "gravity": (float, 0, math.inf),
    "counts.train": (int, 0, math.inf),
    "counts.test": (int, 0, math.inf),
    "bodies.train": (int, 1, math.inf),
    "bodies.test": (int, 1, math.inf),
    "frames": (int, 3, math.inf),
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
    "reject.attempts": (int, 1, math.inf),
}
"""Every number of ``data``: kind, lowest and highest value; units and meaning stand in ``conf/data/garments.yaml``."""
TEXTS = ("source", "name", "path")
LISTS = ("kinds", "motions.train", "motions.test")
NOT_IN_REQUEST = ("source", "name", "path")
"""Keys of ``data`` that do not change the data."""
PAGE = "conf/data/garments.yaml"
MOTION_FILE = ".bvh"


def check_garments(data: Mapping) -> None:
    """Refuse a ``data`` node with missing or unknown keys, or with values that no data set of garments can have.

    Raises:
        DrapeError: the key, what was found, what is expected.
    """
    flat = flatten(data)
    ranges = ranges_of(data.get("shape") or {})
    pairs = {f"shape.{measure}": (float, *bounds) for measure, bounds in ranges.items()}
    check_keys(flat, [*NUMBERS, *pairs, *TEXTS, *LISTS], PAGE)
    for key, bounds in NUMBERS.items():
        check_number(key, flat[key], bounds)
    for key, bounds in pairs.items():
        check_pair(key, flat[key], bounds)
    _check_names("kinds", flat["kinds"], KINDS)
    for split in SPLITS:
        _check_names(f"motions.{split}", flat[f"motions.{split}"], MOTIONS, or_ending=MOTION_FILE)
    shared = sorted(set(flat["motions.train"]) & set(flat["motions.test"]))
    if shared:
        raise DrapeError(f"data.motions: found {', '.join(shared)} in train and in test; expected no motion in both")
    if flat["counts.train"] + flat["counts.test"] == 0:
        raise DrapeError("data.counts: no sequences at all; expected at least one")
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


def make_garment_request(data: Mapping, material: Mapping) -> dict:
    """Request of the user, without names of files: two equal requests give equal data with the same Blender.

    Raises:
        DrapeError: see :func:`check_garments`; or a fabric without a preset.
    """
    check_garments(data)
    check_material(material)
    request = {"data": {k: v for k, v in data.items() if k not in NOT_IN_REQUEST}, "material": material}
    return json.loads(json.dumps(request))
