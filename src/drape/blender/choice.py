"""Split, kind of cloth, fabric, motion and body of each sequence, in equal parts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from drape.blender.plan import has_bodies
from drape.data.schema import SPLITS
from drape.data.sheets import SHEET


@dataclass(frozen=True)
class Choice:
    """Content of a sequence, before anything is drawn at random."""

    split: str
    kind: str
    fabric: str
    motion: str = ""
    body: int | None = None
    """Bodies are counted through both splits: those of training first, none in both. None: a sheet."""


def choose(index: int, plan: Mapping) -> Choice:
    """The choice for sequence ``index`` of a plan: the training split first, then the test split.

    Sheets: fabric i mod n. Garments, each split counted from 0: as many sequences as there are pairs of kind and fabric
    show each pair once (24 of six kinds and four fabrics), and the motions and bodies go round so that each meets every
    kind and every fabric.
    """
    data, fabrics = plan["data"], list(plan["material"])
    split = SPLITS[int(index >= data["counts"]["train"])]
    if not has_bodies(data):
        return Choice(split, SHEET, fabrics[index % len(fabrics)])
    number = index - (data["counts"]["train"] if split == "test" else 0)
    kinds, motions = data["kinds"], data["motions"][split]
    turn = number // math.lcm(len(kinds), len(fabrics))  # after which the pairs (i mod m, i mod n) would come again
    bodies, round_ = data["bodies"], number // len(kinds)
    block = number // (len(kinds) * len(fabrics))
    body = (number + round_) % bodies[split]
    return Choice(
        split=split,
        kind=kinds[number % len(kinds)],
        fabric=fabrics[(number + turn) % len(fabrics)],
        motion=motions[(2 * number + round_ + block) % len(motions)],
        body=body + (bodies["train"] if split == "test" else 0),
    )
