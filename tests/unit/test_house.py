"""The habits of the house that a tool can check: lengths, words, docstrings, layers, nothing of one machine."""

from __future__ import annotations

import ast
import functools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
CONFIGS = sorted([*(ROOT / "conf").rglob("*.yaml"), *(ROOT / "sweeps").rglob("*.yaml")])
TEXTS = [
    *SOURCES,
    *CONFIGS,
    *sorted((ROOT / "tests").rglob("*.py")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "Makefile", "pyproject.toml", ".ci/run")),
]

LONGEST_FILE = 300
LONGEST_FUNCTION = 40
LONGEST_ENTRY_POINT = 60
"""One screen."""

QUESTIONS = ("What", "How", "Who", "Where", "Which", "Why")
"""Words that no docstring begins with: nobody searches for them."""

BANNED_WORDS = {
    "the potential": "the incremental potential, of a step; the elastic energy, of a law",
    "template": "rest state",
    "canonical": "rest state",
    "backbone": "name the network",
    "head": "decoder, or name what it gives",
    "neck": "name the network",
    "segmentor": "simulator",
    "criterion": "energy term or loss term",
    "criterions": "energy terms or loss terms",
    "potential_prior": "potential",
    "elenergy": "energy balance",
    "cmp": "contrastive",
    "f_connectivity": "edge_faces",
    "attr": "material, attributes",
    "dissipate": "dissipation",
    "dissipate_energy": "dissipation",
    "delta_inertia": "inertia",
    "x_arrow": "predicted positions",
    "h_state": "trajectory",
    "prevprev": "t-1",
    "env_cfg": "scene",
    "vel": "v, velocity",
    "runner": "simulator",
    "experiment_runner": "sweep",
}
"""Words of other fields, and what they are called here."""

OF_OTHER_LANGUAGES = r"\bjinja2\.Template\b|\.get_template\(|\"neck0\d\""
"""What Jinja calls a page, and anny two of its bones."""

BANNED_FILES = {"utils", "helpers", "helper", "common", "misc", "base", "tools"}


def where(path: Path) -> str:
    return str(path.relative_to(ROOT))


def matches(paths: list[Path], pattern: str) -> list[str]:
    """``file:line: text`` of every line that matches."""
    found = re.compile(pattern)
    return [
        f"{where(path)}:{number}: {line.strip()}"
        for path in paths
        if path.exists()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if found.search(line)
    ]


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def definitions(path: Path) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node


def test_there_is_a_house():
    assert len(SOURCES) > 20
    assert len(CONFIGS) > 5


def test_files_are_short():
    lengths = {where(path): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


def test_entry_points_fit_on_a_screen():
    lengths = {where(path): len(path.read_text(encoding="utf-8").splitlines()) for path in (ROOT / "src").glob("*.py")}
    assert {name: length for name, length in lengths.items() if length > LONGEST_ENTRY_POINT} == {}


def test_functions_are_short():
    """Docstrings do not count."""
    long = {}
    for path in SOURCES:
        for node in definitions(path):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                length = body[-1].end_lineno - body[0].lineno + 1 if body else 0
                if length > LONGEST_FUNCTION:
                    long[f"{where(path)}: {node.name}"] = length
    assert long == {}


def test_everything_public_has_a_docstring():
    """Modules, classes, functions; methods and entry points may be explained by their name and their module."""
    silent = []
    for path in SOURCES:
        module = parsed(path)
        if module.body and not ast.get_docstring(module):
            silent.append(where(path))
        for node in module.body:
            public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if public and node.name != "main" and path.parent != ROOT / "src" and not ast.get_docstring(node):
                silent.append(f"{where(path)}: {node.name}")
    assert silent == []


def test_docstrings_begin_with_a_noun_or_an_imperative():
    """Those of modules, classes and functions, and those below attributes."""
    asked = [
        f"{where(path)}:{text.lineno}: {text.value.value.strip().splitlines()[0]}"
        for path in SOURCES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef)
        for text in node.body
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
        if text.value.value.split(maxsplit=1)[0] in QUESTIONS
    ]
    assert asked == []


