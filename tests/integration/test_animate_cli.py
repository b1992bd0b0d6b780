"""Animating as users do: every scene and law, exports, interruptions, their own mesh and body."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh

from drape.config.entry_point import CONF
from drape.data.animation_hdf5 import AnimationFile
from drape.geometry.grid import square_grid
from drape.scene.mesh_file import read_triangles
from tests.integration.conftest import ROOT, program

SMALL = {
    "sphere": ("scene.resolution=8", "scene.subdivisions=2"),
    "hanging": ("scene.resolution=6",),
    "cantilever": ("scene.resolution=[6,3]",),
    "cusick": ("scene.rings=5",),
    "flag": ("scene.resolution=[6,4]",),
}
"""Coarser meshes, for speed."""
HANGING = ("scene=hanging", *SMALL["hanging"], "output.render=none")


def animation(path: Path) -> AnimationFile:
    return AnimationFile(path / "animation.h5")


# What comes out


def test_right_after_install_a_cloth_falls_on_a_sphere(tmp_path):
    """No argument but fewer frames, in a process of its own: the shipped table, a file, a picture, a summary."""
    done = program("animate", "scene.frames=3", f"folder={tmp_path}")
    assert done.returncode == 0, done.stderr
    assert re.search(r"sphere: 3 frames of 900 vertices, silk, at 30 per second\n\d+ ms/frame \(median\)", done.stdout)
    assert "inside the body: mean 0.000 %" in done.stdout
    assert f"{tmp_path.name}/animation.h5" in done.stdout
    assert (tmp_path / "preview.png").stat().st_size > 10_000
    with animation(tmp_path) as file:
        assert (file.header.fabric, file.is_complete, file.header.dt) == ("silk", True, 1 / 30)
        heights = file.trajectory().x[..., 2].mean(axis=1)
    assert heights == pytest.approx(-9.81 / 30**2 * np.array([0, 1, 3, 6]), rel=0.15), "it falls, and air brakes it"


def test_every_scene_is_tried_here():
    elsewhere = {"custom", "held_out", "extreme", "garment", "person"}
    assert {path.stem for path in (CONF / "scene").glob("*.yaml")} == {*SMALL, *elsewhere}


@pytest.mark.parametrize("scene", SMALL)
def test_every_scene_moves_and_stays_near(animate, tmp_path, scene):
    """Pinned vertices stay, free ones move, nothing explodes."""
    done = animate(f"scene={scene}", *SMALL[scene], "scene.frames=2", "output.render=none")
    assert done.code == 0, done.err
    with animation(tmp_path / "out") as file:
        x, pinned = file.trajectory().x, file.header.pinned
    free = np.setdiff1d(np.arange(x.shape[1]), pinned)
    moved = np.linalg.norm(x[2] - x[0], axis=-1)
    assert (moved[pinned] == 0).all()
    assert 1e-3 < moved[free].max() < 0.2


def test_recorded_frames_are_compared_with(animate, data):
    done = animate("scene=held_out", f"scene.path={data}", "scene.frames=2", "fabric=denim", "output.render=none")
    assert done.code == 0, done.err
    assert re.search(r"mean distance to the recorded frames [\d.]+ mm, [\d.]+ % of the", done.out)


def test_every_law_bends_and_resists(animate, data, tmp_path):
    """The same scene by each law: table and network agree closely, others are other fabrics."""
    laws = ("eunet", "eunet_baked", "eunet_baked_garment", "phys", "spring_hinge")
    assert {path.stem for path in (CONF / "energy").glob("*.yaml")} == set(laws)
    ends = {}
    for law in laws:
        extra = [f"energy.path={data}"] if law == "spring_hinge" else []
        done = animate(*HANGING, "scene.frames=3", f"energy={law}", *extra, f"folder={tmp_path}/{law}")
        assert done.code == 0, done.err
        with animation(tmp_path / law) as file:
            ends[law] = file.x(3)
    travelled = np.linalg.norm(ends["eunet"] - ends["eunet"][0], axis=-1).mean()
    assert np.abs(ends["eunet"] - ends["eunet_baked"]).max() < 1e-3 * travelled
    for law in ("eunet_baked_garment", "phys", "spring_hinge"):
        assert np.abs(ends["eunet"] - ends[law]).max() > 1e-3 * travelled


def test_exports_hold_the_frames(animate, tmp_path):
    done = animate(*HANGING, "scene.frames=2", "output.formats=[obj,npz]")
    assert done.code == 0, done.err
    with animation(tmp_path / "out") as file, np.load(tmp_path / "out" / "animation.npz") as arrays:
        frames, faces = file.trajectory().x, file.header.faces
        stored = next(arrays[name] for name in arrays.files if arrays[name].shape == frames.shape)
        np.testing.assert_allclose(stored, frames, atol=1e-6)
    sequence = sorted((tmp_path / "out" / "obj").glob("*.obj"))
    assert len(sequence) == 3
    positions, read = read_triangles(sequence[2])
    np.testing.assert_allclose(positions, frames[2], atol=1e-6)
    np.testing.assert_array_equal(read, faces)


def test_explain_lists_what_the_scene_requires_and_why(animate, tmp_path):
    """No body: neither contact nor friction nor a search; nothing is written."""
    alone = animate("scene=flag", *SMALL["flag"], "explain=true")
    assert (alone.code, list((tmp_path / "out").glob("*.h5"))) == (0, [])
    for part in ("inertia", "gravity", "external", "elastic", "a constant force of", "no body"):
        assert part in alone.out
    assert "contact" not in alone.out
    assert "friction" not in alone.out
    with_body = animate("scene=sphere", *SMALL["sphere"], "explain=true")
    for part in ("contact", "a body of 320 faces", "friction", "nearest faces of the body"):
        assert part in with_body.out
    assert "external" not in with_body.out
    assert "friction" not in animate("scene=sphere", *SMALL["sphere"], "scene.friction=null", "explain=true").out


def test_a_cloth_too_coarse_for_its_body_is_told_before_anything_is_made(animate):
    """The scenes as they come are fine enough, also with vertices alone; contact=surface asks the body too."""
    done = animate("scene=sphere", "scene.resolution=6", "contact=paper", "explain=true")
    assert re.match(r"contact: points of the cloth .* skin will show through\. Take .* contact=surface ", done.out)
    done = animate("scene=sphere", "scene.resolution=6", "explain=true")
    assert "skin" not in done.out
    assert re.search(r"2562\W.*sharp points", done.out, re.DOTALL)  # in a table, which may break the line there
    for contact in ("surface", "paper"):
        assert "skin" not in animate("scene=sphere", f"contact={contact}", "explain=true").out


def test_frames_without_crossings_are_checked_for_them(animate):
    done = animate("scene=sphere", *SMALL["sphere"], "contact=ipc", "scene.frames=2", "output.render=none")
    assert done.code == 0, done.err
    assert "no faces cross at the end of any of the 2 frames" in done.out


def test_the_help_has_commands_that_exist(animate):
    done = animate("--help")
    assert done.code == 0
    for name in ("scene=cusick", "scene=custom", "energy=eunet", "explain=true", "simulator.iterations=50"):
        assert name in done.out


def test_a_multirun_makes_an_animation_of_each_fabric(animate, tmp_path):
    done = animate(
        "-m", *HANGING, "scene.frames=2", "fabric=silk,denim", f"folder={tmp_path}/${{fabric.name}}",
        f"hydra.sweep.dir={tmp_path}/sweep",
    )  # fmt: skip
    assert done.code == 0, done.err
    ends = []
    for fabric in ("silk", "denim"):
        with animation(tmp_path / fabric) as file:
            assert file.header.fabric == fabric
            ends.append(file.x(2))
    assert np.abs(ends[0] - ends[1]).max() > 1e-6


# Interrupted and continued


def heed_interrupts() -> None:
    """A shell that starts the tests in the background has its children ignore Ctrl+C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def stopped(folder: Path, how: signal.Signals, *overrides: str) -> tuple[int, str]:
    """Exit status and words of an animation that got the signal after its fourth frame."""
    command = [sys.executable, str(ROOT / "src/animate.py"), *overrides, f"folder={folder}"]
    env = os.environ | {"PYTHONPATH": str(ROOT / "src"), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, preexec_fn=heed_interrupts, env=env, cwd=ROOT
    )
    fourth, deadline = folder / "animation.h5.parts" / "000004.npz", time.monotonic() + 800
    while not fourth.exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.001)
    process.send_signal(how)
    said = process.communicate(timeout=800)[1]
    return process.returncode, said


