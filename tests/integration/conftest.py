"""A data set that needs no Blender, and the programs run as users run them."""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig

from drape.config import set_statistics
from drape.data import schema
from drape.geometry.grid import square_grid
from tests import trajectories

ROOT = Path(__file__).parents[2]
SETTINGS = dict.fromkeys(schema.MATERIAL_ATTRIBUTES, 1.0)
FABRICS = {
    "silk": SETTINGS | {"preset": "Silk", "mass_per_vertex": 0.15, "tension_stiffness": 5.0},
    "leather": SETTINGS | {"preset": "Leather", "mass_per_vertex": 0.4, "tension_stiffness": 80.0},
    "denim": SETTINGS | {"preset": "Denim", "mass_per_vertex": 1.0, "tension_stiffness": 40.0},
    "cotton": SETTINGS | {"preset": "Cotton", "mass_per_vertex": 0.3, "tension_stiffness": 15.0},
}


def swaying(number: int, frames: int = 8) -> np.ndarray:
    """A sheet in a standing wave: nothing that a simulator made, but motion and deformation everywhere."""
    rng = np.random.default_rng(number)
    rest = square_grid(1.0, 5).rest_positions
    t = np.arange(frames)[:, None] / 30.0
    phase, size = rng.uniform(0, 6, 3), rng.uniform(0.02, 0.1, 3)
    x = np.repeat(rest[None].astype(np.float64), frames, 0)
    for axis in range(3):
        x[..., axis] += size[axis] * np.sin(6 * t + phase[axis] + 2 * rest[None, :, 0]) * (0.5 - rest[None, :, 1])
    return x.astype(np.float32)


def write_swaying(path: Path) -> Path:
    """Eight training and four test sequences of 5 x 5 vertices, eight frames, four fabrics."""
    header = trajectories.header(materials=FABRICS, seed=0, source="none", config="{}")
    rows = trajectories.sequences_of([swaying(i) for i in range(12)], tuple(FABRICS), training=8)
    return trajectories.write(path, header, rows, square_grid(1.0, 5), (0, 4))


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As :func:`write_swaying` says."""
    return write_swaying(tmp_path_factory.mktemp("data") / "swaying.h5")


def program(name: str, *overrides: str, **environment: str) -> subprocess.CompletedProcess:
    """``python src/<name>.py overrides`` in a process of its own."""
    env = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}", "OMP_NUM_THREADS": "1"} | environment
    command = [sys.executable, str(ROOT / "src" / f"{name}.py"), *overrides]
    return subprocess.run(command, capture_output=True, text=True, timeout=800, env=env, cwd=ROOT, check=False)


class Run(NamedTuple):
    code: int
    out: str
    err: str


def in_process(name: str, *overrides: str) -> Run:
    """``python src/<name>.py overrides`` in this process: the same main, without its start of some seconds."""
    argv, out, err, code = sys.argv, io.StringIO(), io.StringIO(), 0
    before = GlobalHydra.instance().hydra, HydraConfig.instance().cfg  # of a program that runs this one, as learn does
    GlobalHydra.instance().clear()
    sys.argv = [f"src/{name}.py", *overrides]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            runpy.run_path(str(ROOT / "src" / f"{name}.py"), run_name="__main__")
        except SystemExit as stop:
            code = stop.code or 0
        finally:
            sys.argv = argv
            GlobalHydra.instance().hydra, HydraConfig.instance().cfg = before
            set_statistics(None)
    return Run(code, out.getvalue(), err.getvalue())


def small(data: Path, folder: Path, *overrides: str) -> list[str]:
    """What is typed after ``train`` for a small training in ``folder``."""
    return [f"data.path={data}", f"hydra.run.dir={folder}", "scale=smoke", "logger=csv", *overrides]


def trained(data: Path, folder: Path, *overrides: str) -> Run:
    """A small training in ``folder``, in this process."""
    return in_process("train", *small(data, folder, *overrides))


@pytest.fixture
def animate(monkeypatch, tmp_path) -> Callable[..., Run]:
    """``python src/animate.py folder=<tmp_path>/out overrides`` in this process."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")

    def run(*overrides: str) -> Run:
        given = [] if any(word.startswith(("folder=", "-")) for word in overrides) else [f"folder={tmp_path}/out"]
        return in_process("animate", *given, *overrides)

    return run
