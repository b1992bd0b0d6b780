"""Names of joints in BVH files, matched with the joints of the figure."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from drape.errors import DrapeError
from drape.figure.skeleton import JOINTS

OPTIONAL = ("spine", "chest", "throat", "skull", "clavicle", "hand")
"""A figure whose file lacks one of these keeps it still."""


def match_names(names: Sequence[str], path: Path, given: Mapping[str, str] | None = None) -> dict[str, int]:
    """Index into ``names`` for each joint of the figure that is there; ``given`` names (figure: file) come first.

    Raises:
        DrapeError: a given joint that the figure or the file does not have, or a needed joint that is not found.
    """
    given = dict(given or {})
    _check_given(names, path, given)
    plain: dict[str, int] = {}
    for index, name in enumerate(names):
        plain.setdefault(_plain(name), index)
    conventions = yaml.safe_load(Path(__file__).with_name("bvh_names.yaml").read_text(encoding="utf-8"))
    tried = [_tried(convention, plain) for convention in conventions.values()]
    found = max(tried, key=len) | {joint: names.index(name) for joint, name in given.items()}
    missing = [joint for joint in JOINTS if joint not in found and not joint.endswith(OPTIONAL)]
    if missing:
        raise DrapeError(
            f"{path}: found no {', '.join(missing)} among the joints {', '.join(names)}; expected names as of Mixamo, "
            "CMU, LAFAN, Biovision or 3ds Max; say which is which: names={'" + missing[0] + "': '...'}"
        )
    return {joint: found[joint] for joint in JOINTS if joint in found}


def _tried(convention: dict[str, list[str]], plain: dict[str, int]) -> dict[str, int]:
    found: dict[str, int] = {}
    for joint in JOINTS:
        side, _, part = joint.partition("_")
        part = part if side in ("left", "right") else joint
        for name in convention[part]:
            index = plain.get(name.format(side=side, s=side[0]))
            if index is not None and index not in found.values():
                found[joint] = index
                break
    return found


def _check_given(names: Sequence[str], path: Path, given: Mapping[str, str]) -> None:
    for joint, name in given.items():
        if joint not in JOINTS:
            near = difflib.get_close_matches(joint, JOINTS, n=1)
            raise DrapeError(
                f"{path}: the figure has no joint {joint!r}; expected one of {', '.join(JOINTS)}"
                + (f"; did you mean {near[0]!r}?" if near else "")
            )
        if name not in names:
            raise DrapeError(f"{path}: has no joint {name!r} for {joint!r}; expected one of {', '.join(names)}")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.rsplit(":", 1)[-1].lower())
