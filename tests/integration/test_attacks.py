"""Samples of the attacks in tests/attack: a mistake is a sentence, and what is right is accepted."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.attack import files
from tests.attack.overrides import RIGHT, attack, overrides


def test_wrong_values_of_a_command_are_sentences():
    wrong = list(overrides())
    score = attack(wrong[::61])
    assert len(wrong) > 900
    assert score.tracebacks == []
    assert score.accepted == []


def test_right_values_of_a_command_are_accepted():
    score = attack(list(RIGHT[::5]))
    assert score.sentences == []
    assert score.tracebacks == []


FORGED = "table.npz: table with a bump"
"""With the digest recomputed, and away from the stored samples of the network."""


@pytest.mark.filterwarnings("ignore")
def test_damaged_files_are_sentences(tmp_path: Path):
    score = files.attack(tmp_path, every=13)
    assert len(score.sentences) > 100
    assert score.tracebacks == []
    assert [name for name in score.accepted if name != FORGED] == []
