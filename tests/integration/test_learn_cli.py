"""From recordings to an animation in two commands, as a user types them."""

from __future__ import annotations

import importlib.util
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from drape.data.animation_hdf5 import AnimationFile
from drape.data.trajectories import open_trajectories
from drape.geometry.grid import square_grid
from tests.integration.conftest import ROOT, in_process, program
from tests.recordings import patch, swinging, write_npz

GRID = square_grid(0.4, 4)
REST = GRID.rest_positions.astype(np.float64)
needs_blender = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("recordings")
    for number in range(5):
        mesh, pins = ((GRID, [12, 15]), (patch(), [20]))[number % 2]
        write_npz(root / f"{number}.npz", mesh, swinging(mesh, pins, frames=12, seed=number))
    return root


@pytest.fixture
def steps_in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The programs that ``learn`` starts one after the other run in this process."""
    start = subprocess.run

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess:
        if Path(command[1]).parent != ROOT / "src":
            return start(command, **options)
        done = in_process(Path(command[1]).stem, *command[2:])
        print(done.out)
        print(done.err, file=sys.stderr)
        return subprocess.CompletedProcess(command, done.code)

    monkeypatch.setattr(subprocess, "run", run)


@pytest.mark.slow
def test_two_commands_from_recordings_to_an_animation(recordings: Path, tmp_path: Path, steps_in_process) -> None:
    """The second is the one that the first ends with; the first again does nothing twice."""
    told = [f"data.root={recordings}", f"data.path={tmp_path}/own.h5", "data.mass.areal_density=0.2", "scale=smoke"]
    told += [f"folder={tmp_path}/learn", "data.test=0.4"]
    done = in_process("learn", *told)
    assert done.code == 0, done.err
    assert "gravity: the motion shows 9." in done.out
    assert "largest relative differences from the network" in done.out
    assert "fitted spring-hinge law" in done.out
    table = tmp_path / "learn" / "own.npz"
    written = table.stat().st_mtime_ns
    again = in_process("learn", *told)
    assert again.code == 0, again.err
    assert table.stat().st_mtime_ns == written
    (command,) = [line for line in done.out.splitlines() if "animate.py scene=held_out" in line]
    words = [word for word in shlex.split(command) if "=" in word]
    animated = in_process("animate", *words, "scene.frames=4", f"folder={tmp_path}/animated")
    assert animated.code == 0, animated.err
    with AnimationFile(tmp_path / "animated" / "animation.h5") as file:
        assert file.num_frames == 5


def test_a_mistake_ends_the_whole_with_its_sentence(recordings: Path, tmp_path: Path) -> None:
    done = program("learn", f"data.root={recordings}", f"data.path={tmp_path}/own.h5", f"folder={tmp_path}/learn")
    assert done.returncode == 2
    assert "found no mass; expected exactly one of data.mass.areal_density" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_wrong_unit_leaves_no_data_set(recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told = [f"data.root={recordings}", f"data.path={tmp_path}/own.h5", "data.mass.areal_density=0.2", "data.scale=0.1"]
    done = in_process("generate", "data=recorded", f"hydra.run.dir={tmp_path}", *told)
    assert done.code == 2
    assert "the rate or the unit is wrong" in done.err
    assert not (tmp_path / "own.h5").exists()


@needs_blender
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["abc", "usd", "glb"])
def test_files_that_blender_opens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Written by Blender from an animation of ours, read as a recording: the same motion."""
    from drape.blender.output import export
    from drape.data.animation_writer import AnimationWriter
    from drape.scene.state import State
    from tests.animations import header

    monkeypatch.chdir(tmp_path)
    moved = []
    for number in range(2):
        x = swinging(GRID, [12, 15], frames=8, seed=number)
        changes = {"rest_positions": REST, "faces": GRID.faces, "dt": 1 / 60}
        about = header(frames=8, body=False, mass=np.full(16, 0.002), pinned=np.array([12, 15]), **changes)
        with AnimationWriter(tmp_path / f"{number}.h5", about) as writer:
            for frame in x:
                solved = {"residual": 0.0, "iterations": 1.0} if writer.num_frames else None
                writer.append(State(frame, np.zeros_like(frame)), solved)
        (made,) = export(tmp_path / f"{number}.h5", [kind], tmp_path / f"out_{number}")
        (tmp_path / "root").mkdir(exist_ok=True)
        made.replace(tmp_path / "root" / f"{number}.{kind}")
        moved.append(x)
    told = ["data.root=root", "data.path=own.h5", "data.mass.areal_density=0.2", "data.fps=60", "data.rest=first"]
    done = in_process("generate", "data=recorded", f"hydra.run.dir={tmp_path}", *told)
    assert done.code == 0, done.err
    file = open_trajectories("own.h5")
    for sequence, x in zip(file.sequences, moved, strict=True):
        assert sequence.num_frames == 8
        places = sequence.positions[0][:, None] - x[0]
        order = np.linalg.norm(places, axis=-1).argmin(1)  # formats may order vertices anew
        np.testing.assert_allclose(sequence.positions, x[:, order], atol=1e-5)
