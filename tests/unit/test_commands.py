"""Every command of the documents: it composes, the files that it names are there, and a long one says how long."""

from __future__ import annotations

import importlib.util
import re

import pytest
from hydra.errors import HydraException

from drape.config import check_config
from drape.errors import DrapeError
from tests.commands import DOCUMENTS, FENCE, ROOT, SHORT, TIME, Command, commands, configs

ALL = {str(command): command for page in DOCUMENTS for command in commands(page) if "<" not in str(command)}
"""Without those that leave a word to the reader, as in ``model=<row>``."""


@pytest.mark.parametrize("command", ALL.values(), ids=ALL)
def test_a_command_of_the_documents_composes(command: Command):
    for config in configs(command):
        check_config(config, contents=command.program)


def test_a_word_that_there_is_not_is_found():
    """Groups, options, keys and values, also in a multirun."""
    for words in ("model=eunet_hing", "modl=eunet", "seeed=1", "seed=one", "-m seed=0,1 scale=cpu,x"):
        command = Command("x.md", "train", tuple(words.split()), "", True)
        with pytest.raises((DrapeError, HydraException)):
            test_a_command_of_the_documents_composes(command)


def test_every_command_is_run_by_a_test_or_says_how_long_it_takes():
    fenced = [command for page in DOCUMENTS for command in commands(page) if command.is_fenced]
    assert len(fenced) > 50
    assert [str(each) for each in fenced if str(each) not in SHORT and not TIME.search(each.comment)] == []
    assert set(SHORT) <= set(map(str, fenced)), "a command that is no longer in the documents"


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.name)
def test_scripts_modules_and_targets_are_there(page):
    blocks = "\n".join(FENCE.findall(page.read_text(encoding="utf-8")))
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for script in re.findall(r"python (\S+\.py)", blocks):
        assert (ROOT / script).is_file(), script
    for module in re.findall(r"python -m ((?:drape|tests)\S*)", blocks):
        assert importlib.util.find_spec(module), module
    for target in re.findall(r"^make (\w+)", blocks, re.MULTILINE):
        assert f"\n{target}:" in makefile, target
