"""Garments from files: what was written comes back in order, and what is wrong is refused with the file's name."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import trimesh

from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.reading.files import read_file
from drape.scene.mesh_file import read_cloth, read_triangles
from drape.scene.proportions import check_garment_and_body, check_upright, perhaps_lying

MESH = square_grid(1.0, 4)
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def stored(folder: Path, kind: str, positions: np.ndarray = MESH.rest_positions) -> Path:
    path = folder / f"shirt.{kind}"
    trimesh.Trimesh(positions, MESH.faces, process=False).export(path)
    return path


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_vertices_keep_their_order(tmp_path, kind):
    order = np.random.default_rng(0).permutation(MESH.num_vertices)
    shuffled = trimesh.Trimesh(MESH.rest_positions[order], np.argsort(order)[MESH.faces], process=False)
    shuffled.export(tmp_path / f"shirt.{kind}")
    mesh, _ = read_cloth(tmp_path / f"shirt.{kind}")
    np.testing.assert_allclose(mesh.rest_positions, MESH.rest_positions[order], atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, np.argsort(order)[MESH.faces])


def test_stl_vertices_are_shared_again(tmp_path):
    mesh, _ = read_cloth(stored(tmp_path, "stl"))
    assert (mesh.num_vertices, mesh.num_edges) == (MESH.num_vertices, MESH.num_edges)
    np.testing.assert_allclose(mesh.rest_positions[mesh.faces], MESH.rest_positions[MESH.faces], atol=1e-7)
    _, first = np.unique(mesh.faces.reshape(-1), return_index=True)
    assert (np.diff(first) > 0).all(), "vertices are numbered as they appear in the file"


def test_glb_is_turned_so_that_z_is_up(tmp_path):
    """glTF has +y up by definition."""
    raised = np.array(MESH.rest_positions) + [0.0, 5.0, 0.5]
    mesh, _ = read_cloth(stored(tmp_path, "glb", raised))
    assert mesh.rest_positions.mean(axis=0) == pytest.approx([0.0, -0.5, 5.0], abs=1e-6)
    assert mesh.num_vertices == MESH.num_vertices


def test_scale_and_axis_are_applied(tmp_path):
    raised = 100 * (np.array(MESH.rest_positions) + [0.0, 1.0, 0.25])
    mesh, _ = read_cloth(stored(tmp_path, "obj", raised), scale=0.01, up_axis="y")
    assert mesh.rest_positions.mean(axis=0) == pytest.approx([0.0, -0.25, 1.0])
    assert mesh.rest_lengths == pytest.approx(MESH.rest_lengths, rel=1e-6)


def test_texture_seams_and_materials_do_not_tear_the_cloth(tmp_path):
    path = tmp_path / "seams.obj"
    path.write_text(
        f"mtllib a.mtl\no left\n{SQUARE}v 2 0 0\nv 2 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt .5 .5\nvn 0 0 1\n"
        "usemtl red\nf 1/1/1 2/2/1 3/3/1 4/4/1\no right\nusemtl blue\nf 2/1/1 5/2/1 \\\n6/3/1 3/4/1  # a quad\n"
    )
    positions, faces = read_triangles(path)
    assert positions.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]]
    assert read_cloth(path)[0].boundary.sum() == 6
    assert len(faces) == 4


def test_triangles_polygons_and_relative_indices_mix(tmp_path):
    path = tmp_path / "mixed.obj"
    path.write_text(f"{SQUARE}v 0.5 2 0\nf 1 2 3 4\nf -2 -3 -1\n")
    positions, faces = read_triangles(path)
    assert len(positions) == 5
    assert [3, 2, 4] in faces.tolist()


def test_texture_coordinates_that_are_not_there_are_none(tmp_path):
    path = tmp_path / "shirt.obj"
    path.write_text(f"{SQUARE}vt 0.25 0.75\nf 1/1 2/9 3 4/1\n")
    uv = read_file(path).uv
    np.testing.assert_array_equal(uv, [[0.25, 0.75], [np.nan] * 2, [np.nan] * 2, [0.25, 0.75]])


def test_a_garment_of_several_parts_is_allowed(tmp_path):
    path = tmp_path / "two.obj"
    path.write_text(f"{SQUARE}v 3 0 0\nv 4 0 0\nv 3 1 0\nf 1 2 3\nf 1 3 4\nf 5 6 7\n")
    mesh, read = read_cloth(path)
    assert (mesh.num_vertices, read.parts) == (7, 2)


BAD = {
    "empty.obj": ("", "found no triangle; expected a mesh with faces; export faces"),
    "points.obj": (SQUARE, "found no triangle"),
    "words.obj": (f"{SQUARE}f a b c\n", "cannot be read as OBJ"),
    "beyond.obj": (f"{SQUARE}f 1 2 9\n", r"faces index 0\.\.8; expected 0\.\.3, as positions has so many"),
    "commas.obj": ("v 0,5 0 0\n", "cannot be read as OBJ .*line 1, 'v 0,5 0 0'"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "frame 0, vertex 0: found .*nan.*; expected finite"),
    "flat.obj": (f"{SQUARE}v 2 0 0\nf 1 2 3\nf 1 3 4\nf 1 5 2\n", "1 faces have no area .* remove them"),
    "text.ply": ("no mesh", "cannot be read as PLY"),
    "text.glb": ("no mesh", "cannot be read as GLB"),
    "text.stl": ("no mesh", "found no triangle|cannot be read as STL"),
    "shirt.txt": ("", r"found a file of kind '.txt'; expected a folder of meshes or one of .obj, .ply, .stl, .glb"),
    "shirt.off": ("OFF\n0 0 0\n", r"found a file of kind '.off'; convert it to PLY or OBJ"),
    "shirt.3mf": ("", r"found a file of kind '.3mf'; it holds parts to print, in millimetres: export it"),
    "walk.bvh": ("", r"found a file of kind '.bvh'; a BVH file holds a skeleton without a skin: skin a mesh"),
    "small.obj": ("v 0 0 0\nv .001 0 0\nv 0 .001 0\nf 1 2 3\n", r"found a cloth of 0\.00141 m; .* set scene\.scale"),
    "large.obj": ("v 0 0 0\nv 170 0 0\nv 0 170 0\nf 1 2 3\n", r"found a cloth of 240 m; .* 1\.7 m in centimetres"),
    "cm.obj": ("v 0 0 0\nv 60 0 0\nv 0 44 0\nf 1 2 3\n", r"found .* 60 m long.* 0\.6 m in centi.* or 1\.5 m in inches"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_with_a_sentence(tmp_path, name):
    content, sentence = BAD[name]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DrapeError, match=f"/{name}: ({sentence})"):
        read_cloth(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DrapeError, match=r"shirt\.obj: no such file or folder; give the path of a mesh"):
        read_cloth(tmp_path / "shirt.obj")


@pytest.mark.parametrize(("arguments", "sentence"), [((0.0,), "scale: found 0.0"), ((1.0, "x"), "up_axis: found 'x'")])
def test_scales_and_axes_that_are_none_are_refused(tmp_path, arguments, sentence):
    with pytest.raises(DrapeError, match=f"shirt.obj: {sentence}; expected"):
        read_cloth(stored(tmp_path, "obj"), *arguments)


BODY = np.array([[-0.3, -0.3, 0.0], [0.3, 0.3, 1.7]])


def test_a_garment_on_its_body_or_near_it_is_fine():
    for offset in ([0.0, 0.0, 1.0], [1.5, 0.0, 0.0], [0.0, 0.0, 3.0]):
        check_garment_and_body(MESH.rest_positions + offset, BODY, "shirt", "body")


@pytest.mark.parametrize(("assumed", "other"), [("z", "y"), ("y", "z")])
def test_who_lies_as_the_wrong_axis_was_assumed_is_told_the_other_one(assumed, other):
    """A quarter turn about x, one way or the other."""
    corners = np.array(list(itertools.product(*BODY.T)))
    shirt = 0.4 * corners + [0.0, 0.0, 0.8]
    x, y, z = np.moveaxis(np.stack([corners, shirt]), -1, 0)
    lying, thrown = np.stack([x, z, -y] if assumed == "z" else [x, -z, y], axis=-1)
    check_upright(corners, "body", assumed)
    check_upright(lying, "body", None)
    with pytest.raises(DrapeError, match=rf"like a person whose up axis is {other}; .*set scene.up_axis={other} "):
        check_upright(lying, "body", assumed)
    check_garment_and_body(shirt, corners, "shirt", "body", (assumed, assumed))
    with pytest.raises(DrapeError, match=f"fit if {other} is up in one of them: set scene.up_axis={other}, or "):
        check_garment_and_body(thrown, corners, "shirt", "body", (assumed, None))
    (told,) = perhaps_lying(thrown, assumed)
    assert f"set scene.up_axis={other}" in told
    assert perhaps_lying(shirt, assumed) == perhaps_lying(thrown, None) == []


@pytest.mark.parametrize(
    ("scale", "offset", "sentence"),
    [
        (100.0, 0.0, r"found sizes of 141 m and 1\.9 m; expected them within a factor of 10; .* set scene\.scale"),
        (0.01, 0.0, r"found sizes of 0\.0141 m and 1\.9 m; expected them within a factor of 10"),
        (1.0, 4.0, r"found the cloth 4\.53 m away from a body of 1\.9 m; expected it on the body or near it"),
    ],
)
def test_garment_and_body_in_other_units_or_places_are_refused(scale, offset, sentence):
    """4 m to each of two sides: 4 - 0.5 - 0.3 m apart along both."""
    with pytest.raises(DrapeError, match=f"^shirt and body: {sentence}"):
        check_garment_and_body(scale * MESH.rest_positions + [offset, offset, 0.0], BODY, "shirt", "body")