@pytest.mark.parametrize("word", BANNED_WORDS)
def test_words_of_other_fields_are_not_used(word):
    """Whole words, and parts of names between underscores."""
    pattern = rf"(?i)(?<![a-z:]){word}(?![a-z])"
    found = matches([*SOURCES, *CONFIGS], pattern)
    found = [line for line in found if re.search(pattern, re.sub(OF_OTHER_LANGUAGES, "", line.split(": ", 1)[1]))]
    found = [line for line in found if not re.search(r"^conf/[^:]*:\d+: template: ", line)]  # of Hydra's help
    assert found == [], f"say: {BANNED_WORDS[word]}"


def test_no_file_is_a_drawer():
    assert [where(path) for path in SOURCES if {path.stem, path.parent.name} & BANNED_FILES] == []


def test_user_errors_are_raised_not_asserted():
    asserts = [
        f"{where(path)}:{node.lineno}"
        for path in SOURCES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Assert)
    ]
    assert asserts == []


def test_no_exception_is_swallowed_bare():
    assert matches(SOURCES, r"except\s*:") == []


def test_nothing_belongs_to_one_machine():
    assert matches(TEXTS, r"(?<![\w.}$])/(work|farm|root|tmp|home|Users)/") == []


def test_no_pickle_is_read():
    assert matches(SOURCES, r"pickle\.load|weights_only=False|allow_pickle=True|import pickle") == []


def test_figures_leave_the_backend_of_a_notebook_alone():
    assert matches(SOURCES, r"pyplot|matplotlib\.use") == []


def test_documents_that_are_cited_are_in_the_repository():
    """Notes that a reader does not have are no source: a paper with its equation, or a section of docs/sources.md."""
    paths = [*TEXTS, *sorted((ROOT / "docs").glob("*.md")), ROOT / "CHANGELOG.md"]
    notes = rf"\b({'|'.join(('FACT' + 'S', 'FINDING' + 'S', 'DESIG' + 'N', 'STYL' + 'E'))})\b(\.md| \d)"
    assert matches(paths, notes) == []
    titles = re.findall(r"^## \d+\. (.+)$", (ROOT / "docs" / "sources.md").read_text(encoding="utf-8"), re.MULTILINE)
    for path in paths:
        for title in re.findall(r"docs/sources\.md,\s+([A-Z][^).:;,\"`]*)", path.read_text(encoding="utf-8")):
            assert " ".join(title.split()) in titles, f"{where(path)} cites docs/sources.md, {title}"


def test_nothing_is_unfinished():
    assert matches([*SOURCES, *CONFIGS], r"\b(TODO|FIXME|XXX|NotImplementedError)\b") == []


def test_blender_and_the_file_format_do_not_load_torch():
    light = ["blender", "config", "data.schema", "data.hdf5", "geometry.mesh", "geometry.grid"]
    code = f"import sys, {', '.join(f'drape.{name}' for name in light)}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], env=environment(), check=False).returncode == 0


def test_layers_are_kept():
    report = tool("importlinter.cli", "lint_imports_command")
    assert report.returncode == 0, report.stdout[-3000:]
    assert "0 broken" in report.stdout


def test_the_linter_is_content():
    report = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--no-cache", "--output-format", "concise", "src", "tests"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )
    assert report.returncode == 0, report.stdout[-3000:]


def test_names_in_annotations_are_there():
    """The linter and mypy are told to pass over names that are not there: shapes are such names. Types are not."""
    options = ["check", "--no-cache", "--isolated", "--select", "F821", "--output-format", "concise", "src"]
    command = [sys.executable, "-m", "ruff", *options]
    report = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    names = re.findall(r"F821 Undefined name `(\w+)`", report.stdout)
    assert names  # of shapes
    assert not [name for name in names if name[0].isupper()]


def tool(module: str, command: str) -> subprocess.CompletedProcess:
    """Run a command of a package in this interpreter, in the repository."""
    code = f"import sys; from {module} import {command}; sys.argv = ['tool']; sys.exit({command}())"
    return subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment(), capture_output=True, text=True, check=False
    )


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT / "src")}
