"""The body that the measures of a configuration describe."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from drape.errors import DrapeError
from drape.figure import phenotype, shape
from drape.figure.phenotype import Phenotype
from drape.figure.shape import FigureShape


def is_person(measures: Iterable[str]) -> bool:
    """Whether measures of these names are those of a person of anny: the project's own figures have no gender."""
    return "gender" in measures


def ranges_of(measures: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each measure of the body that has measures of these names."""
    return phenotype.RANGES if is_person(measures) else shape.RANGES


def shape_of(measures: Mapping[str, float], where: str) -> FigureShape | Phenotype:
    """The measures of a body, read from the configuration at ``where``.

    Raises:
        DrapeError: a name that is no measure of this body, a value out of range.
    """
    known = ranges_of(measures)
    for measure in measures:
        if measure not in known:
            raise DrapeError(
                f"{where}: found {measure!r}; expected measures out of {', '.join(known)}; correct the name"
            )
    return Phenotype(**measures) if is_person(measures) else FigureShape(**measures)
