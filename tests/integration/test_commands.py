"""The short commands of the documents, run as they stand there, on tiny scenes."""

from __future__ import annotations

import shlex

import pytest

from tests.commands import SHORT
from tests.integration.conftest import ROOT, in_process

SMALL = ["scene.frames=2", "output.render=none"]


@pytest.mark.parametrize("command", SHORT)
def test_a_command_of_the_documents_runs(command, monkeypatch, tmp_path):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    words = [word for word in shlex.split(command)[2:] if not word.startswith("folder=")]
    done = in_process("animate", *words, *SHORT[command], *SMALL, f"folder={tmp_path}/out")
    assert done.code == 0, done.err
    if "explain=true" in words:
        assert "inertia" in done.out
    else:
        assert (tmp_path / "out" / "animation.h5").is_file()
