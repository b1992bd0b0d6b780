"""Samples of the attacks in tests/attack: a mistake is a sentence, and what is right is accepted."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.attack import files, paths
from tests.attack.overrides import RIGHT, attack, overrides


def test_wrong_values_of_a_command_are_sentences():
    wrong = list(overrides())
    score = attack(wrong[::61])
    assert len(wrong) > 1700
    assert score.tracebacks == []
    assert score.accepted == []


def test_right_values_of_a_command_are_accepted():
    score = attack(list(RIGHT[::5]))
    assert score.sentences == []
    assert score.tracebacks == []


def test_paths_that_are_none_are_sentences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    score = paths.attack(tmp_path, list(paths.lines())[::9])
    assert len(score.sentences) > 10
    assert score.tracebacks == []
    assert score.accepted == []


@pytest.mark.filterwarnings("ignore")
def test_damaged_files_are_sentences(tmp_path: Path):
    score = files.attack(tmp_path, every=13)
    assert len(score.sentences) > 100
    assert score.tracebacks == []
    assert score.accepted == []
