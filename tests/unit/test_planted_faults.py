"""The list of faults stays true: each stands at one place, in the code of a function, and its tests are there."""

from __future__ import annotations

from inspect import CO_OPTIMIZED
from pathlib import Path

import pytest

from tests.plant_faults import FOLDERS, SOURCE, codes, plant, planted

LISTS = [one for folder in FOLDERS for one in planted(folder)]


@pytest.mark.parametrize("one", LISTS, ids=lambda one: one.file)
def test_every_fault_changes_code_at_one_place(one):
    """Compared by what is compiled: a fault that changes nothing, or no Python, could not be noticed."""
    path = SOURCE / one.file
    text = path.read_text(encoding="utf-8")
    right = list(codes(compile(text, str(path), "exec")))
    for before, after in one.faults:
        assert text.count(before) == 1, f"{one.file}: {before!r} must stand there once; mend tests/faults"
        wrong = list(codes(compile(text.replace(before, after), str(path), "exec")))
        assert [code.co_qualname for code in wrong] == [code.co_qualname for code in right]
        changed = [other for one, other in zip(right, wrong, strict=True) if one != other]
        assert any(code.co_flags & CO_OPTIMIZED for code in changed), f"{before!r}: stands in no function"


def test_the_tests_that_are_named_are_there():
    """Twice as many faults as were promised at least, of every folder some."""
    missing = {name for one in LISTS for name in one.test_files if not Path(name).is_file()}
    assert missing == set()
    assert sum(len(one.faults) for one in LISTS) > 120
    assert {one.file.split("/")[0] for one in LISTS} == set(FOLDERS)


def test_a_fault_is_planted_in_functions_that_are_there(tmp_path):
    """Of a module that is loaded: the function of whoever has imported it changes, the file does not."""
    path = tmp_path / "adds.py"
    path.write_text("def add(a, b):\n    return a + b\n", encoding="utf-8")
    names: dict = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    add = names["add"]
    assert plant([add], path, "a + b", "a - b") == 1
    assert add(3, 1) == 2
    assert "a + b" in path.read_text(encoding="utf-8")
    with pytest.raises(SystemExit, match="found 'a / b' 0 times; expected once"):
        plant([add], path, "a / b", "a")
