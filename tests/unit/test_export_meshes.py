"""OBJ sequences and npz: the same vertices in the same order, and no file of an earlier animation among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from drape.blender.output import export
from drape.data.animation_hdf5 import AnimationFile
from drape.data.export_meshes import export_obj
from drape.reading.files import read_file
from drape.reading.triangles import made
from drape.scene.obstacle import Obstacle
from tests.animations import FILES, MESH, header, raised, state, write


def test_obj_keeps_the_order_of_the_vertices(tmp_path: Path) -> None:
    made = header(3)
    folder = tmp_path / "out"
    assert export(write(tmp_path / "a.h5", made), ["obj", "npz"], folder) == [folder / "obj", folder / "a.npz"]
    for frame in range(3):
        for name, x, faces in (
            ("cloth", state(frame).x, MESH.faces),
            ("body", made.obstacle.at(frame), made.obstacle.faces),
        ):
            mesh = trimesh.load(folder / "obj" / f"{name}_{frame:04d}.obj", process=False, maintain_order=True)
            np.testing.assert_allclose(mesh.vertices, x, atol=1e-9)
            np.testing.assert_array_equal(mesh.faces, faces)
    with np.load(folder / "a.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["x"], [state(frame).x for frame in range(3)])
        np.testing.assert_array_equal(arrays["v"], [state(frame).v for frame in range(3)])
        np.testing.assert_array_equal(arrays["mesh.faces"], MESH.faces)
        np.testing.assert_array_equal(arrays["body.positions"], made.obstacle.positions)
        assert arrays["dt"] == 1 / 30
    assert sorted(p.name for p in folder.iterdir()) == ["a.npz", "obj"]


def test_files_of_an_earlier_export_are_removed_and_others_stay(tmp_path: Path) -> None:
    folder = tmp_path / "obj"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    with AnimationFile(write(tmp_path / "long.h5", header(5))) as file:
        export_obj(file, folder)
    still = header(2).obstacle
    made = header(2, obstacle=Obstacle(still.faces, still.positions[:1]))
    with AnimationFile(write(tmp_path / "short.h5", made)) as file:
        export_obj(file, folder)
    assert sorted(p.name for p in folder.iterdir()) == ["body.obj", "cloth_0000.obj", "cloth_0001.obj", "notes.txt"]


@pytest.mark.parametrize(
    ("name", "scale", "up"),
    [
        ("by_hand/panels_y_up.obj", 0.01, "y"),
        ("by_hand/loose.obj", 1.0, "z"),
        ("by_hand/pocket.obj", 1.0, "z"),
        ("by_hand/seam.obj", 0.01, "z"),
        ("blender/skirt.obj", 1.0, "y"),
        ("blender/ngons.ply", 1.0, "z"),
        ("blender/skirt.glb", 1.0, "y"),
    ],
)
def test_obj_has_the_polygons_texture_materials_unit_and_axes_of_the_file(tmp_path: Path, name, scale, up) -> None:
    source = read_file(FILES / name)
    with AnimationFile(raised(made(source, scale, up), tmp_path / "a.h5", first=7)) as file:
        export_obj(file, tmp_path / "obj")
    assert sorted(path.stem for path in (tmp_path / "obj").iterdir()) == [
        "body_0007",
        "body_0008",
        "cloth_0007",
        "cloth_0008",
    ]
    for frame in range(2):
        back = read_file(tmp_path / "obj" / f"cloth_000{7 + frame}.obj")
        assert back.polygons.same_as(source.polygons)
        moved = source.positions[0] + np.eye(3)["xyz".index(up)] * 0.01 * frame / scale
        used = np.isin(np.arange(len(moved)), source.polygons.corners)
        near = 1e-3 if "seam" in name else 2e-9  # the two sides of a seam have become one
        np.testing.assert_allclose(back.positions[0][used], moved[used], atol=near)
        np.testing.assert_array_equal(back.positions[0][~used], source.positions[0][~used])
        assert (back.uv is None) == (source.uv is None)
        if source.uv is not None:
            np.testing.assert_allclose(back.uv, source.uv, atol=1e-7)
        if source.materials:
            found = [back.materials[k] for k in back.material]
            assert found == [source.materials[k] for k in source.material]
