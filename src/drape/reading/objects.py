"""One object of a file that holds several, as a garment, a body and a floor, chosen by its name or that of a group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drape.errors import DrapeError
from drape.reading.mesh_record import MeshFile, Polygons

Names = tuple[str, ...]
"""Of one object: the groups that it stands in, from the outermost on, and its own name last."""
TOLD = 12
"""Names that a sentence lists at most."""


def chosen(objects: Sequence[Names], wanted: str | None) -> list[int]:
    """The objects of this name, or in the group of this name; all of them where None is wanted.

    Raises:
        DrapeError: a name that none has; the sentence lists those that there are.
    """
    found = [number for number, names in enumerate(objects) if wanted is None or wanted in names]
    if wanted is not None and not found:
        raise DrapeError(f"object: found {wanted!r}; expected one of the file's: {_told(_choices(objects))}")
    return found


def said(objects: Sequence[Names], wanted: str | None) -> list[str]:
    """Remarks on the choice, in a file of several objects."""
    if len(objects) < 2:
        return []
    if wanted is not None:
        return [f"object {wanted!r}"]
    return [f"{len(objects)} objects together, of the names {_told(_choices(objects))}"]


def of_object(source: MeshFile, wanted: str | None) -> MeshFile:
    """The object ``wanted`` of a file that was read as a whole: its polygons, the vertices at them, its materials.

    Raises:
        DrapeError: see :func:`chosen`; the sentence opens with the path.
    """
    source = replace(source, said=(*source.said, *said(source.objects, wanted)))
    if wanted is None:
        return source
    try:
        kept = np.isin(np.asarray(source.object), chosen(source.objects, wanted))
    except DrapeError as error:
        raise DrapeError(f"{source.path}: {error}") from error
    at = np.repeat(kept, source.polygons.sizes)
    used, corners = np.unique(source.polygons.corners[at], return_inverse=True)
    material, materials = source.material, source.materials
    if material is not None:
        numbers, material = np.unique(material[kept], return_inverse=True)
        material = material - (numbers[:1] == -1).sum()
        materials = tuple(materials[number] for number in numbers if number >= 0)
    return replace(
        source,
        polygons=Polygons(corners.reshape(-1), source.polygons.sizes[kept]),
        positions=source.positions[:, used],
        uv=None if source.uv is None or np.isnan(source.uv[at]).all() else source.uv[at],
        materials=materials,
        material=material if materials else None,
        objects=(),
        object=None,
    )


def _choices(objects: Sequence[Names]) -> list[str]:
    """The objects' own names, and the groups that hold some of them but not all."""
    groups = [name for names in objects for name in names[:-1]]
    several = [name for name in groups if not all(name in names for names in objects)]
    return list(dict.fromkeys([*(names[-1] for names in objects if names), *several]))


def _told(names: Sequence[str]) -> str:
    more = [f"and {len(names) - TOLD} more"] if len(names) > TOLD else []
    return ", ".join([*map(repr, names[:TOLD]), *more]) or "it names none"
