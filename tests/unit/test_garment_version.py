"""Friction is a coefficient everywhere: in files of before, in what is copied from them, in what is made anew."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest
import yaml

from drape.blender import generation
from drape.blender.generation import generate
from drape.config.entry_point import CONF
from drape.data.blender_friction import HIGHEST_NUMBER, blender_number, coefficient
from drape.data.hdf5 import GarmentFile
from drape.data.hdf5_writer import data_writer
from drape.data.recorded_scene import garment_scene
from drape.data.schema import GARMENTS, VERSIONS
from drape.errors import DrapeError
from tests import garments
from tests.unit.test_garment_hdf5 import header
from tests.unit.test_garment_plan import MATERIAL, data_of

CONTACT = {"thickness": 0.004, "friction": 2.0}


def old_file(path: Path, source: str, friction: float) -> Path:
    """A file as version 1 wrote it."""
    garments.write(path, friction=friction)
    with h5py.File(path, "r+") as file:
        config = yaml.safe_dump({"data": {"seed": 3, "contact": CONTACT}, "material": {}})
        file.attrs.update(schema_version=1, source=source, config=config)
    return path


def frictions(file: GarmentFile) -> set[float]:
    return {file.sequence(name).friction for name in file.names}


@pytest.mark.parametrize("number", [0.0, 2.0, 7.0, 29.0, 80.0])
def test_blenders_number_is_a_hundredfold(number):
    assert coefficient(number) == pytest.approx(number / 100)
    assert blender_number(coefficient(number)) == pytest.approx(number, rel=1e-12)
    assert coefficient(number) <= coefficient(HIGHEST_NUMBER) == 0.8


def test_blenders_number_of_a_file_of_before_is_read_as_a_coefficient(tmp_path):
    path = old_file(tmp_path / "old.h5", "blender 5.0.1", 2.0)
    before = path.read_bytes()
    file = GarmentFile(path)
    assert frictions(file) == {0.02}
    assert yaml.safe_load(file.attribute("config"))["data"] == {"seed": 3, "contact": CONTACT | {"friction": 0.02}}
    assert garment_scene(str(path), "00001").friction == 0.02
    assert path.read_bytes() == before


@pytest.mark.parametrize("source", ["cloth3d", "vto"])
def test_a_coefficient_of_a_file_of_before_stays(tmp_path, source):
    assert frictions(GarmentFile(old_file(tmp_path / "old.h5", source, 0.25))) == {0.25}


def test_a_file_of_today_is_read_as_it_is(tmp_path):
    assert frictions(GarmentFile(garments.write(tmp_path / "new.h5", friction=0.5))) == {0.5}


def test_what_is_copied_from_a_file_of_before_is_not_mended_twice(tmp_path):
    old = GarmentFile(old_file(tmp_path / "old.h5", "blender 5.0.1", 2.0))
    target = tmp_path / "new.h5"
    with data_writer(target, header(config=old.attribute("config"))) as writer:
        for name in old.names:
            writer.add(old.part(name))
    new = GarmentFile(target)
    assert new.attribute("schema_version") == VERSIONS[GARMENTS] == 2
    assert frictions(new) == {0.02}
    assert yaml.safe_load(new.attribute("config"))["data"]["contact"]["friction"] == 0.02


def test_a_file_of_before_by_another_maker_is_refused(tmp_path):
    path = old_file(tmp_path / "old.h5", "houdini", 2.0)
    sentence = "source: found 'houdini' in a file of schema version 1; expected one of blender, cloth3d, vto, .* again"
    with pytest.raises(DrapeError, match=sentence) as error:
        GarmentFile(path)
    assert str(error.value).startswith(str(path))


def test_parts_of_before_are_not_mixed_with_new_ones(tmp_path, monkeypatch):
    """Not even where the numbers are equal, as one was Blender's and the other is a coefficient."""
    monkeypatch.setattr(generation, "make_plan", lambda request: {**request, "settings": {}})
    data = data_of(f"data.path={tmp_path}/garments.h5", "data.contact.friction=0.5")
    before = generation.make_request(data, MATERIAL) | {"settings": {}}
    parts = tmp_path / "garments.h5.parts"
    parts.mkdir()
    (parts / "manifest.json").write_text(json.dumps(before), encoding="utf-8")
    with pytest.raises(DrapeError, match=r"schema_version: nothing there, 2 asked for\); delete it, or choose another"):
        generate(data, MATERIAL, 1)
    assert json.loads((parts / "manifest.json").read_text(encoding="utf-8")) == before


def test_parts_of_sheets_of_before_are_not_taken(tmp_path, monkeypatch):
    """They held positions alone."""
    monkeypatch.setattr(generation, "make_plan", lambda request: {**request, "settings": {}})
    page = yaml.safe_load((CONF / "data" / "cloth.yaml").read_text(encoding="utf-8"))
    data = page | {"path": f"{tmp_path}/cloth.h5"}
    parts = tmp_path / "cloth.h5.parts"
    parts.mkdir()
    before = generation.make_request(data, MATERIAL) | {"settings": {}}
    (parts / "manifest.json").write_text(json.dumps(before), encoding="utf-8")
    with pytest.raises(DrapeError, match=r"parts: nothing there, whole asked for\); delete it, or choose another"):
        generate(data, MATERIAL, 1)


def test_a_whole_data_set_of_before_is_not_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(generation, "make_plan", None)
    path = old_file(tmp_path / "garments.h5", "blender 5.0.1", 2.0)
    data = data_of(f"data.path={path}")
    made = generation.make_request(data, MATERIAL)
    made["data"]["contact"]["friction"] = 2.0
    with h5py.File(path, "r+") as file:
        file.attrs["config"] = yaml.safe_dump(made)
    assert generate(data, MATERIAL, 1)[1] is False
    with pytest.raises(DrapeError, match=r"data.contact.friction: 0.02 there, 0.3 asked for"):
        generate(data | {"contact": data["contact"] | {"friction": 0.3}}, MATERIAL, 1)
