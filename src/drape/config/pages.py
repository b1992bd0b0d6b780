"""Pages of ``conf/``, each parsed once: every check of a config asks for all of them."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, NamedTuple

import yaml

GLOBAL = "# @package _global_"
"""First line of an option that stands at the top itself."""
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The compiled one, ten times as fast, where PyYAML has it."""


class Page(NamedTuple):
    """A contents page or an option of a group."""

    tree: dict[str, Any]
    """Not to be changed."""
    at_top: bool
    """Whether its values stand at the top, not in the node of its group."""


@functools.cache
def page(file: Path) -> Page:
    """The page of a file."""
    text = file.read_text(encoding="utf-8")
    return Page(yaml.load(text, LOADER) or {}, text.startswith(GLOBAL))
