"""Files as tools write them (``tests/fixtures``): all formats give the same mesh, and what was changed is counted."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

from drape.data.recorded.rest import RestShapes
from drape.data.recorded.sequence import read_recording
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.reading.files import read_file
from drape.reading.mesh_record import MeshFile, Polygons, ReadMesh
from drape.reading.polygons import clip_ears, triangulated
from drape.reading.triangles import looking_outwards, made
from drape.reading.winding import Sheets, areas
from drape.scene.mesh_file import read_cloth

FILES = Path(__file__).parents[1] / "fixtures"
GARMENTS = ("obj", "ply", "stl", "glb", "gltf")
BY_BLENDER = ("abc", "usdc", "fbx")

needs_blender = [
    pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)"),
    pytest.mark.blender,
]


def skirt() -> np.ndarray:
    """12 around and 4 down, radius 0.2 m at z = 1 m to 0.3 m at z = 0.6 m."""
    share, angle = np.divmod(np.arange(48), 12)
    share, angle = share / 3, 2 * math.pi * angle / 12
    radius = 0.2 + 0.1 * share
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 1 - 0.4 * share], axis=1)


def changed(read: ReadMesh) -> dict[str, int]:
    """What was changed at all, by the first words."""
    return {" ".join(words.split()[:2]): count for words, count in read.changes.items() if count}


def area(points: np.ndarray, faces: np.ndarray) -> float:
    return float(np.linalg.norm(areas(points, faces), axis=1).sum())


def volume(read: ReadMesh) -> float:
    x = read.positions[0][read.faces]
    return float(np.einsum("fi,fi->", x[:, 0], np.cross(x[:, 1], x[:, 2]))) / 6


@pytest.mark.parametrize(
    "name",
    [
        *(f"skirt.{kind}" for kind in GARMENTS),
        *(pytest.param(f"skirt.{kind}", marks=needs_blender) for kind in BY_BLENDER),
        pytest.param("skirt_draco.glb", marks=needs_blender),
        "skirt_mirrored.glb",
        pytest.param("skirt_mirrored.abc", marks=needs_blender),
    ],
)
def test_every_format_of_every_tool_gives_the_same_garment(name):
    """A tube of 48 vertices without seams, wound alike, of the right size and place, whatever the file cut apart."""
    read = made(read_file(FILES / "blender" / name), up_axis="y" if name.endswith("obj") else None)
    mesh = ClothMesh.from_faces(read.positions[0], read.faces)
    assert (mesh.num_vertices, mesh.num_faces, mesh.boundary.sum(), read.parts) == (48, 72, 24, 1)
    expected, found = skirt(), read.positions[0]
    apart = np.linalg.norm(expected[:, None] - found, axis=-1)
    assert apart.min(axis=1).max() < (5e-5 if "draco" in name else 1e-6), "Draco rounds to 14 bits"
    corner = areas(found, read.faces)
    outwards = (corner * found[read.faces].mean(axis=1))[:, :2].sum(axis=1)
    assert (np.sign(outwards) == np.sign(outwards[0])).all()
    assert read.form.in_file(found)[read.form.vertex >= 0] == pytest.approx(read.source.positions[0], abs=1e-6)
    if name.split(".")[1] in ("obj", *BY_BLENDER):
        np.testing.assert_allclose(found, expected * ([-1, 1, 1] if "mirrored" in name else 1), atol=1e-6)
    if name != "skirt.stl":
        assert sorted({round(u, 3) for u in read.source.uv[:, 0]}) == pytest.approx(np.arange(13) / 12, abs=1e-3)
    if name.split(".")[1] not in ("stl", "ply", "abc"):
        assert len(read.source.materials) == 2
        assert np.bincount(read.source.material).tolist() == [len(read.source.polygons.sizes) // 2] * 2


@pytest.mark.parametrize("kind", ["abc", "usdc", "fbx", "glb"])
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
@pytest.mark.blender
def test_animated_polygons_that_bend_are_read_exactly(kind):
    """The caps of a cylinder, of eight corners, are cut once for all frames; rate and first frame are the file's."""
    expected = np.load(FILES / "blender" / "bent_expected.npz")["positions"]
    read = made(read_file(FILES / "blender" / f"bent.{kind}", animated=True))
    assert (read.source.fps, read.source.first, read.positions.shape) == (24, 1, (9, 96, 3))
    same = np.linalg.norm(expected[0][:, None] - read.positions[0], axis=-1).argmin(axis=1)
    np.testing.assert_allclose(read.positions[:, same], expected, atol=1e-6)


