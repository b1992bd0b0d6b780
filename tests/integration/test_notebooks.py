"""The notebooks as a newcomer runs them, on a small run: they finish, they draw, and nothing of it is stored."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.integration.conftest import ROOT, trained

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
FIGURES = {"01_energy_unit": 5}
"""How many figures a notebook shows for a model with dissipation."""


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def execute(path: Path) -> nbformat.NotebookNode:
    """The notebook after all its cells, run where Jupyter runs it; the file stays as it is."""
    notebook = read(path)
    where = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=800, kernel_name="python3", resources=where).execute()
    return notebook


def pictures(notebook: nbformat.NotebookNode) -> list[str]:
    """All PNG outputs, base64."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return [output.data["image/png"] for output in outputs if "image/png" in output.get("data", {})]


@pytest.fixture(scope="module", params=["eunet", "eunet_hinge"])
def run(request, data, tmp_path_factory) -> Path:
    """A finished training of a few steps, of a model that sees twist and bend and of one on hinges."""
    folder = tmp_path_factory.mktemp("run")
    done = trained(data, folder, f"model={request.param}", "scale.max_steps=4", "scale.validation_steps=4")
    assert done.code == 0, done.err
    return folder


def test_every_notebook_is_expected():
    assert {path.stem for path in NOTEBOOKS} == set(FIGURES)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_finishes_and_draws(path, run, monkeypatch):
    """Every figure is there and none is blank."""
    monkeypatch.setenv("DRAPE_RUN", str(run))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    found = pictures(execute(path))
    assert len(found) == FIGURES[path.stem]
    assert all(len(picture) > 10_000 for picture in found)
    assert len(set(found)) == len(found)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path):
    cells = [cell for cell in read(path).cells if cell.cell_type == "code"]
    assert cells
    assert [cell.id for cell in cells if cell.outputs or cell.execution_count is not None] == []
