"""Objects of a config that stands in a file: plain values and targets of this project, or a sentence, and no code."""

from __future__ import annotations

import functools
import re
from collections.abc import Collection, Iterator
from typing import Any, cast

from omegaconf import OmegaConf

from drape.config.check import mistakes
from drape.config.entry_point import instantiate
from drape.config.resolvers import CONF
from drape.errors import DrapeError

TARGET = re.compile(r"""^[^#\n]*_target_: *["']?([\w.]+)""", re.MULTILINE)
DEEPEST, LARGEST = 20, 10_000
"""Levels and values that a config may have: YAML can say more than fits into any memory in a few lines."""
PLAIN = (str, bool, int, float, type(None))
INSTRUCTIONS = ("_target_", "_partial_")
"""Instructions to Hydra in a stored config; no ``_args_``, and nothing that changes how the others are read."""


@functools.cache
def targets(group: str) -> frozenset[str]:
    """Every ``_target_`` that an option of ``conf/<group>/`` names."""
    files = sorted((CONF / group).rglob("*.yaml"))
    return frozenset(name for file in files for name in TARGET.findall(file.read_text(encoding="utf-8")))


def build_from_file(tree: object, groups: Collection[str], where: str) -> Any:
    """Build the object of a config that was read from a file.

    Everything is checked before anything is imported or called: plain containers and values only, no interpolation
    (a resolver is a function), no instruction of Hydra's but ``_target_`` and ``_partial_``, and as ``_target_`` only
    what this project's own options of ``groups`` name. Then arguments are checked as those of a command are.

    Args:
        tree: plain dictionaries and lists, as read.
        groups: config groups that the object may come from, such as ``("model",)``.
        where: file and node, for the sentence.

    Raises:
        DrapeError: the config does or says anything else.
    """
    allowed = frozenset().union(*map(targets, groups))
    problem = next(_foreign(tree, where, allowed, groups), None)
    if problem is None and not (isinstance(tree, dict) and "_target_" in tree):
        problem = f"{where}: found no _target_; expected an object"
    problem = problem or next(mistakes(tree, where), None)
    if problem:
        raise DrapeError(
            f"{problem}; the file was written by another version of the program, or not by it: make it again"
        )
    return instantiate(OmegaConf.create(cast(dict, tree)))


def _foreign(tree: object, path: str, allowed: Collection[str], groups: Collection[str]) -> Iterator[str]:
    """Sentences on the entries of ``tree`` that no run of this program stores."""
    seen, nodes = 0, [(tree, path, 0)]
    while nodes:
        node, place, depth = nodes.pop()
        seen += 1
        if depth > DEEPEST or seen > LARGEST:
            yield f"{path}: found more than {DEEPEST} levels or {LARGEST} values; expected the config of a run"
            return
        if isinstance(node, dict):
            yield from _foreign_instructions(node, place, allowed, groups)
            nodes += [(value, f"{place}.{key}", depth + 1) for key, value in node.items()]
        elif isinstance(node, list | tuple):
            nodes += [(value, f"{place}.{key}", depth + 1) for key, value in enumerate(node)]
        elif type(node) not in PLAIN:
            yield f"{place}: found a {type(node).__name__}; expected plain values"
        elif isinstance(node, str) and ("${" in node or node == "???"):
            yield f"{place}: found {node[:60]!r}; expected plain values, without interpolation"


def _foreign_instructions(node: dict, place: str, allowed: Collection[str], groups: Collection[str]) -> Iterator[str]:
    for key, value in node.items():
        if not isinstance(key, str) or "${" in key:
            yield f"{place}: found the name {str(key)[:60]!r}; expected a plain one"
        elif key.startswith("_") and key not in INSTRUCTIONS:
            yield f"{place}.{key}: found an instruction; expected only {' and '.join(INSTRUCTIONS)}"
        elif key == "_partial_" and not isinstance(value, bool):
            yield f"{place}.{key}: found {str(value)[:60]!r}; expected true or false"
        elif key == "_target_" and not (isinstance(value, str) and value in allowed):
            folders = ", ".join(f"conf/{group}/" for group in groups)
            yield f"{place}._target_: found {str(value)[:60]!r}; expected one that an option of {folders} names"
