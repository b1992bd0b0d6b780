"""Command lines as people mistype them: keys, units, words for numbers, lists, empty values, interpolations."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

KEYS = {
    "train": "scale.batch_size", "train model=mgn_s_eunet": "optimizer.lr", "animate": "scene.frames",
    "bake": "table.step", "evaluate": "simulator.iterations", "benchmark": "measure.repeats", "generate": "data.frames",
    "report": "page.height", "learn": "scale.max_steps",
}  # fmt: skip
"""By command line, a number that it has."""
NUMBERS = (
    "1m", "'5 mm'", "30fps", "1e-3.0", "1/30", "3%", "0x10", "'\"3\"'", "1e400", "-.inf", ".nan", "None",
    "off", "yes please", "1;2", "[3]", "[]", "{}", "3,4", "0,5", "range(1,3)", "choice(1,2)", "'${nowhere}'",
    "'${.nowhere}'", "'${oc.env:NO_SUCH_VARIABLE}'", "'${no_such_resolver:3}'", "'${'", "'${}'", "'${shipped:}'",
    "'${times:a,b}'", "'${times:3}'", "'${joined:nowhere}'", "'${estimates:nowhere.json}'", 
    "'${hydra:nowhere}'", "'${fabric_names:3}'", "''", "", "'???'", "null", "é", "!",
)  # fmt: skip
"""What is no such number."""
LISTS = {
    "animate": ("scene.gravity", "output.formats", "output.size"), "bake": ("table.stretch",),
    "benchmark measure=friction": ("measure.coefficients",), "report": ("seeds", "page.sequences"),
    "evaluate": ("kinds",), "train model=mgn_s_eunet": ("scale.simulator.contact_ramp",),
}  # fmt: skip
NO_LISTS = ("9.81", "'1 2 3'", "word", "(1,2,3)", "[1,2", "1,2,3", "[null]", "[[]]", "[{a: 1}]", "'${nowhere}'", "true")
FLAGS = {"train": "evaluate", "animate": "explain", "generate": "clips.render"}
NO_FLAGS = ("maybe", "1.5", "[]", "''", "3", "'\"true\"'")
GROUPS = {
    "train": "model", "animate": "scene", "bake": "fabric", "evaluate": "simulator", "benchmark": "measure",
    "generate": "data", "learn": "scale",
}  # fmt: skip
NO_OPTIONS = (
    "nowhere", "null", "''", "", "3", "true", "[]", "[nowhere]", "{a: 1}", "../train", "/etc/passwd", "a.yaml",
    "'${nowhere}'", "'a b'", "a,b", "é", "'???'",
)  # fmt: skip


def mistyped() -> Iterator[str]:
    """Every command line."""
    for command, key in KEYS.items():
        node, _, last = key.rpartition(".")
        inside = f"{node}." if node else ""
        swapped = f"{last[:-2]}{last[-1]}{last[-2]}"
        words = [f"{inside}{swapped}=3", f"{key}s=3", f"{key}.more=3", f"{inside}{last.upper()}=3"]
        words += [f"+{inside}more=3", f"+{key}=3", f"~{key}=7", f"~{inside}more", f"{key}", f"={key}", f"{key}:3", "="]
        words += [f".{key}=3", f"{key}.=3", f"{key}=3=4", f"{inside}=3", f"{key}@here=3", f"{key} 3", "3"]
        words += [f"{key}={value}" for value in ("'${" + key + "}'", "'${." + last + "}'", *NUMBERS)]
        yield from _lines(command, words)
    for lists, values in ((LISTS, NO_LISTS), ({command: (key,) for command, key in FLAGS.items()}, NO_FLAGS)):
        for command, keys in lists.items():
            yield from _lines(command, [f"{key}={value}" for key in keys for value in values])
    for command, group in GROUPS.items():
        yield from _lines(command, [f"{group}={value}" for value in NO_OPTIONS])


def _lines(command: str, words: list[str]) -> Iterator[str]:
    """Hydra takes the quotes of a value itself; those of the shell are around the word."""
    yield from (f"{command} {shlex.quote(word)}" for word in words)