@pytest.mark.parametrize("kind", ["glb", "fbx"])
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
@pytest.mark.blender
def test_one_clip_of_several_is_chosen_by_name(kind):
    path = FILES / "blender" / f"clips.{kind}"
    for clip, way in (("walk", [1, 0, 0]), ("jump", [0, 0, 1])):
        read = made(read_file(path, animated=True, clip=clip))
        moved = read.positions[-1].mean(axis=0) - read.positions[0].mean(axis=0)
        np.testing.assert_allclose(moved, way, atol=1e-5)
        assert f"clip '{clip}'" in read.summary("body")
    for clip, sentence in (
        (None, r"found 2 clips \('(walk', 'jump|jump', 'walk)'\); name one of them: scene\.body_clip="),
        ("run", "body_clip: found 'run'; expected one of the file's: '"),
    ):
        with pytest.raises(DrapeError, match=rf"clips\.{kind}: {sentence}"):
            read_file(path, animated=True, clip=clip)


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
@pytest.mark.blender
def test_usd_says_its_unit_its_axis_its_rate_and_its_first_frame():
    """Of 9 points in a plane, 1 m above the ground, that rise by 1 cm a frame."""
    read = made(read_file(FILES / "usd" / "sheet.usda", animated=True))
    assert (read.source.fps, read.source.first, len(read.positions)) == (30, 10, 4)
    np.testing.assert_allclose(read.positions[:, :, 2], 1 + 0.01 * np.arange(4)[:, None].repeat(9, axis=1), atol=1e-6)
    np.testing.assert_allclose(np.ptp(read.positions[0], axis=0), [0.8, 0.6, 0], atol=1e-6)


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
@pytest.mark.blender
def test_alembic_says_neither_unit_nor_axis(tmp_path):
    """Centimetres, as Maya writes them: taken for metres, the sentence says what would fit, of recordings too."""
    path = FILES / "blender" / "outfit_cm.abc"
    source = read_file(path, animated=True, wanted="Body")
    assert (source.unit, source.up) == (None, None)
    np.testing.assert_allclose(np.ptp(source.positions[0], axis=0), [30, 160, 30], atol=1e-3)
    np.testing.assert_allclose(np.ptp(made(source, 0.01).positions[0], axis=0), [0.3, 0.3, 1.6], atol=1e-5)
    np.testing.assert_array_equal(made(source, up_axis="z").source.positions, source.positions)
    assert made(source, up_axis="z").form.up == "z"
    with pytest.raises(DrapeError, match=r"_cm\.abc: found a cloth 60 m long, .*\(scale 0\.01\).*: set scene\.scale"):
        read_cloth(path, wanted="Skirt")
    data = {"fps": None, "scale": None, "up_axis": None, "object": "Body", "rest": "first"}
    with pytest.raises(DrapeError, match=r"0: found a cloth of 166 m; .*\(scale 0\.01\).*: set data\.scale"):
        RestShapes(data).mesh(read_recording(path, data))


# Winding


@pytest.mark.parametrize(
    ("name", "sheets"),
    [
        ("ball_inside_out.stl", [80]),
        ("ball_inside_out.glb", [80]),
        ("ball_mixed.obj", []),
        ("ball_arm.ply", [80]),
        ("ball_open.ply", [58]),
        ("two_parts.glb", []),
    ],
)
def test_bodies_look_outwards_and_what_was_turned_is_told(name, sheets):
    read = looking_outwards(made(read_file(FILES / "trimesh" / name)))
    x = read.positions[0]
    normal = areas(x, read.faces)
    sheet = Sheets.of(read.faces, np.linalg.norm(normal, axis=1)).of_face
    for number in range(sheet.max() + 1):
        middle = x[read.faces[sheet == number]].mean(axis=1)
        out = (normal[sheet == number] * (middle - middle.mean(axis=0))).sum(axis=1)
        assert (out > 0).all()
    assert len(read.shells) == len(sheets)
    for faces, told in zip(sheets, read.shells, strict=True):
        assert f"({faces} faces: they looked inwards)" in told
    assert changed(read).get("faces turned", 0) == (27 if "mixed" in name else 0)


