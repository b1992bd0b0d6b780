"""Sequences of each split of a data set: text files with a name a line, ``all``, or ``none``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from drape.data.schema import SPLITS
from drape.errors import DrapeError


def read_splits(there: Iterable[str], train: str, test: str) -> dict[str, str]:
    """Sequence -> split, sorted by name. ``all``: every sequence of ``there`` that the other split does not name.

    A list may say more behind the name, as CLOTH3D's ``entry_test.txt`` does (name, start, end); that is not read.

    Raises:
        DrapeError: no such list, both splits ``all``, a sequence in both.
    """
    if train == test == "all":
        raise DrapeError("data.train and data.test: found all and all; expected all for one of them at most")
    given = dict(zip(SPLITS, (train, test), strict=True))
    listed = {split: _listed(split, words) for split, words in given.items()}
    both = sorted(set(listed["train"]) & set(listed["test"]))
    if both:
        raise DrapeError(f"data.train and data.test: found {both[0]} in both; expected every sequence in one of them")
    named = {name: split for split, names in listed.items() for name in names}
    for split, words in given.items():
        if words == "all":
            named |= dict.fromkeys(set(there) - named.keys(), split)
    return dict(sorted(named.items()))


def _listed(split: str, given: str) -> list[str]:
    if given in ("all", "none"):
        return []
    path = Path(given)
    if not path.is_file():
        raise DrapeError(
            f"data.{split}: {path}: no such file; expected all, none, or a text file with a sequence a line"
        )
    return [line.split()[0] for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
