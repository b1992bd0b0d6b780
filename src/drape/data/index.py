"""Index of a data set: contents and offsets, read and checked once, so that frames can be mapped.

``Index.of_groups`` reads a file whose bodies, garments and sequences are groups; sheets and earlier_recordings make the
same index of files that are laid out otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from drape.data.mesh_check import check_masses, check_mesh, check_weights
from drape.data.schema import (
    AGAIN,
    ATTRIBUTES,
    FIELDS,
    GROUP_ATTRIBUTES,
    JSON_ATTRIBUTES,
    MATERIAL_ATTRIBUTES,
    OPTIONAL,
    RECORDED_MATERIAL,
    RECORDINGS,
    SPLITS,
    TEXT_ATTRIBUTES,
    Field,
    plain,
)
from drape.data.schema_check import check_attributes, check_dataset, check_materials
from drape.errors import DrapeError
from drape.stored import attribute


class Layout(NamedTuple):
    """A dataset as it lies in the file: numbers one after the other from byte ``offset`` on."""

    offset: int
    shape: tuple[int, ...]
    dtype: str


@dataclass(frozen=True, eq=False)
class Index:
    """Everything in a file but the arrays, and where these lie."""

    attributes: dict[str, Any] = field(default_factory=dict)
    materials: dict[str, dict] = field(default_factory=dict)
    groups: dict[str, dict[str, dict]] = field(default_factory=lambda: {kind: {} for kind in FIELDS})
    """``groups["sequences"]["00000"]["fabric"]``: the attributes of every group, those in JSON as Python values."""
    layouts: dict[str, Layout] = field(default_factory=dict)
    """By name of the dataset, such as ``sequences/00000/positions``."""
    num_bones: dict[str, int] = field(default_factory=dict)
    """By name of the group, such as ``bodies/00000``: joints that its skinning weights need."""

    @classmethod
    def of_groups(cls, file: h5py.File, path: Path) -> Index:
        """Read and check all attributes, the shape and place of every dataset, and the values of meshes and weights.

        Raises:
            DrapeError: path, name, what was found, what was expected, what to do.
        """
        attributes = check_attributes(file, path, ATTRIBUTES)
        names = RECORDED_MATERIAL if attributes["format"] == RECORDINGS else MATERIAL_ATTRIBUTES
        index = cls(attributes, check_materials(file, path, attributes["fabrics"], names))
        for kind in FIELDS:
            for name in file.get(kind, ()):
                index.add(file, path, kind, name)
        if not index.groups["sequences"]:
            raise DrapeError(f"{path}: sequences: found none; expected at least one; {AGAIN}")
        return index

    def add(self, file: h5py.File, path: Path, kind: str, name: str) -> None:
        """Check one group of a file and take it in; bodies come before garments, and both before sequences.

        Raises:
            DrapeError: as :meth:`of_groups`.
        """
        where = f"{kind}/{name}"
        group = file[where]
        attributes = _group_attributes(group, path, kind)
        self._check_references(attributes, f"{path}: {where}", kind)
        lengths = self._lengths(attributes, kind)
        datasets = dict(group.items())
        for entry in FIELDS[kind]:
            if entry.name in datasets or entry.name not in OPTIONAL[kind]:
                full = replace(entry, name=f"{where}/{entry.name}")
                self.layouts[full.name] = layout_of(datasets.get(entry.name), path, full, lengths)
        self.groups[kind][name] = attributes
        if kind == "sequences":
            self._check_sequence(path, where, attributes)
        else:
            arrays = {name: dataset[:] for name, dataset in datasets.items()}
            check_mesh(arrays, f"{path}: {where}")
            if "mass" in arrays:
                check_masses(arrays["mass"], f"{path}: {where}")
            if "bones" in arrays or "weights" in arrays:
                self.num_bones[where] = check_weights(arrays, f"{path}: {where}")

    def _lengths(self, attributes: Mapping, kind: str) -> dict[str, int]:
        if kind != "sequences":
            return {}
        named = (("body vertices", "bodies", attributes["body"]), ("vertices", "garments", attributes["garment"]))
        return {dim: self.layouts[f"{of}/{name}/rest_positions"].shape[0] for dim, of, name in named if name}

    def _check_references(self, attributes: Mapping, where: str, kind: str) -> None:
        if kind == "bodies":
            return
        known: dict[str, Collection[str]] = {"body": self.groups["bodies"]}
        if kind == "sequences":
            known |= {"garment": self.groups["garments"], "fabric": self.materials, "split": SPLITS}
            if not attributes["body"] and not attributes["garment"]:
                raise DrapeError(f"{where}: found neither a body nor a garment; expected one at least; {AGAIN}")
        for key, names in known.items():
            alone = kind == "sequences" and key in ("garment", "fabric") and attributes["garment"] == ""
            may_be_empty = alone or key == "body"
            if attributes[key] not in names and not (may_be_empty and attributes[key] == ""):
                listed = ", ".join(list(names)[:5]) + (", ..." if len(names) > 5 else "")
                raise DrapeError(
                    f"{where}: attribute {key}: found {attributes[key]!r}; expected one of {listed or 'none'}; {AGAIN}"
                )

    def _check_sequence(self, path: Path, where: str, attributes: Mapping) -> None:
        for key, meaning in (("mass_per_vertex", "kilograms"), ("friction", "a coefficient"), ("attempts", "a count")):
            value = attributes[key]
            least = 0 if key == "friction" or not attributes["garment"] else np.nextafter(0, 1)
            if not (isinstance(value, int | float) and np.isfinite(value) and value >= least):
                what = "from 0 on" if least == 0 else "above 0"
                raise DrapeError(
                    f"{path}: {where}: attribute {key}: found {value!r}; expected {meaning} {what}; {AGAIN}"
                )
        has = {entry.name: f"{where}/{entry.name}" in self.layouts for entry in FIELDS["sequences"]}
        if has["transforms"] + has["body_positions"] != bool(attributes["body"]):
            found = {0: "neither", 1: "one", 2: "both"}[has["transforms"] + has["body_positions"]]
            expected = "one" if attributes["body"] else "neither without a body"
            raise DrapeError(
                f"{path}: {where}: found {found} of transforms and body_positions; expected {expected}; {AGAIN}"
            )
        if has["positions"] and not attributes["garment"]:
            raise DrapeError(f"{path}: {where}: found positions of no garment; expected the attribute garment; {AGAIN}")
        if not has["positions"] and not attributes["body"]:
            raise DrapeError(f"{path}: {where}: found no positions of a sheet; expected its frames; {AGAIN}")
        if has["twin"] and not has["positions"]:
            raise DrapeError(f"{path}: {where}: found a twin alone; expected positions, whose twin it is; {AGAIN}")
        if has["transforms"]:
            joints = self.layouts[f"{where}/transforms"].shape[1]
            self._check_bones(path, where, f"bodies/{attributes['body']}", joints, needed=True)
            self._check_bones(path, where, f"garments/{attributes['garment']}", joints, needed=False)

    def _check_bones(self, path: Path, where: str, carried: str, joints: int, needed: bool) -> None:
        if needed and carried not in self.num_bones:
            raise DrapeError(f"{path}: {where}: transforms need {carried}/bones and weights; found none; {AGAIN}")
        least = self.num_bones.get(carried, 0)
        if least > joints:
            raise DrapeError(
                f"{path}: {where}/transforms: found {joints} joints; expected at least {least}, for {carried}/bones; "
                f"{AGAIN}"
            )


def _group_attributes(group: h5py.Group, path: Path, kind: str) -> dict:
    values = {name: plain(value) for name, value in group.attrs.items()}
    for name, meaning in GROUP_ATTRIBUTES[kind].items():
        if name not in values:
            raise DrapeError(f"{path}: {group.name[1:]}: attribute {name}: missing; expected {meaning}; {AGAIN}")
        if name in TEXT_ATTRIBUTES:
            attribute(path, f"{name} of {group.name[1:]}", values[name], "a text")
        if name in JSON_ATTRIBUTES:
            try:
                values[name] = json.loads(values[name])
            except (TypeError, ValueError):
                raise DrapeError(
                    f"{path}: {group.name[1:]}: attribute {name}: found {values[name]!r}; expected JSON; {AGAIN}"
                ) from None
    return values


def layout_of(dataset: Any, path: Path, entry: Field, lengths: dict[str, int]) -> Layout:
    """Layout of a dataset that is what ``entry`` says; ``lengths`` as in :func:`check_dataset`.

    Raises:
        DrapeError: it is something else, or does not lie in the file as it is.
    """
    check_dataset(dataset, path, entry, lengths)
    offset = 0 if 0 in dataset.shape else dataset.id.get_offset()  # an empty one has no place
    if offset is None:
        raise DrapeError(
            f"{path}: {entry.name}: found chunks or compression; expected numbers that lie in the file as they are, "
            f"since they are mapped; repack them: h5repack -f NONE -l CONTI {path} repacked.h5"
        )
    return Layout(offset, dataset.shape, dataset.dtype.str)
