"""The recipes of docs/extending.md, followed to the end in a copy of the source: no other file has to be touched."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.integration.conftest import ROOT, small

MOST = 6
"""Files of a recipe, at most."""
MINE = "mine"
"""What everything new is called."""


class Edit(NamedTuple):
    """``new`` before the first line of a file that begins with ``before``; at its end where that is empty."""

    before: str
    new: str


ROW = {
    "conf/model/mine.yaml": """\
# @package _global_
defaults: [eunet, override /model/potential: hinge, override /loss: forces]
label: Mine
""",
    "sweeps/table_animation.yaml": Edit("      seed: ", "      # and mine\n"),
}
METRIC = {
    "src/drape/metrics/mine.py": '''\
"""A share of vertices."""

import torch

from drape.metrics.fabric_metric import FabricMetric


class Fast(FabricMetric):
    """Share of vertices that are faster than ``speed`` [m/s]."""

    def __init__(self, fabrics, speed):
        super().__init__(fabrics)
        self.speed = speed
        for name in ("count", "fast"):
            self.add_sum(name)

    def update(self, step):
        window = step.window
        fast = ((window.x_next - window.x).norm(dim=-1) > self.speed * window.dt).double()
        self.fast += self.per_fabric(window, window.mesh.sum_vertices(fast))
        self.count += self.per_fabric(window, window.mesh.sum_vertices(torch.ones_like(fast)))

    def compute(self):
        return self.means("fast_share", self.fast, self.count)
''',
    "conf/metrics/energy.yaml": Edit("", "mine: {_target_: drape.metrics.mine.Fast, _partial_: true, speed: 0.01}\n"),
    "conf/tables/laws.yaml": Edit(
        "", "fast: {_target_: drape.report.tables.quantity_table, _partial_: true, key: fast_share, title: Fast}\n"
    ),
    "tests/unit/test_metric_values.py": Edit("", ""),
}
DATA = {
    "src/drape/data/mine/__init__.py": '"""Mine."""\n',
    "src/drape/data/mine/conversion.py": '''\
"""Mine."""

from pathlib import Path

from drape.data.conversion import Conversion


def convert_mine(data):
    """Nothing, of three sequences."""
    return Conversion(Path(data["path"]), converted=3, made=True)
''',
    "conf/data/mine.yaml": "name: mine\nsource: mine\npath: data/mine.h5\n",
    "tests/unit/test_mine.py": "",
}
TERM = {
    "src/drape/energy/terms/mine.py": '''\
"""The drag of still air."""

import torch

from drape.energy.term import EnergyTerm, Stencils


class Mine(EnergyTerm):
    """``c/2 Σ |x' - x|² / dt`` [J]."""

    name, stores = "mine", False

    def forward(self, x_next, step):
        return step.mesh.sum_vertices((x_next - step.x).square().sum(-1)) / (2 * step.dt)

    def stencils(self, x_next, step):
        vertices = torch.arange(len(x_next), device=x_next.device)[:, None]
        block = torch.eye(3).to(x_next)[None, None, :, None] / step.dt
        return [Stencils(vertices, block.expand(len(x_next), 1, 3, 1, 3))]
''',
    "src/drape/energy/incremental_potential.py": (
        Edit("    if contact is not None:", "    from drape.energy.terms.mine import Mine\n    terms.append(Mine())\n"),
        Edit("    match term:", '    if term.name == "mine":\n        return "there is air"\n'),
    ),
    "tests/terms.py": (
        Edit("from drape.energy.terms", "from drape.energy.terms.mine import Mine\n"),
        Edit('    "gravity": ', '    "mine": Member(Mine, exact=anywhere),\n'),
    ),
}
TABLE = {
    "src/drape/report/mine.py": '''\
"""Mine."""

from drape.report.table import Table
from drape.report.tables import label


def mine(found):
    """Who was trained for how long."""
    return Table("Steps of mine", ("configuration", "steps"), tuple((label(c), str(c.setting["steps"])) for c in found))
