"""Names of the rows of tables, from the files that define them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def label(config: Mapping[str, Any]) -> str:
    """``MGN-S+EUNet w/o bending``: the label of a training's row, and that of each of its ablations, by their names.

    ``conf/model/<row>.yaml`` gives the one, ``conf/ablation/<name>.yaml`` the others; empty where the row has none.
    """
    taken = config.get("ablation") or {}
    return " ".join([config["label"], *(taken[name] for name in sorted(taken))]) if config.get("label") else ""