def test_interrupted_and_continued_is_as_never_interrupted(animate, tmp_path):
    """The frames that are done stay, and the same command goes on to the same end: all bit for bit."""
    wanted = (*HANGING, "scene.frames=20")
    assert animate(*wanted, f"folder={tmp_path}/straight").code == 0
    with animation(tmp_path / "straight") as file:
        straight = file.trajectory()
    for how in (signal.SIGINT, signal.SIGKILL):
        folder = tmp_path / how.name
        parts = folder / "animation.h5.parts"
        code, said = stopped(folder, how, *wanted)
        done = len(list(parts.glob("[0-9]*.npz")))
        assert 5 <= done < 21
        if how == signal.SIGINT:
            ours = said.partition("Exception ignored in")[0]  # Python may say so of a file that was just being opened
            assert (code, "Traceback" in ours) == (130, False), said
            assert "interrupted; the same command goes on" in said
            with animation(folder) as file:
                assert (file.num_frames, file.is_complete) == (done, False)
        assert animate(*wanted, f"folder={folder}").code == 0
        assert not parts.exists()
        with animation(folder) as file:
            continued = file.trajectory()
        assert np.array_equal(continued.x, straight.x)
        assert np.array_equal(continued.v, straight.v)


def test_a_folder_keeps_one_animation(animate, tmp_path):
    """The same command again does nothing; another one is refused, and nothing changes."""
    assert animate(*HANGING, "scene.frames=2").code == 0
    before = (tmp_path / "out" / "animation.h5").read_bytes()
    assert animate(*HANGING, "scene.frames=2").code == 0
    other = animate(*HANGING, "scene.frames=2", "simulator.iterations=10")
    assert other.code == 2
    assert re.search(r"config\.simulator\.iterations: \d+ there, 10 asked for.*choose another folder", other.err)
    assert (tmp_path / "out" / "animation.h5").read_bytes() == before


