"""The wheel: it animates from an empty folder, without the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.conftest import ROOT


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with nothing but the wheel of this checkout."""
    source, place = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("installed")
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("src", "conf"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    wheel = [*pip, "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(source), str(source)]
    subprocess.run(wheel, check=True, capture_output=True)
    (found,) = source.glob("*.whl")
    subprocess.run([*pip, "install", "--quiet", "--no-deps", "--target", str(place), str(found)], check=True)
    return place


def drape(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """``drape arguments`` in a folder."""
    env = os.environ | {"PYTHONPATH": str(installed), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "drape.command_line", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=800, env=env, cwd=folder, check=False)


def test_animates_from_an_empty_folder(installed, tmp_path):
    run = drape(installed, tmp_path, "animate", "scene=hanging", "energy=phys", "scene.resolution=5", "scene.frames=2")
    assert run.returncode == 0, run.stderr[-2000:]
    assert "hanging: 2 frames of 25 vertices" in run.stdout
    assert (tmp_path / "runs" / "animate" / "hanging" / "phys" / "silk" / "animation.h5").is_file()


def test_has_all_commands_and_configs(installed, tmp_path):
    programs = {path.stem for path in (ROOT / "src").glob("*.py")}
    assert {path.stem for path in (installed / "drape" / "programs").glob("*.py")} == programs
    pages = {path.relative_to(ROOT / "conf") for path in (ROOT / "conf").rglob("*.yaml")}
    assert {path.relative_to(installed / "drape" / "conf") for path in (installed / "drape" / "conf").rglob("*")
            if path.suffix == ".yaml"} == pages  # fmt: skip
    assert {path.suffix for path in (installed / "drape" / "report").glob("page.*")} == {".py", ".html", ".css"}
    shown = drape(installed, tmp_path)
    assert shown.returncode == 0
    assert all(f"drape {name} " in shown.stdout for name in programs)


def test_a_command_that_there_is_not(installed, tmp_path):
    run = drape(installed, tmp_path, "anmate")
    assert run.returncode == 2
    assert "found no such command" in run.stderr
    assert "did you mean animate?" in run.stderr
