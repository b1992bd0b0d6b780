"""What bad input gets: one sentence with the place and the remedy, exit status 2, before the first step, no file."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from drape.config.resolvers import SHIPPED
from tests.integration.test_animate_cli import BALL, BODY, FACES, HANGING, MASS, WALK, X, written


def refused(animate: Callable, folder: Path, *overrides: str) -> str:
    """The sentence of a command that must fail before anything is simulated or written."""
    before = sorted(folder.rglob("*"))
    done = animate("scene.frames=2", "output.render=none", *overrides)
    assert done.code == 2, done.err
    assert done.err.startswith("error: "), done.err
    assert "Traceback" not in done.err
    assert "animating" not in done.err
    left = [path for path in folder.rglob("*") if path.is_file() and path not in before]
    assert [path for path in left if ".hydra" not in path.parts] == []
    return done.err


def assert_says(said: str, sentence: str) -> None:
    assert re.search(sentence, said), f"{said!r} does not say {sentence!r}"


def custom(animate: Callable, folder: Path, mesh: Path, *overrides: str) -> str:
    return refused(animate, folder, "scene=custom", f"scene.mesh={mesh}", MASS, *overrides)


def changed(array: np.ndarray, index: object, value: float) -> np.ndarray:
    copy = array.copy()
    copy[index] = value
    return copy


MESHES = {
    "degenerate face": (X, np.r_[FACES, [[0, 1, 2]]], "1 faces have no area .*remove them or merge"),
    "no face": (X, FACES[:0], "found no triangle; expected a mesh with faces; export faces"),
    "empty": (X[:0], FACES[:0], "found no triangle"),
    "no such vertex": (X, np.r_[FACES, [[0, 1, 99]]], r"faces index 0\.\.99; expected 0\.\.35"),
    "nan": (changed(X, 7, np.nan), FACES, r"frame 0, vertex 7: found \[nan nan nan\]; expected finite"),
    "centimetres": (100 * X, FACES, r"found a cloth of 141 m; expected 0\.01 to 100 m; .* set scene\.scale"),
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_that_is_no_cloth(animate, tmp_path, name):
    positions, faces, sentence = MESHES[name]
    mesh = written(tmp_path / "shirt.obj", positions, faces)
    assert_says(custom(animate, tmp_path, mesh), rf"{mesh}: .*{sentence}")


def test_a_cloth_that_is_pinned_all_over(animate, tmp_path):
    """A flat one lies at the height of its highest vertex as a whole."""
    mesh = written(tmp_path / "shirt.obj", X, FACES)
    said = custom(animate, tmp_path, mesh, "scene.pins={top: 0.02}")
    assert_says(said, "scene shirt: pins: found all 36 vertices; expected some that are free; pin fewer")


def test_a_cloth_of_parts_that_touch_nowhere_is_allowed(animate, tmp_path):
    mesh = written(tmp_path / "two.obj", np.r_[X, X + [0, 0, 0.3]], np.r_[FACES, FACES + len(X)])
    done = animate("scene=custom", f"scene.mesh={mesh}", MASS, "scene.frames=1", "output.render=none")
    assert done.code == 0, done.err


def npz(folder: Path, **changes: object) -> Path:
    arrays = {"faces": np.array(BALL.faces), "positions": WALK, "fps": 30.0} | changes
    np.savez(folder / "body.npz", **{name: value for name, value in arrays.items() if value is not None})
    return folder / "body.npz"


def changing(folder: Path) -> Path:
    for frame in range(3):
        positions = BODY if frame < 2 else np.r_[BODY, [[0, 0, 0]]]
        written(folder / "walk" / f"body_{frame}.obj", positions, BALL.faces)
    return folder / "walk"


def torn(folder: Path) -> Path:
    with h5py.File(folder / "body.h5", "w") as file:
        file.update({"faces": BALL.faces, "positions": WALK})
    (folder / "body.h5").write_bytes((folder / "body.h5").read_bytes()[:800])
    return folder / "body.h5"


def holding_nan(folder: Path) -> Path:
    with h5py.File(folder / "body.h5", "w") as file:
        file.update({"faces": BALL.faces, "positions": changed(WALK, (1, 3), np.nan), "fps": 30.0})
    return folder / "body.h5"


BODIES = {
    "centimetres": (lambda f: written(f / "b.obj", 100 * BODY, BALL.faces), r"shirt\.obj and .*b\.obj: .*body_scale"),
    "far away": (lambda f: written(f / "b.obj", BODY + 50, BALL.faces), "away from a body .*expected it on the body"),
    "another topology": (changing, r"body_2\.obj: .* not those of body_0\.obj .*; expected the same topology"),
    "too short": (lambda f: npz(f, positions=WALK[:2]), "found 2 frames at 30 per second.* set scene.frames to 1"),
    "no rate": (lambda f: npz(f, fps=None), r"without a rate; expected frames per second: set scene\.body_fps"),
    "nan in npz": (lambda f: npz(f, positions=changed(WALK, (2, 5), np.nan)), "frame 2, vertex 5: found .*nan"),
    "nan in HDF5": (holding_nan, "frame 1, vertex 3: found .*nan.*export it again"),
    "cut off": (torn, "cannot be read .*write the file again"),
    "nobody": (lambda f: f / "nobody.npz", "no such file or folder; give the path of a mesh"),
}


@pytest.mark.parametrize("name", BODIES)
def test_a_body_that_is_none(animate, tmp_path, name):
    make, sentence = BODIES[name]
    body, mesh = make(tmp_path), written(tmp_path / "shirt.obj", X, FACES)
    assert_says(custom(animate, tmp_path, mesh, f"scene.body={body}", "scene.body_scale=1.0"), sentence)


def test_a_law_of_another_fabric(animate, tmp_path):
    """Tables by their fabric and its settings, checkpoints by what they were trained on."""
    table = f"energy.table={SHIPPED}/eunet_hinge_silk.npz"
    assert_says(refused(animate, tmp_path, *HANGING, table, "fabric=denim"), "a table of silk; expected one of denim")
    stiffer = refused(animate, tmp_path, *HANGING, "fabric.tension_stiffness=7.0")
    assert_says(stiffer, r"baked for 5, but the scene's fabric has 7; .*bake it again")
    content = torch.load(SHIPPED / "eunet_hinge.ckpt", weights_only=True)
    trained = content["drape"]["config"]["material"]
    content["drape"]["config"]["material"] = {"silk": trained["silk"]}
    torch.save(content, tmp_path / "silk.ckpt")
    law = ("energy=eunet", f"energy.checkpoint={tmp_path}/silk.ckpt")
    said = refused(animate, tmp_path, *HANGING, *law, "fabric=denim")
    assert_says(said, r"silk\.ckpt: found a law of silk; expected one of denim; choose one of its fabrics, or train")
    (tmp_path / "damaged.npz").write_bytes((SHIPPED / "eunet_hinge_silk.npz").read_bytes()[:5000])
    said = refused(animate, tmp_path, *HANGING, f"energy.table={tmp_path}/damaged.npz")
    assert_says(said, r"damaged\.npz: cannot be read as a table .*bake it again")


def test_recorded_data_with_a_hole(animate, tmp_path, data):
    """NaN in a data file is found, whatever reads it."""
    shutil.copy(data, tmp_path / "holes.h5")
    with h5py.File(tmp_path / "holes.h5", "r+") as file:
        file["positions"][2, 3, 4] = np.nan
    law = ("energy=spring_hinge", f"energy.path={tmp_path}/holes.h5")
    for scene in (("scene=held_out", f"scene.path={tmp_path}/holes.h5"), (*HANGING, *law)):
        assert_says(refused(animate, tmp_path, *scene), "holes.h5: sequences/000002/positions: frame 3: .*not finite")


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (["scene=hangin"], "Could not find 'scene/hangin'"),
        (["scene=null"], "expected the name of an option"),
        (["scene=custom"], r"scene\.mesh is not set"),
        (["scene=hanging", "+scene.friction=0.3"], r"scene\.friction: hanging has no argument 'friction'"),
        (["scene=hanging", "scene.body=walk.npz"], r"Could not override 'scene\.body'"),
        (["scene.frames=two"], r"scene\.frames: found 'two' \(str\); sphere expects int"),
        (["scene.frames=0"], "frames: found 0; expected a whole number from 1"),
        (["scene.resolution=2.5"], r"found 2\.5 \(float\); sphere expects int"),
        (["scene.size=nan"], "scene.size: found nan; expected a number above 0"),
        (["scene.radius=nan"], "scene.radius: found nan; expected a number above 0"),
        (["scene.gravity=[0.0,0.0,nan]"], r"scene\.gravity\.2: found nan"),
        (["scene.mass.areal_density=-1.0"], r"scene\.mass\.areal_density: found -1\.0; expected a number above 0"),
        (["scene.mass.per_vertex=1.0"], "expected exactly one of per_vertex"),
        (["simulator.tolerance=nan"], r"simulator\.tolerance: found nan; expected a number above 0"),
        (["simulator.device=tpu"], r"simulator\.device: found 'tpu'; .*use simulator\.device=cpu"),
        (["simulator.precision=float16"], "expected float32 or float64"),
        (["contact.thickness=1.0"], "thickness <= reach"),
        (["output.render=cycle"], r"output\.render: found 'cycle' .*'preview', 'cycles', 'none'"),
        (["output.formats=obj"], r"output\.formats: found 'obj' \(str\); Output expects list"),
        (["output.formats=[fbx]"], "found fbx; expected some of obj, npz, abc, usd, glb"),
        (["output.every=half"], r"output\.every: found 'half'"),
        (["explain=maybe"], "explain: found 'maybe'.*; expected true or false"),
        (["scen=sphere"], "did you mean 'scene'"),
    ],
)
def test_a_scene_that_asks_for_what_is_not_there(animate, tmp_path, overrides, sentence):
    assert_says(refused(animate, tmp_path, *overrides), sentence)


def test_a_folder_that_cannot_be_one(animate, tmp_path):
    (tmp_path / "file").write_text("")
    said = refused(animate, tmp_path, *HANGING, f"folder={tmp_path}/file/out")
    assert_says(said, "cannot use .*/file/out: Not a directory; .*choose another path")
    said = refused(animate, tmp_path, *HANGING, "folder=/proc/out")
    assert_says(said, "cannot use /proc/out: no folder can be made there; choose another path: folder=")


def test_without_blender(animate, tmp_path, monkeypatch):
    """Exports and pictures that need it are refused before the first frame; so are bodies that only it can read."""
    hide = "import importlib.util as u; f = u.find_spec; u.find_spec = lambda n, *a: None if n == 'bpy' else f(n, *a)"
    (tmp_path / "sitecustomize.py").write_text(hide)
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")  # or the hiding is compiled into the folder that stays empty
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "bpy" else find(name, *a))
    missing = r"Blender is not installed .*python3\.11 -m pip install .*; {}"
    for kind in ("abc", "usd", "glb"):
        said = refused(animate, tmp_path, *HANGING, f"output.formats=[{kind}]")
        assert_says(said, "output.formats: " + missing.format("obj and npz are written without it"))
    said = refused(animate, tmp_path, "scene=hanging", "output.render=cycles")
    assert_says(said, "output.render=cycles: " + missing.format("output.render=preview draws without it"))
    (tmp_path / "walk.glb").write_bytes(b"glTF")
    mesh = written(tmp_path / "shirt.obj", X, FACES)
    said = custom(animate, tmp_path, mesh, f"scene.body={tmp_path}/walk.glb")
    assert_says(said, r"walk\.glb: .*Blender is not installed .*or export it as OBJ, a body as a folder of OBJ files")
