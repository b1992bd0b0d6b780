"""Index of a data set of garments: contents and offsets, read and checked once, so that frames can be mapped."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from drape.data.garment_mesh_check import check_mesh, check_weights
from drape.data.garment_schema import (
    ATTRIBUTES,
    FIELDS,
    FORMAT,
    GROUP_ATTRIBUTES,
    JSON_ATTRIBUTES,
    OPTIONAL,
    SPLITS,
)
from drape.data.garment_version import READABLE, mend
from drape.data.schema import (
    MATERIAL_ATTRIBUTES,
    Field,
    check_dataset,
    check_gravity_and_rate,
    check_material,
    plain,
)
from drape.errors import DrapeError
from drape.stored import attribute

AGAIN = "make the file again"

TEXTS = ("kind", "body", "garment", "fabric", "motion", "split")
"""Attributes of groups."""


class Layout(NamedTuple):
    """A dataset as it lies in the file: numbers one after the other from byte ``offset`` on."""

    offset: int
    shape: tuple[int, ...]
    dtype: str


@dataclass(frozen=True, eq=False)
class GarmentIndex:
    """Everything in a file but the arrays, and where these lie."""

    attributes: dict[str, object] = field(default_factory=dict)
    materials: dict[str, dict] = field(default_factory=dict)
    groups: dict[str, dict[str, dict]] = field(default_factory=lambda: {kind: {} for kind in FIELDS})
    """``groups["sequences"]["00000"]["fabric"]``: the attributes of every group, those in JSON as Python values."""
    layouts: dict[str, Layout] = field(default_factory=dict)
    """By name of the dataset, such as ``sequences/00000/positions``."""
    num_bones: dict[str, int] = field(default_factory=dict)
    """By name of the group, such as ``bodies/00000``: joints that its skinning weights need."""

    @classmethod
    def of_file(cls, file: h5py.File, path: Path) -> GarmentIndex:
        """Read and check all attributes, the shape and place of every dataset, and the values of meshes and weights.

        Raises:
            DrapeError: path, name, what was found, what was expected, what to do.
        """
        index = cls()
        index.attributes.update(_attributes(file, path))
        for fabric in index.attributes["fabrics"]:
            index.materials[fabric] = _material(file, path, fabric)
        for kind in FIELDS:
            for name in file.get(kind, ()):
                index.add(file, path, kind, name)
        if not index.groups["sequences"]:
            raise DrapeError(f"{path}: sequences: found none; expected at least one; {AGAIN}")
        mend(index.attributes, index.groups["sequences"], path)
        return index

    def add(self, file: h5py.File, path: Path, kind: str, name: str) -> None:
        """Check one group of a file and take it in; bodies come before garments, and both before sequences.

        Raises:
            DrapeError: as :meth:`of_file`.
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
                self.layouts[full.name] = _layout(datasets.get(entry.name), path, full, lengths)
        self.groups[kind][name] = attributes
        if kind == "sequences":
            self._check_sequence(path, where, attributes)
        else:
            arrays = {name: dataset[:] for name, dataset in datasets.items()}
            check_mesh(arrays, f"{path}: {where}")
            if "bones" in arrays or "weights" in arrays:
                self.num_bones[where] = check_weights(arrays, f"{path}: {where}")

    def _lengths(self, attributes: Mapping, kind: str) -> dict[str, int]:
        if kind != "sequences":
            return {}
        lengths = {"body vertices": self.layouts[f"bodies/{attributes['body']}/rest_positions"].shape[0]}
        if attributes["garment"]:
            lengths["vertices"] = self.layouts[f"garments/{attributes['garment']}/rest_positions"].shape[0]
        return lengths

    def _check_references(self, attributes: Mapping, where: str, kind: str) -> None:
        if kind == "bodies":
            return
        known = {"body": self.groups["bodies"]}
        if kind == "sequences":
            known |= {"garment": self.groups["garments"], "fabric": self.materials, "split": SPLITS}
        for key, names in known.items():
            alone = kind == "sequences" and key in ("garment", "fabric") and attributes["garment"] == ""
            if attributes[key] not in names and not (alone and attributes[key] == ""):
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
        if has["transforms"] == has["body_positions"]:
            found = "both" if has["transforms"] else "neither"
            raise DrapeError(f"{path}: {where}: found {found} of transforms and body_positions; expected one; {AGAIN}")
        if has["positions"] and not attributes["garment"]:
            raise DrapeError(f"{path}: {where}: found positions of no garment; expected the attribute garment; {AGAIN}")
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


def _attributes(file: h5py.File, path: Path) -> dict[str, object]:
    for name, expected in (("format", (FORMAT,)), ("schema_version", READABLE)):
        found = plain(file.attrs.get(name, "nothing"))
        if found not in expected:
            raise DrapeError(
                f"{path}: attribute {name}: found {found!r}; expected {' or '.join(map(repr, expected))}; this is no "
                "data set of garments of this version, make one with: python src/generate.py data=garments"
            )
    for name, meaning in ATTRIBUTES.items():
        if name not in file.attrs:
            raise DrapeError(f"{path}: attribute {name}: missing; expected {meaning}; {AGAIN}")
    values = {name: plain(value) for name, value in file.attrs.items()}
    check_gravity_and_rate(file, path)
    return values


def _material(file: h5py.File, path: Path, fabric: str) -> dict:
    group = file.get(f"materials/{fabric}")
    missing = [name for name in MATERIAL_ATTRIBUTES if group is None or name not in group.attrs]
    if missing:
        raise DrapeError(f"{path}: materials/{fabric}: missing {', '.join(missing)}; {AGAIN}")
    check_material(group.attrs, path, fabric, MATERIAL_ATTRIBUTES)
    return {name: plain(value) for name, value in group.attrs.items()}


def _group_attributes(group: h5py.Group, path: Path, kind: str) -> dict:
    values = {name: plain(value) for name, value in group.attrs.items()}
    for name, meaning in GROUP_ATTRIBUTES[kind].items():
        if name not in values:
            raise DrapeError(f"{path}: {group.name[1:]}: attribute {name}: missing; expected {meaning}; {AGAIN}")
        if name in TEXTS:
            attribute(path, f"{name} of {group.name[1:]}", values[name], "a text")
        if name in JSON_ATTRIBUTES:
            try:
                values[name] = json.loads(values[name])
            except (TypeError, ValueError):
                raise DrapeError(
                    f"{path}: {group.name[1:]}: attribute {name}: found {values[name]!r}; expected JSON; {AGAIN}"
                ) from None
    return values


def _layout(dataset: object, path: Path, entry: Field, lengths: dict[str, int]) -> Layout:
    if isinstance(dataset, h5py.Dataset) and dataset.shape == (0,) and entry.dims == ("pinned",):
        return Layout(0, dataset.shape, dataset.dtype.str)
    check_dataset(dataset, path, entry, lengths)
    offset = dataset.id.get_offset()
    if offset is None:
        raise DrapeError(
            f"{path}: {entry.name}: found chunks or compression; expected numbers that lie in the file as they are, "
            f"since they are mapped; repack them: h5repack -f NONE -l CONTI {path} repacked.h5"
        )
    return Layout(offset, dataset.shape, dataset.dtype.str)
