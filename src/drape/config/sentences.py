"""Small parts of sentences about mistakes."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """``; did you mean 'x'?``, the known names where none is near, or nothing where they are too many."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=1)
    if close:
        return f"; did you mean {close[0]!r}?"
    return f"; expected one of: {', '.join(known)}" if 0 < len(known) <= 12 else ""


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """An exception and what led to it, each once, also where OmegaConf hides it with ``from None``."""
    seen = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__
