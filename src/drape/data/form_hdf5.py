"""Form of cloth and body in the files they came from, stored with an animation: ``file/cloth``, ``file/body``."""

from __future__ import annotations

from typing import Any

import h5py

from drape.data.schema import plain
from drape.reading.mesh_record import FileForm, Polygons

Forms = tuple[FileForm | None, FileForm | None]
"""Of the cloth and of the body; None for those that came from no file."""
NAMES = ("cloth", "body")
ARRAYS = {
    "vertex": ("1", "the vertex of the animation that each vertex of the file is, -1: none"),
    "placed": ("m", "positions in the file, +z up"),
    "corners": ("1", "vertices of the file at the corners of its polygons"),
    "sizes": ("1", "corners of each polygon"),
    "uv": ("1", "texture coordinates of each corner"),
    "material": ("1", "index into the attribute materials of each polygon, -1: none"),
}


def write_forms(file: h5py.File, forms: Forms) -> None:
    """Store those that there are."""
    for name, form in zip(NAMES, forms, strict=True):
        if form is None:
            continue
        group = file.create_group(f"file/{name}")
        group.attrs.update(scale=form.scale, up=form.up, first=form.first)
        group.attrs.create("materials", list(form.materials), (len(form.materials),), h5py.string_dtype())
        arrays = {"vertex": form.vertex, "placed": form.placed, "uv": form.uv, "material": form.material}
        arrays |= {"corners": form.polygons.corners, "sizes": form.polygons.sizes}
        for key, (unit, meaning) in ARRAYS.items():
            if arrays[key] is not None:
                group.create_dataset(key, data=arrays[key]).attrs.update(units=unit, meaning=meaning)


def read_forms(file: h5py.File) -> Forms:
    """The forms that :func:`write_forms` stored."""
    cloth, body = (_read(file[f"file/{name}"]) if f"file/{name}" in file else None for name in NAMES)
    return cloth, body


def _read(group: h5py.Group) -> FileForm:
    arrays: dict[str, Any] = {key: group[key][:] if key in group else None for key in ARRAYS}
    polygons = Polygons(arrays.pop("corners"), arrays.pop("sizes"))
    values = {key: plain(group.attrs[key]) for key in ("scale", "up", "first")}
    return FileForm(polygons=polygons, materials=tuple(plain(group.attrs["materials"])), **values, **arrays)
