"""One object out of a file of several: the same in all formats that tools write; wrong names say which there are."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import drape
from drape.errors import DrapeError
from drape.reading.files import read_file
from drape.reading.objects import TOLD, chosen
from drape.reading.triangles import made
from drape.scene.scene import Scene
from tests.unit.test_reading import FILES, needs_blender, skirt

OUTFIT = FILES / "blender" / "outfit.obj"
"""A skirt, a floor, and a body below a group Person that rises; beside it the same in other formats."""
BY_BLENDER = [pytest.param(kind, True, marks=needs_blender) for kind in ("abc", "usdc", "fbx", "glb")]


@pytest.mark.parametrize(("kind", "animated"), [("obj", False), ("glb", False), *BY_BLENDER])
def test_one_object_of_every_format_is_chosen_by_its_name(kind, animated):
    path = OUTFIT.with_suffix(f".{kind}")
    read = made(read_file(path, animated=animated, wanted="Skirt"), up_axis="y" if kind == "obj" else None)
    assert (read.parts, read.positions.shape, len(read.faces)) == (1, (1, 48, 3), 72)
    assert "object 'Skirt'" in read.summary("garment")
    apart = np.linalg.norm(skirt()[:, None] - read.positions[0], axis=-1)
    assert apart.min(axis=1).max() < 1e-6
    if kind in ("glb", "fbx"):
        assert sorted(read.source.materials) == ["cloth 0", "cloth 1"]
    if animated:  # in another process
        rising = made(read_file(path, animated=True, wanted="Person")).positions[:, :, 2].mean(axis=1)
        np.testing.assert_allclose(rising, [0.85, 0.86, 0.87], atol=1e-5)


def test_all_objects_are_read_where_none_is_named_and_the_summary_says_so():
    whole = made(read_file(OUTFIT))
    assert (whole.parts, len(whole.faces)) == (3, 72 + 2 + 28)
    assert "3 objects together, of the names 'Skirt', 'Floor', 'Body'" in whole.summary("garment")
    assert "object" not in made(read_file(FILES / "blender" / "skirt.obj")).summary("garment"), "there is one only"


@pytest.mark.parametrize(
    ("file", "wanted", "sentence"),
    [
        ("blender/outfit.obj", "skirt", "found 'skirt'; expected one of the file's: 'Skirt', 'Floor', 'Body'$"),
        ("blender/outfit.glb", "", "found ''; expected one of the file's: 'Body', 'Floor', 'Skirt', 'Person'$"),
        ("by_hand/groups.obj", "default", "expected one of the file's: 'Shirt', 'Belt', 'Floor', 'Outfit'$"),
        ("blender/skirt.ply", "Skirt", "found 'Skirt'; expected one of the file's: it names none$"),
        pytest.param("usd/groups.usda", "Hat", "('mesh', 'hair'|'hair', 'mesh'), '.*', '.*'$", marks=needs_blender),
    ],
)
def test_a_name_that_is_not_there_is_refused_with_those_that_are(file, wanted, sentence):
    with pytest.raises(DrapeError, match=rf"^{re.escape(str(FILES / file))}: object: .*{sentence}"):
        read_file(FILES / file, wanted=wanted)


def test_a_group_stands_for_all_objects_in_it():
    """Maya's OBJ: a shirt of one face, a belt of two, in a group; only their vertices are left, in their order."""
    read = made(read_file(FILES / "by_hand" / "groups.obj", wanted="Outfit"), weld=0.0)
    assert (len(read.faces), read.positions.shape[1], read.parts) == (3, 7, 2)
    assert read.source.positions[0, :, 2].tolist() == [0, 0, 0, 1, 1, 1, 1]
    belt = read_file(FILES / "by_hand" / "groups.obj", wanted="Belt")
    assert belt.polygons.corners.tolist() == [0, 1, 2, 1, 3, 2]


@pytest.mark.parametrize(("name", "x"), [("Shirt", [0.0]), ("Person", [1.0, 2.0]), ("mesh", [0.0, 1.0])])
@pytest.mark.skipif(needs_blender[0].args[0], reason="needs bpy (Python 3.11)")
@pytest.mark.blender
def test_meshes_of_one_name_in_several_groups_of_usd_are_told_apart(name, x):
    """Blender numbers them, or forgets the group of a lone mesh."""
    read = made(read_file(FILES / "usd" / "groups.usda", wanted=name), weld=0.0)
    assert sorted({float(places[0]) for places in read.positions[0][read.faces].min(axis=1)}) == x


def test_long_lists_of_names_are_cut_short():
    with pytest.raises(DrapeError, match=r"'part 11', and 28 more$"):
        chosen([(f"part {number}",) for number in range(40)], "sleeve")
    assert TOLD == 12


def test_a_folder_of_meshes_gives_the_same_object_in_all_frames(tmp_path: Path):
    for frame in (1, 2):
        (tmp_path / f"walk_{frame}.obj").write_text(OUTFIT.read_text())
    assert read_file(tmp_path, animated=True, wanted="Body").positions.shape == (2, 16, 3)


def scene(*overrides: str) -> Scene:
    mass = "scene.mass={per_vertex: 0.1, areal_density: null}"
    files = (f"scene.mesh={OUTFIT}", f"scene.body={OUTFIT}", "scene.up_axis=y")
    return drape.instantiate(drape.compose("animate", "scene=custom", "fabric=silk", mass, *files, *overrides).scene)


def test_garment_and_body_may_be_two_objects_of_one_file(tmp_path: Path):
    """And the start a third: the same skirt elsewhere."""
    made = scene("scene.mesh_object=Skirt", "scene.body_object=Body", "scene.pins=[0]")
    assert (made.mesh.num_vertices, made.obstacle.faces.max() + 1, made.pins.vertices.tolist()) == (48, 16, [0])
    posed = tmp_path / "start.obj"
    posed.write_text(OUTFIT.read_text().replace("o Skirt", "o Posed"))
    with pytest.raises(DrapeError, match=r"start\.obj: object: found 'Skirt'; expected .*'Posed'"):
        scene("scene.mesh_object=Skirt", "scene.body_object=Body", f"scene.start={posed}")
    scene("scene.mesh_object=Skirt", "scene.body_object=Body", f"scene.start={posed}", "scene.start_object=Posed")


def test_one_mesh_for_garment_and_body_is_refused():
    with pytest.raises(DrapeError, match=r"scene\.mesh and scene\.body: found .*outfit\.obj for both; .*mesh_object"):
        scene()
