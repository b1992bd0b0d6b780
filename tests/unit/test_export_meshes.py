"""OBJ sequences and npz: the same vertices in the same order, and no file of an earlier animation among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from drape.blender.output import export
from drape.data.animation_hdf5 import AnimationFile
from drape.data.export_meshes import export_obj
from drape.scene.obstacle import Obstacle
from tests.animations import MESH, header, state, write


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