def ball(radius: float, turned: bool) -> tuple[np.ndarray, np.ndarray]:
    source = read_file(FILES / "trimesh" / "ball_inside_out.stl")
    read = made(source)
    return read.positions[0] * radius / 0.3, read.faces if turned else read.faces[:, ::-1]


def test_the_inner_side_of_a_thick_wall_stays_as_it_is():
    (x, outer), (y, inner) = ball(0.3, False), ball(0.2, True)
    faces = np.concatenate([outer, inner + len(x)])
    read = made(MeshFile(Path("vase"), Polygons.of_faces(faces), np.concatenate([x, y])[None]))
    assert looking_outwards(read).shells == ()
    alone = made(MeshFile(Path("ball"), Polygons.of_faces(inner), y[None]))
    assert looking_outwards(alone).shells == ("sheet 1 of 1 was turned over (80 faces: they looked inwards)",)


def test_a_floor_looks_to_where_the_garment_is():
    floor = made(read_file(FILES / "by_hand" / "floor_down.obj"))
    cloth = np.array([[0.0, 0.0, 0.5], [0.1, 0.0, 0.5], [0.0, 0.1, 0.5]])
    for side, up in ((1, 1), (-1, -1)):
        read = looking_outwards(floor, side * cloth)
        assert np.sign(areas(read.positions[0], read.faces)[:, 2]).tolist() == [up] * 2
        assert len(read.shells) == (1 if up > 0 else 0)


def test_a_bowl_looks_to_where_the_garment_is_but_a_body_with_a_hole_does_not():
    """A garment inside a body that is nearly closed is a garment that does not fit, not a body that is a bowl."""
    x, faces = ball(0.3, False)
    bowl = faces[x[faces][:, :, 2].max(axis=1) < 0.01]
    opened = faces[x[faces][:, :, 2].mean(axis=1) < 0.2]
    inside = np.array([[0.0, 0.0, -0.2], [0.05, 0.0, -0.2], [0.0, 0.05, -0.2]])
    for part, turned in ((bowl, 1), (opened, 0)):
        read = looking_outwards(made(MeshFile(Path("b"), Polygons.of_faces(part), x[None])), inside)
        assert len(read.shells) == turned


def test_a_one_sided_sheet_is_refused():
    with pytest.raises(DrapeError, match=r"moebius\.obj: found a sheet of 12 faces that has one side only"):
        made(read_file(FILES / "by_hand" / "moebius.obj"))


# Polygons


def shoelace(points: np.ndarray) -> float:
    x, y = points[:, 0], points[:, 1]
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def test_concave_polygons_have_the_area_that_they_enclose():
    source = read_file(FILES / "by_hand" / "concave.obj")
    corners, polygon = triangulated(source.polygons, source.positions[0])
    faces = source.polygons.corners[corners]
    normal = areas(source.positions[0], faces)[:, 2]
    assert (normal > 1e-3).all(), "no triangle outside of its polygon, none without area"
    assert np.bincount(polygon, normal) == pytest.approx([0.75, 5.0, 4.0])
    assert np.bincount(polygon).tolist() == [2, 6, 4], "no corner is left out, on a straight side neither"


