"""The kind of value at each place of a config where no constructor says it: that of the project's own options."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from drape.config.accepts import UNKNOWN, Borrowed
from drape.config.pages import page
from drape.config.ranges import declared

KINDS = {bool: "true or false", int: "a number", float: "a number", list: "a list"}
TEXT, NODE = "a text", "a group of values"
TEXTS = ("${shipped:", "${joined:")
"""Interpolations that give texts."""
FREE = ("workers", "data.pins", "data.fabric", "data.test", "name")
"""Paths of values that may be of a kind that no option happens to be of."""
UNTOLD = ("_target_", "defaults", "hydra")
"""Keys that are not among the values of a command."""


def of_another_kind(tree: Mapping[str, Any], folder: Path, contents: str) -> Iterator[str]:
    """Values of another kind than all options in ``folder`` give them: a word for a number, a number for a list.

    Arguments of objects (``_target_``) are left out: their constructors say what they take. A value that some options
    write as a number and some as a text may be either, and null where one is; one that all leave null is a number where
    a range of numbers is declared for it.
    """
    told = _told(folder, contents)
    for path, value in _leaves(tree):
        values = told.get(path, ())
        kinds = {_kind(each) for each in values}
        kinds |= {KINDS[float]} if kinds == {None} and declared(path) else set()
        if value is UNKNOWN or not kinds - {None} or _kind(value) in kinds or path in FREE:
            continue
        yield f"{path}: found {value!r} ({type(value).__name__}); expected {' or '.join(sorted(filter(None, kinds)))}"
    yield from _other_lists(tree, told)


def _other_lists(tree: Mapping[str, Any], told: Mapping[str, list[Any]]) -> Iterator[str]:
    """Lists that hold no numbers where all options do."""
    for path, value in _leaves(tree):
        lists = [each for each in told.get(path, ()) if isinstance(each, list)]
        if not isinstance(value, list) or not lists or any(_kind(v) != KINDS[int] for each in lists for v in each):
            continue
        if any(_kind(v) != KINDS[int] and v is not UNKNOWN for v in value):
            yield f"{path}: found {value!r}; expected numbers"


def _kind(value: object) -> str | None:
    """A word for the kind; None for null."""
    if value is None:
        return None
    return KINDS.get(type(value), NODE if isinstance(value, Mapping) else TEXT)


def _leaves(tree: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tree.items():
        where = f"{path}.{key}" if path else str(key)
        if isinstance(value, Mapping):
            yield where, value
            if not isinstance(value, Borrowed):
                nodes = {k: node for k, node in value.items() if "_target_" not in value or isinstance(node, Mapping)}
                yield from _leaves(nodes, where)
        elif key not in UNTOLD:
            yield where, value


@functools.cache
def _told(folder: Path, contents: str) -> dict[str, list[Any]]:
    """By dotted path, what the contents page and all options say; interpolations say nothing."""
    told = defaultdict(list)
    for file in (folder / f"{contents}.yaml", *sorted(folder.glob("*/*.yaml"))):
        tree, at_top = page(file).tree, file.parent == folder or page(file).at_top
        for path, value in _leaves(tree if at_top else {file.parent.name: tree}):
            unknown = isinstance(value, str) and (value == "???" or (value.startswith("${") and value.endswith("}")))
            if not unknown or value.startswith(TEXTS):
                told[path].append(value)
    return told
