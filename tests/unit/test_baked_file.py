"""Tables on disk: whatever is missing, damaged or edited gets a sentence; no number of them can be changed."""

from __future__ import annotations

import copy
import functools
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drape.energy.law.baked.file import SHAPES, _digest, read_baked, save_baked
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.law.load_law import load_baked
from drape.errors import DrapeError
from drape.scene.material import Material
from tests import terms

DENIM = Material("denim", 40.0, 10.0, 25.0, 0.0, 1.0, 1.0)


@pytest.fixture(scope="module")
def law() -> BakedHinges:
    """A table of silk."""
    return terms.baked()


def test_bad_files_are_named(law, tmp_path):
    """Absent, foreign, of another version, of another fabric: a sentence each."""
    path = tmp_path / "law.npz"
    with pytest.raises(DrapeError, match="no such table"):
        read_baked(path)
    for version in (2, 99):
        np.savez(path, content=np.array(json.dumps({"format": "drape baked law", "version": version})))
        with pytest.raises(DrapeError, match=rf"found format .*{version}.*; expected .*3.*; bake it again"):
            read_baked(path)
    np.savez(path, content=np.array(json.dumps([1, 2])))
    with pytest.raises(DrapeError, match=r"found format \(None, None\); expected"):
        read_baked(path)
    sealed(path, {"content": np.array(json.dumps({"format": "drape baked law", "version": 3}))})
    with pytest.raises(DrapeError, match="damaged: KeyError"):
        read_baked(path)
    save_baked(law, path)
    with pytest.raises(DrapeError, match="found a table of silk; expected one of denim"):
        load_baked(str(path), DENIM)
    with pytest.raises(DrapeError, match=r"bending_stiffness of silk: found a table baked for 0.5, .* has 5"):
        load_baked(str(path), Material("silk", 5.0, 5.0, 0.0, 0.0, 1.0, 0.15))


