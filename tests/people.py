"""A person of anny for tests, made once; tests that ask for it are skipped where anny is missing."""

from __future__ import annotations

import importlib.util
from functools import cache

import pytest

from drape.figure.anny_figure import make_person
from drape.figure.anny_model import AnnyBody, anny_body
from drape.figure.figure import Figure
from drape.figure.phenotype import Phenotype

needs_anny = pytest.mark.skipif(importlib.util.find_spec("anny") is None, reason='needs anny: pip install ".[people]"')
USUAL = Phenotype(gender=1.0)


@cache
def usual_body() -> AnnyBody:
    """A woman of usual build, as anny makes her."""
    return anny_body(USUAL)


@cache
def usual_person() -> Figure:
    """The same with coarse edges of 3 cm."""
    return make_person(USUAL, usual_body(), edge=0.03)
