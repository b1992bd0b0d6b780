"""Names for files and places in a page."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from drape.metrics.record import EvaluationRecord


def slug(text: str) -> str:
    """Lower-case letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "x"


def fingerprint(value: object, digits: int = 6) -> str:
    """Hexadecimal digits that are the same for the same value, in every process."""
    return hashlib.sha256(repr(value).encode()).hexdigest()[:digits]


def data_name(record: EvaluationRecord) -> str:
    """Name of what was evaluated: the same for the same sequences and frames, another for others."""
    data = record.data
    return f"{slug(Path(str(data['path'])).stem)}-{slug(str(data['split']))}-{fingerprint(sorted(data.items()))}"