def test_truncated_and_damaged_files_are_named(law, tmp_path):
    """Cut off anywhere, or with some bytes turned over anywhere in what it stores."""
    path = tmp_path / "law.npz"
    save_baked(law, path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-1], whole[:100], b"", b"text"):
        path.write_bytes(damaged)
        with pytest.raises(DrapeError, match="cannot be read as a table .* bake it again"):
            read_baked(path)
    for place in range(100, len(whole) - 500, len(whole) // 40):
        path.write_bytes(whole[:place] + bytes(255 - byte for byte in whole[place : place + 9]) + whole[place + 9 :])
        with pytest.raises(DrapeError, match="bake it again"):
            read_baked(path)


def stored(law, path: Path) -> tuple[dict[str, np.ndarray], dict]:
    """Arrays of a saved table, and what stands in its text."""
    save_baked(law, path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files if name != "digest"}
    return arrays, json.loads(str(arrays["content"]))


def sealed(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a table of ``arrays`` with the digest of them, as only the program does."""
    np.savez(path, **arrays, digest=np.array(_digest(arrays)))


def changed(value: object) -> object:
    """Another value of the same kind, as near as it gets; a number for none."""
    if value is None:
        return 0.1
    if isinstance(value, str):
        return value[:-1] + chr(ord(value[-1]) ^ 1) if value else "x"
    return value + 1 if isinstance(value, int) else value + 1e-300 if value == 0.0 else value * (1.0 + 1e-15)


def leaves(content: object, way: tuple = ()) -> list[tuple]:
    """The ways to all numbers and words in what JSON gives."""
    if isinstance(content, dict | list):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        return [leaf for key, value in pairs for leaf in leaves(value, (*way, key))]
    return [way]


def test_no_number_can_be_changed(law, tmp_path):
    """One entry of each array, each number and word of the text, by its last digit; then arrays left out or added."""
    path = tmp_path / "law.npz"
    arrays, content = stored(law, path)
    digest = np.load(path)["digest"]
    damaged = [{name: None} for name in arrays]
    damaged += [{"more": np.zeros(3)}, {"digest": np.array("0" * 64)}, {"digest": None}]
    for name in ("table", "samples", "constants"):
        for place in {0, arrays[name].size // 3, arrays[name].size - 1}:
            array = arrays[name].copy()
            array.flat[place] = np.nextafter(array.flat[place], np.inf)
            damaged.append({name: array})
    ways = leaves(content)
    assert {name for name in SHAPES if name not in arrays} < {way[0] for way in ways}
    for *way, last in ways:
        edited = copy.deepcopy(content)
        inner = functools.reduce(lambda part, key: part[key], way, edited)
        inner[last] = changed(inner[last])
        damaged.append({"content": np.array(json.dumps(edited))})
    for change in damaged:
        now = {name: array for name, array in (arrays | {"digest": digest} | change).items() if array is not None}
        np.savez(path, **now)
        with pytest.raises(DrapeError, match="bake it again"):
            read_baked(path)
    np.savez(path, **arrays, digest=digest)
    read_baked(path)


CHANGES = {
    "table": ("energy", lambda law: replaced_plane(law, law.plane.values * 1.01)),
    "the other spline": ("energy", lambda law: replaced_plane(law, law.plane.values[::-1].copy())),
    "samples": ("energy", lambda law: setattr(law, "samples", law.samples._replace(energy=1.01 * law.samples.energy))),
    "forces": ("force", lambda law: setattr(law, "samples", law.samples._replace(slopes=1.02 * law.samples.slopes))),
    "stretch_scale": ("energy", lambda law: setattr(law, "stretch_scale", 0.0101)),
    "angle_scale": ("energy", lambda law: setattr(law, "angle_scale", 0.21)),
    "first": ("energy", lambda law: setattr(law.plane, "first", (0, 0))),
    "step": ("energy", lambda law: setattr(law.plane, "step", (0.25, 0.26))),
    "face_area": ("constants", lambda law: setattr(law, "face_area", 1.000001 * law.face_area)),
    "damper": ("constants", lambda law: setattr(law, "damper", 0.0)),
    "drag": ("constants", lambda law: setattr(law, "drag", 1.000001 * law.drag)),
}


def replaced_plane(law, values: np.ndarray) -> None:
    law.plane = SplinePlane(values, law.plane.first, law.plane.step)


@pytest.mark.parametrize("change", CHANGES)
def test_a_law_that_is_not_its_networks_is_noticed(law, tmp_path, change):
    """Numbers that were changed in memory, and written by the program with the certificate of others."""
    path, other = tmp_path / "law.npz", copy.deepcopy(law)
    quantity, apply = CHANGES[change]
    apply(other)
    save_baked(other, path)
    with pytest.raises(DrapeError, match=f"{quantity}: found a difference of .* from its network; .*most .*: damaged"):
        read_baked(path)


def bumped(law, node: tuple[int, int, int], factor: float) -> None:
    values = law.plane.values.copy()
    values[node] *= factor
    replaced_plane(law, values)


@pytest.mark.parametrize("share", [(0.05, 0.3), (0.3, 0.5), (0.62, 0.3), (0.7, 0.8), (0.95, 0.9)])
@pytest.mark.parametrize("spline", [0, 1])
def test_a_single_node_that_was_changed_is_noticed(law, tmp_path, spline, share):
    """Wherever it is, also where no sample of the network is near, and beyond the range that is sampled."""
    path, other = tmp_path / "law.npz", copy.deepcopy(law)
    bumped(other, (spline, *(int(part * nodes) for part, nodes in zip(share, law.plane.nodes, strict=True))), 2.0)
    save_baked(other, path)
    with pytest.raises(DrapeError, match="energy: found a difference of .* from its network; .*most .*: damaged"):
        read_baked(path)


def test_unevenness_is_that_of_a_polynomial_of_the_fourth_degree(law):
    """K = 1 + a i⁴ has fourth differences 24 a; without hinges its share of φp is 24 a / K."""
    other, (rows, columns) = copy.deepcopy(law), law.plane.nodes
    stiffness = 1.0 + 1e-6 * np.arange(rows)[:, None] ** 4.0 + np.zeros((1, columns))
    replaced_plane(other, np.stack([stiffness, np.zeros_like(stiffness)]))
    counted = np.maximum(stiffness, 0.1 * stiffness.mean())[2:-2]
    away = np.abs(law.plane.first[0] + np.arange(rows))[2:-2] > 0  # at rest nothing is stored
    assert other.unevenness() == pytest.approx((24e-6 / counted[away]).max(), rel=1e-6)


@pytest.mark.parametrize("name", SHAPES)
def test_what_no_law_can_have_is_refused(law, tmp_path, name):
    """Not finite, negative, of another shape, not a number: a sentence with its name, whatever the digest says."""
    path = tmp_path / "law.npz"
    arrays, content = stored(law, path)
    good = np.asarray(arrays[name] if name in arrays else content[name])
    bad = [np.full(good.shape, np.nan), np.full(good.shape, np.inf), good[..., None], np.full(good.shape, "1.0")]
    bad += [] if name in ("samples", "first") else [np.full(good.shape, -1e-9)]
    bad += [np.zeros(good.shape)] if name in ("stretch_scale", "angle_scale", "face_area", "step") else []
    bad += [np.empty((*good.shape[:-1], 0))] if good.ndim else []
    for value in bad:
        edited = {"content": np.array(json.dumps(content | {name: value.tolist()}))}
        sealed(path, arrays | ({name: value} if name in arrays else edited))
        with pytest.raises(DrapeError, match=f"law.npz: {name}: found .*; expected .*; bake it again"):
            read_baked(path)


def test_a_certificate_that_promises_nothing_is_refused(law, tmp_path):
    for bad in (math.nan, math.inf):
        other = copy.deepcopy(law)
        other.certificate = replace(law.certificate, force=bad)
        save_baked(other, tmp_path / "law.npz")
        with pytest.raises(DrapeError, match="force: found a difference of .*; expected at most (nan|inf)"):
            read_baked(tmp_path / "law.npz")