''',
    "conf/tables/laws.yaml": Edit("", "mine: {_target_: drape.report.mine.mine, _partial_: true}\n"),
    "sweeps/mine.yaml": "defaults: [train, _self_]\n",
    "tests/unit/test_mine.py": "",
}
FOLLOWED = {
    "A row of a table": ROW, "A metric": METRIC, "A data set": DATA, "An energy term": TERM, "A table": TABLE,
}  # fmt: skip
PROGRAMS = """
import runpy, sys
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
import numpy as np

def run(program, *words):
    GlobalHydra.instance().clear()
    HydraConfig.instance().cfg = None
    sys.argv = [program, *words]
    runpy.run_path(f"src/{program}.py", run_name="__main__")

training, folder = sys.argv[2:], sys.argv[1]
run("generate", "data=mine", f"hydra.run.dir={folder}/generate")
run("train", "model=mine", *training)
run("report", f"runs={folder}")

from drape.config import instantiate
from drape.config.compose import compose
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.scene_step import SceneSteps
scene = instantiate(compose("animate", "scene=hanging", "scene.resolution=4").scene)
potential = IncrementalPotential.for_scene(scene, [])
import torch
step = SceneSteps(scene, torch.zeros(5)).step(scene.initial, 0.0, 1.0)
print(potential.reasons["mine"], potential.evaluate(step.x + 0.1, step).terms["mine"] > 0)
"""


def recipes() -> dict[str, list[str]]:
    """By their titles, the files of docs/extending.md, each of which begins a line of a numbered list."""
    sections = re.split(r"^## ", (ROOT / "docs" / "extending.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {text.partition("\n")[0]: re.findall(r"^\d\. `([^`]+)`", text, re.MULTILINE) for text in sections}


@pytest.mark.parametrize("title", recipes())
def test_a_recipe_touches_few_files_and_those_that_are_there_are_there(title):
    files = recipes()[title]
    assert 2 <= len(files) <= MOST
    for file in files:
        place = Path(file.partition("<")[0])
        assert (ROOT / file).is_file() if "<" not in file else (ROOT / place.parent).is_dir(), file


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """The source with everything mine, file by file as the recipes name them."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("src", "conf", "sweeps", "tests"):
        left_out = shutil.ignore_patterns("__pycache__", "checkpoints", "results", "fixtures")
        shutil.copytree(ROOT / name, folder / name, ignore=left_out)
    shutil.copy(ROOT / "pyproject.toml", folder)
    (folder / "src" / "drape" / "checkpoints").symlink_to(ROOT / "src" / "drape" / "checkpoints")
    for title, files in FOLLOWED.items():
        named = [re.sub(r"<\w+>", MINE, file) for file in recipes()[title]]
        assert sorted(files) == sorted(named), title
        for name, content in files.items():
            write(folder / name, content)
    return folder


def write(path: Path, content: str | Edit | tuple[Edit, ...]) -> None:
    if isinstance(content, str):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
        return
    for edit in (content,) if isinstance(content, Edit) else content:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        starts = [k for k, line in enumerate(lines) if line.startswith(edit.before)] if edit.before else [len(lines)]
        lines.insert(starts[0], edit.new)
        path.write_text("".join(lines), encoding="utf-8")


def python(copy: Path, *words: str) -> subprocess.CompletedProcess:
    environment = os.environ | {"PYTHONPATH": f"{copy / 'src'}{os.pathsep}{copy}", "NUMBA_DISABLE_JIT": "1"}
    return subprocess.run(
        [sys.executable, *words], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_what_is_new_is_converted_trained_measured_and_reported(copy, data, tmp_path):
    done = python(copy, "-c", PROGRAMS, str(tmp_path), *small(data, tmp_path / "run", "scale.max_steps=1"))
    assert done.returncode == 0, done.stderr[-3000:]
    assert "mine.h5: 3 sequences; made" in done.stdout
    record = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert record["label"] == "Mine"
    assert 0 < record["metrics"]["fast_share/silk"] <= 1
    tables = (tmp_path / "report" / "tables.md").read_text(encoding="utf-8")
    assert re.search(r"### Fast\n.*\n\| Mine \| 1 \| [\d.]+ \|", tables, re.DOTALL)
    assert re.search(r"### Steps of mine\n.*\n\| Mine \| 1 \|", tables, re.DOTALL)
    assert "there is air True" in done.stdout


@pytest.mark.slow
def test_the_contracts_take_what_is_new_by_themselves(copy):
    contracts = [f"tests/contracts/test_{family}.py" for family in ("energy_terms", "metrics")]
    done = python(copy, "-m", "pytest", "-q", "-p", "no:cacheprovider", *contracts, "-k", MINE)
    assert done.returncode == 0, done.stdout[-3000:]
    assert int(re.search(r"(\d+) passed", done.stdout).group(1)) > 10
