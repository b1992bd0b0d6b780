"""The commands of the documents: their words as a shell splits them, what is said of them, what Hydra composes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hydra import compose
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig

from drape.config.entry_point import CONF
from tests.composing import composing

ROOT = Path(__file__).parents[1]
DOCUMENTS = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md")), *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```[a-z]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
PROGRAM = re.compile(r"\s*(?:(?:python )?(?:src/)?([a-z]+)\.py|drape ([a-z]+))(?= |$)")
COMMENT = re.compile(r"(?:^|\s)#\s*(.*)$")
TIME = re.compile(r"\b(an?|\d+) (seconds|minutes?|hours?)\b|\((minutes|hours)\)")
"""What a document says of a command that takes long."""
SHORT = {
    "python src/animate.py": ["scene.resolution=6"],
    "python src/animate.py scene=cusick fabric=denim": ["scene.rings=4"],
    "python src/animate.py scene=flag explain=true": ["scene.resolution=[6,4]"],
    "python src/animate.py simulator.iterations=50 folder=runs/fast": ["scene.resolution=6"],
    "python src/animate.py simulator.steps=2 folder=runs/fine": ["scene.resolution=6"],
    "python src/animate.py scene=hanging energy=eunet": ["scene.resolution=6"],
}
"""Commands that the tests run, and what makes each of them small; all others say how long they take."""


class Command(NamedTuple):
    """``python src/<program>.py arguments`` of a document."""

    document: str
    program: str
    arguments: tuple[str, ...]
    comment: str
    """What stands behind it in a fenced block."""
    is_fenced: bool

    def __str__(self) -> str:
        return shlex.join(["python", f"src/{self.program}.py", *self.arguments])


def commands(document: Path) -> Iterator[Command]:
    """All commands of a document that name a program of this project, in fenced blocks and between backticks."""
    text = document.read_text(encoding="utf-8")
    for block in FENCE.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            comment = COMMENT.search(line)
            yield from _commands(document, line, comment.group(1) if comment else "", True)
    for span in INLINE.findall(FENCE.sub("", text)):
        yield from _commands(document, " ".join(span.split()), "", False)


def _commands(document: Path, line: str, comment: str, is_fenced: bool) -> Iterator[Command]:
    for part in line.split(" && "):
        found = PROGRAM.match(part)
        name = found and (found[1] or found[2])
        if name and (ROOT / "src" / f"{name}.py").is_file():
            words = shlex.split(part[found.end() :], comments=True)
            yield Command(document.name, name, tuple(word for word in words if word != "..."), comment, is_fenced)


def configs(command: Command) -> Iterator[DictConfig]:
    """What a command composes; of a multirun so many runs that every value of every choice is in one."""
    given = get_args_parser().parse_args(list(command.arguments))
    folder = ROOT / given.config_dir if given.config_dir else CONF
    page, words = given.config_name or command.program, list(given.overrides)
    found_in = [] if folder == CONF else [f"hydra.searchpath=[file://{CONF}]"]
    with composing(folder):
        if found_in:
            sweeper = compose(page, found_in, return_hydra_config=True).hydra.sweeper
            words = [f"{key}={value}" for key, value in (sweeper.get("params") or {}).items()] + words
        choices = [list(_values(override)) for override in OverridesParser.create().parse_overrides(words)]
        for k in range(max(map(len, choices), default=1)):
            yield compose(page, [*found_in, *(values[k % len(values)] for values in choices)])


def _values(override: Override) -> Iterator[str]:
    """An override for each value of a choice; itself where it is none."""
    if not override.is_sweep_override():
        yield override.input_line
        return
    for value in override.sweep_string_iterator():
        yield f"{override.get_key_element()}={value}"