def test_polygons_with_corners_on_their_sides_are_cut_without_flat_triangles():
    rng = np.random.default_rng(0)
    for _ in range(200):
        count = rng.integers(5, 9)
        angle = 2 * math.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
        star = rng.uniform(0.3, 1, (count, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        sides = rng.integers(1, 4, count)
        steps = [np.arange(n)[:, None] / n for n in sides]
        points = np.concatenate([a + t * (b - a) for a, b, t in zip(star, np.roll(star, -1, 0), steps, strict=True)])
        ears = clip_ears(points)
        found = [shoelace(points[ear]) for ear in ears]
        assert len(ears) == len(points) - 2
        assert min(found) > 1e-9
        assert sum(found) == pytest.approx(shoelace(points))


def test_polygons_of_several_sizes_in_a_binary_ply():
    read = made(read_file(FILES / "blender" / "ngons.ply"))
    mesh = ClothMesh.from_faces(read.positions[0], read.faces)
    assert (mesh.num_vertices, mesh.num_faces, mesh.boundary.sum()) == (14, 24, 0)
    assert volume(read) == pytest.approx(3.5 * 0.09 * math.sin(2 * math.pi / 7), rel=1e-5)


# Seams and parts


def test_seams_are_closed_within_a_share_of_an_edge_or_within_what_is_asked():
    source = read_file(FILES / "by_hand" / "seam.obj")
    for weld, merged, vertices in ((None, 2, 9), (0.0, 0, 11), (1e-6, 0, 11), (2e-5, 2, 9)):
        read = made(source, 0.01, weld=weld)
        assert changed(read).get("vertices of", 0) == merged
        assert changed(read)["copies of"] == 1
        assert len(read.positions[0]) == vertices
        assert ClothMesh.from_faces(read.positions[0], read.faces).boundary.sum() == (8 if merged else 12)
    with pytest.raises(DrapeError, match=r"seam\.obj: weld: found -1\.0; expected metres, 0 for exact copies only"):
        made(source, weld=-1.0)


def test_layers_that_are_near_are_no_seam():
    """Only borders are sewn: of two sheets 0.1 mm apart the inner vertices stay apart."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(4) / 3, np.arange(4) / 3))
    sheet = np.stack([x, y, 0 * x], axis=1)
    quads = np.array([[k, k + 1, k + 5, k + 4] for k in range(11) if k % 4 < 3])
    both = np.concatenate([sheet, sheet + [0, 0, 1e-4]])
    read = made(MeshFile(Path("layers"), Polygons.of_faces(np.concatenate([quads, quads + 16])), both[None]))
    assert len(read.positions[0]) == 2 * 16 - 12


def test_a_pocket_is_sewn_on_and_parts_are_kept():
    read = made(read_file(FILES / "by_hand" / "pocket.obj"))
    assert read.parts == 1
    assert changed(read) == {"polygons cut": 11, "edges where": 3}
    mesh = ClothMesh.from_faces(read.positions[0], read.faces)
    assert mesh.num_edges == len(np.unique(mesh.edges, axis=0)) + 3, "an edge of each piece"
    buttons = made(read_file(FILES / "blender" / "buttons.obj"), up_axis="y")
    assert (buttons.parts, len(buttons.positions[0])) == (3, 56)
    assert "3 parts that touch nowhere" in buttons.summary("garment")


def test_what_is_left_out_is_counted():
    read = made(read_file(FILES / "by_hand" / "loose.obj"))
    assert changed(read) == {"loose vertices": 1, "faces without": 1, "copies of": 1}
    assert read.form.vertex.tolist() == [-1, 0, 1, 2, 3]
    raised = read.positions[0] + [0, 0, 1]
    np.testing.assert_array_equal(read.form.in_file(raised)[0], [9, 9, 9])
    np.testing.assert_allclose(read.form.in_file(raised)[1:, 2], 1)


def test_unit_and_axes_go_there_and_back():
    source = read_file(FILES / "by_hand" / "panels_y_up.obj")
    read = made(source, 0.01, "y")
    assert read.positions[0].min(axis=0) == pytest.approx([-0.2, -0.26, 0.8])
    np.testing.assert_allclose(read.form.in_file(read.positions[0]), source.positions[0], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("trimesh/points.ply", "found no triangle; expected a mesh with faces"), ("nobody.obj", "no such file or folder")],
)
def test_files_without_a_mesh_are_refused(name, sentence):
    with pytest.raises(DrapeError, match=f"{name}: {sentence}"):
        made(read_file(FILES / name))


def test_poses_of_smpl_are_not_a_mesh(tmp_path):
    np.savez(tmp_path / "amass.npz", poses=np.zeros((4, 156)), betas=np.zeros(16), trans=np.zeros((4, 3)))
    with pytest.raises(DrapeError, match=r"amass\.npz: found betas, poses, trans: poses of an SMPL body .*smplx"):
        read_file(tmp_path / "amass.npz", animated=True)