# The user's own mesh and body

CLOTH, BALL = square_grid(1.0, 6, "alternating"), trimesh.creation.icosphere(2, 0.3)
X, FACES = np.array(CLOTH.rest_positions, np.float64), np.array(CLOTH.faces)
BODY = np.array(BALL.vertices) - [0.0, 0.0, 0.31]
WALK = BODY + np.arange(6)[:, None, None] * [0.004, 0.0, 0.002]
MASS = "scene.mass.areal_density=3.0"


def written(path: Path, positions: np.ndarray, faces: np.ndarray) -> Path:
    """An OBJ, PLY or STL file; of OBJ exactly what is given, however bad."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix != ".obj":
        trimesh.Trimesh(positions, faces, process=False).export(path)
        return path
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in positions)
    path.write_text(vertices + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces))
    return path


def walking(folder: Path, kind: str) -> Path:
    """The ball on its way, as npz, HDF5 or a folder of OBJ files."""
    path = folder / f"walk.{kind}"
    if kind == "npz":
        np.savez(path, faces=BALL.faces, positions=WALK, fps=30.0)
    elif kind == "h5":
        with h5py.File(path, "w") as file:
            file.update({"faces": BALL.faces, "positions": WALK, "fps": 30.0})
    else:
        for frame, positions in enumerate(WALK):
            written(path / f"body_{frame}.obj", positions, BALL.faces)
    return path


@pytest.mark.parametrize(("kind", "body"), [("obj", "npz"), ("ply", "folder"), ("stl", "h5")])
def test_an_own_mesh_over_an_own_body(animate, tmp_path, kind, body):
    """Whatever the files are, the cloth falls, the body goes where its file says, and stays outside."""
    mesh = written(tmp_path / f"shirt.{kind}", X, FACES)
    rate = ["scene.body_fps=30.0"] if body == "folder" else []
    done = animate(
        "scene=custom", f"scene.mesh={mesh}", f"scene.body={walking(tmp_path, body)}", *rate, MASS, "scene.frames=5"
    )
    assert done.code == 0, done.err
    assert "shirt: 5 frames of 36 vertices, silk" in done.out
    assert "inside the body: mean 0.000 %" in done.out
    with animation(tmp_path / "out") as file:
        np.testing.assert_allclose(file.header.obstacle.at(5), WALK[5], atol=1e-6)
        assert np.linalg.norm(file.x(5) - WALK[5].mean(axis=0), axis=-1).min() > 0.29
        assert file.x(5)[:, 2].mean() < -0.005


def test_an_own_mesh_in_centimetres_with_y_up_and_pins(animate, tmp_path):
    upright = 100 * X[:, [0, 1, 2]] @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]).T  # (x, y, z) to (x, -z, y): z up
    mesh = written(tmp_path / "cloth.obj", upright, FACES)
    done = animate(
        "scene=custom", f"scene.mesh={mesh}", "scene.scale=0.01", "scene.up_axis=y", "scene.pins=[0,5]", MASS,
        "scene.frames=2", "output.render=none",
    )  # fmt: skip
    assert done.code == 0, done.err
    with animation(tmp_path / "out") as file:
        x, pinned = file.trajectory().x, file.header.pinned
    assert pinned.tolist() == [0, 5]
    assert np.ptp(x[0], axis=0) == pytest.approx([1.0, 1.0, 0.0], abs=1e-6)
    assert (x[2, pinned] == x[0, pinned]).all()
    assert x[2, :, 2].min() < -0.01
