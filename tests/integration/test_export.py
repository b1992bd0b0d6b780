"""What other tools get to see: every format read back by Blender, pictures and a film, kept and continued."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drape.blender import output
from drape.blender.output import export, render
from drape.blender.process import BlenderProcess
from drape.errors import DrapeError
from drape.reading.files import read_file
from drape.reading.triangles import made
from tests.animations import FILES, MESH, header, raised, state, write

ROOT = Path(__file__).parents[2]
SIZE = (64, 48)
pytestmark = [
    pytest.mark.blender,
    pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)"),
]

READ = """
import json, sys
import bpy, numpy as np

def read(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 30
    {"abc": lambda: bpy.ops.wm.alembic_import(filepath=path, as_background_job=False),
     "sdc": lambda: bpy.ops.wm.usd_import(filepath=path),
     "glb": lambda: bpy.ops.import_scene.gltf(filepath=path)}[path[-3:]]()
    found = {"last": scene.frame_end}
    for name in ("cloth", "body"):
        thing = scene.objects[name]
        found[name] = []
        for frame in (0, 1, 2, 1.5):
            scene.frame_set(int(frame), subframe=frame % 1)
            seen = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
            x = np.empty((len(seen.data.vertices), 3), np.float32)
            seen.data.vertices.foreach_get("co", x.reshape(-1))
            place = np.array(seen.matrix_world)
            found[name].append((x @ place[:3, :3].T + place[:3, 3]).tolist())
        triangles = [list(p.vertices) for p in thing.data.polygons]
        found[name + " faces"] = triangles
        found[name + " smooth"] = all(p.use_smooth for p in thing.data.polygons)
    return found

def film(path):
    clip = bpy.data.movieclips.load(path)
    return {"frames": clip.frame_duration, "fps": clip.fps, "size": list(clip.size)}

results = {path: film(path) if path.endswith("mp4") else read(path) for path in sys.argv[1:-1]}
json.dump(results, open(sys.argv[-1], "w"))
"""


def read_with_blender(*paths: Path) -> list[dict]:
    answer = paths[0].parent / "read.json"
    command = [sys.executable, "-c", READ, *map(str, paths), str(answer)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=800, check=False)
    assert run.returncode == 0, run.stderr[-2000:] + run.stdout[-2000:]
    found = json.loads(answer.read_text())
    return [found[str(path)] for path in paths]


def animation_times(glb: Path) -> list[tuple[float, float, int]]:
    """First and last time [s] and number of keys of everything that moves in the only animation of a GLB file."""
    content = glb.read_bytes()
    document = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    (animation,) = document["animations"]  # viewers play one at a time
    times = [document["accessors"][sampler["input"]] for sampler in animation["samplers"]]
    return [(t["min"][0], t["max"][0], t["count"]) for t in times]


def test_files_come_out_with_the_polygons_texture_materials_and_frames_they_came_in_with(tmp_path: Path) -> None:
    """A garment in centimetres: Alembic, which says no unit, has them again; the others are in metres."""
    source = read_file(FILES / "blender" / "skirt.obj")
    read = made(replace(source, positions=100 * source.positions), 0.01, "y")
    written = export(raised(read, tmp_path / "a.h5", first=7), ["abc", "usd", "glb"], tmp_path / "out")
    for path in written:
        back, scale = read_file(path, animated=True), 0.01 if path.suffix == ".abc" else 1.0
        moved = made(back, scale)
        assert (back.fps, back.first, len(back.positions)) == (24.0, 7, 2)
        cloth = moved.positions[:, -48:] if path.suffix != ".glb" else moved.positions[:, 42:]
        np.testing.assert_allclose(np.sort(cloth[0], axis=0), np.sort(read.positions[0], axis=0), atol=1e-6)
        np.testing.assert_allclose(cloth[1] - cloth[0], np.tile([0, 0, 0.01], (48, 1)), atol=1e-6)
        assert len(np.unique(np.round(back.uv[~np.isnan(back.uv).any(axis=1), 0], 4))) == 13
        if path.suffix != ".glb":
            assert np.bincount(back.polygons.sizes).tolist() == [0, 0, 0, 80, 36], "the body's triangles, 36 quads"
        if path.suffix != ".abc":
            assert {name.split(".")[0] for name in back.materials} == {"body", "cloth_0", "cloth_1"}


def test_every_format_plays_back_as_it_was_simulated(tmp_path: Path) -> None:
    made = header(3)
    path = write(tmp_path / "wave.h5", made)
    written = export(path, ["abc", "usd", "glb"], tmp_path / "out")
    assert [p.name for p in written] == ["wave.abc", "wave.usdc", "wave.glb"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["wave.abc", "wave.glb", "wave.usdc"]
    for file, found in zip(written, read_with_blender(*written), strict=True):
        moving = {"cloth": lambda k: state(k).x, "body": made.obstacle.at}
        for name, faces in (("cloth", MESH.faces), ("body", made.obstacle.faces)):
            for frame, x in zip((0, 1, 2), found[name], strict=False):
                np.testing.assert_allclose(x, moving[name](frame), atol=1e-6, err_msg=f"{file.name} {name} {frame}")
            assert [sorted(f) for f in found[f"{name} faces"]] == [sorted(f) for f in faces.tolist()]
            assert found[f"{name} smooth"]
            between = 0.5 * (moving[name](1) + moving[name](2))
            if file.suffix == ".glb":  # morph targets fade linearly
                np.testing.assert_allclose(found[name][3], between, atol=1e-6)
        if file.suffix != ".glb":
            assert found["last"] == 2
    assert animation_times(written[2]) == [(0.0, pytest.approx(2 / 30), 3)] * 2


def test_a_scene_whose_up_is_y_stands_upright(tmp_path: Path) -> None:
    made = header(3, gravity=np.array([0.0, -9.81, 0.0]), body=False, dt=0.4)
    written = export(write(tmp_path / "a.h5", made), ["glb"], tmp_path)
    assert animation_times(written[0]) == [(0.0, pytest.approx(0.8), 3)]
    code = READ.replace('("cloth", "body")', '("cloth",)').replace("fps = 30", "fps = 10")
    code = code.replace("(0, 1, 2, 1.5)", "(0, 4, 8)")
    answer = tmp_path / "read.json"
    command = [sys.executable, "-c", code, str(written[0]), str(answer)]
    subprocess.run(command, check=True, capture_output=True, timeout=800)
    found = json.loads(answer.read_text())[str(written[0])]
    x = state(2).x
    np.testing.assert_allclose(found["cloth"][2], np.column_stack([x[:, 0], -x[:, 2], x[:, 1]]), atol=1e-6)


def pictures(folder: Path) -> dict[str, int]:
    return {p.name: p.stat().st_mtime_ns for p in sorted((folder / "frames").glob("*.png"))}


def test_pictures_and_film_are_kept_and_continued(tmp_path: Path) -> None:
    path, folder = write(tmp_path / "wave.h5", header(4), stop=3), tmp_path / "render"
    film = render(path, folder, samples=8, size=SIZE)
    first = pictures(folder)
    assert list(first) == [f"frame_{frame:04d}.png" for frame in range(3)]
    (found,) = read_with_blender(film)
    assert (found["frames"], found["fps"], found["size"]) == (3, pytest.approx(30, rel=1e-3), list(SIZE))

    made = film.stat().st_mtime_ns
    assert render(path, folder, samples=8, size=SIZE) == film
    assert (pictures(folder), film.stat().st_mtime_ns) == (first, made)  # nothing was done

    (folder / "frames" / "frame_0001.png").unlink()
    render(path, folder, samples=8, size=SIZE)
    second = pictures(folder)
    assert [name for name in first if second[name] == first[name]] == ["frame_0000.png", "frame_0002.png"]

    render(path, folder, samples=4, size=SIZE, every=2)
    third = pictures(folder)
    assert [name for name in second if third[name] == second[name]] == ["frame_0001.png"]
    (found,) = read_with_blender(film)
    assert (found["frames"], found["fps"]) == (2, pytest.approx(15, rel=1e-3))


def test_a_picture_shows_the_cloth_and_the_body(tmp_path: Path) -> None:
    path = write(tmp_path / "wave.h5", header(2, gravity=np.array([0.0, 9.81, 0.0])))  # seen from its flat side
    render(path, tmp_path, samples=8, size=(96, 96), every=1)
    shown = [np.asarray(Image.open(tmp_path / "frames" / f"frame_000{k}.png"), float) for k in (0, 1)]
    assert shown[0].shape == (96, 96, 3)
    blue = shown[0][..., 2] > 1.3 * shown[0][..., 0]
    assert 0.1 < blue.mean() < 0.8
    assert not blue[[0, -1]].any()  # none of it is cut off
    assert not blue[:, [0, -1]].any()
    assert shown[0][:8, :8].min() > 60  # the studio is not dark
    assert 60 < np.median(shown[0]) < 240  # nor washed out
    assert np.abs(shown[0] - shown[1]).max() > 30  # it moves


def heed_interrupts() -> None:
    """A shell that starts the tests in the background has its children ignore Ctrl+C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_interrupted_the_pictures_that_are_done_stay(tmp_path: Path) -> None:
    path = write(tmp_path / "wave.h5", header(40))
    code = f"from drape.blender.output import render; render({str(path)!r}, {str(tmp_path)!r}, 4, {list(SIZE)})"
    env = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    process = subprocess.Popen(
        [sys.executable, "-c", code], env=env, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts
    )
    deadline = time.monotonic() + 800
    while len(pictures(tmp_path)) < 2:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in process.communicate(timeout=800)[1]
    kept = pictures(tmp_path)
    assert 2 <= len(kept) < 40
    assert all(Image.open(tmp_path / "frames" / name).size == SIZE for name in kept)
    noted = json.loads((tmp_path / "frames" / "frames.json").read_text())
    assert len(kept) - 1 <= len(noted) <= len(kept)
    assert not (tmp_path / "film.mp4").exists()


def test_what_cannot_be_made_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "wave.h5", header(2))
    with pytest.raises(DrapeError, match=r"output.formats: found fbx; expected some of obj, npz, abc, usd, glb"):
        export(path, ["obj", "fbx"], tmp_path / "out")
    with pytest.raises(DrapeError, match=r"output.size: found \[65, 48\]; expected .* even"):
        render(path, tmp_path / "out", size=(65, 48))
    with pytest.raises(DrapeError, match="output.samples: found 0; expected a whole number from 1 on"):
        render(path, tmp_path / "out", samples=0)
    with pytest.raises(DrapeError, match=r"absent.h5: no such file"):
        export(tmp_path / "absent.h5", ["glb"], tmp_path / "out")
    assert not (tmp_path / "out").exists()

    class Dead(BlenderProcess):
        def send(self, request: object) -> None:
            self.process.kill()

    monkeypatch.setattr(output, "BlenderProcess", Dead)
    with pytest.raises(DrapeError, match=r"frame 0: its Blender process died \(exit status -9\): .*the same command"):
        render(path, tmp_path / "out", size=SIZE)
    with pytest.raises(DrapeError, match=r"wave.glb: its Blender process died"):
        export(path, ["glb"], tmp_path / "out")
    assert not [p for p in (tmp_path / "out").rglob("*") if p.is_file()]
