"""Paths that are none, in every command: missing, a folder for a file, a file for a folder, another format, nothing.

``python -m tests.attack.paths`` prints what did not end in a sentence.
"""

from __future__ import annotations

import contextlib
import shlex
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.integration.conftest import in_process

MISSING, FOLDER, TEXT, NOTHING, INSIDE = "missing", "a folder", "a text", "''", "a text/inside"
FILE = (MISSING, FOLDER, TEXT, NOTHING, INSIDE)
"""Wrong for a file that is read."""
PLACE = (FOLDER, TEXT, INSIDE)
"""Wrong for a file that is written."""
ROOT = (MISSING, TEXT, NOTHING, INSIDE)
"""Wrong for a folder that is read."""
OUT = (TEXT, INSIDE)
"""Wrong for a folder that is written to."""
AREAL = "data.mass.areal_density=0.2"
HANGING = "scene=hanging scene.resolution=5 scene.frames=1 output.render=none"
PATHS: dict[str, dict[str, tuple[str, ...]]] = {
    "train scale=smoke": {"data.path": FILE},
    "train model=mgn scale=smoke": {"data.path": FILE},
    "bake": {"checkpoint": FILE, "path": PLACE},
    "evaluate": {"data.path": FILE},
    "evaluate simulator=neural": {"simulator.checkpoint": FILE},
    "animate": {"energy.table": FILE, "folder": OUT},
    f"animate {HANGING} energy=eunet": {"energy.checkpoint": FILE},
    f"animate {HANGING} energy=spring_hinge": {"energy.path": FILE},
    f"animate {HANGING} fabric=own": {"fabric.source": FILE},
    "animate scene=held_out": {"scene.path": FILE},
    "animate scene=garment": {"scene.path": FILE},
    "animate scene=custom scene.mass.areal_density=1": {"scene.mesh": FILE},
    "benchmark measure=held_out": {"measure.path": FILE},
    "benchmark measure=long_rollouts": {"measure.path": FILE, "measure.checkpoints": (f"[{MISSING}]", f"[{TEXT}]")},
    "benchmark measure=trained_laws": {"measure.runs": (f"[{MISSING}]", f"[{TEXT}]", "[]")},
    "report": {"runs": (MISSING, TEXT, NOTHING, INSIDE), "folder": OUT},
    f"generate data=recorded data.path=own.h5 {AREAL}": {"data.root": ROOT},
    "generate data=cloth3d data.path=own.h5": {"data.root": ROOT},
    "generate data=vto data.path=own.h5": {"data.root": ROOT},
    "generate data=tiny": {"data.path": PLACE},
}


class Score(NamedTuple):
    """What became of each command line."""

    sentences: list[str]
    tracebacks: list[str]
    accepted: list[str]


def lines() -> Iterator[str]:
    """Every command line."""
    for command, keys in PATHS.items():
        for key, values in keys.items():
            yield from (f"{command} {shlex.quote(f'{key}={value}')}" for value in values)


def attack(folder: Path, chosen: list[str]) -> Score:
    """Run each command line in ``folder``, which has ``a folder`` and ``a text``."""
    score = Score([], [], [])
    (folder / FOLDER).mkdir()
    (folder / TEXT).write_text("no such format\n" * 9)
    for line in chosen:
        name, *typed = shlex.split(line)
        out = [] if any(word.startswith("folder=") for word in typed) else [f"hydra.run.dir={folder}/run"]
        try:
            done = in_process(name, *typed, *out)
        except Exception as error:
            score.tracebacks.append(f"{line}: {type(error).__name__}: {str(error)[:200]}")
            continue
        is_sentence = done.code == 2 and "Traceback" not in done.err
        told = score.sentences if is_sentence else score.accepted if done.code == 0 else score.tracebacks
        told.append(f"{line}: {done.err.strip()[-300:]}")
    return score


def main() -> None:
    """Print the score."""
    every = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        score = attack(Path(folder), list(lines())[::every])
    for name in ("tracebacks", "accepted", "sentences"):
        print(f"--- {name}", *getattr(score, name), sep="\n")
    print(f"{len(score.sentences)} sentences, {len(score.tracebacks)} tracebacks, {len(score.accepted)} accepted")


if __name__ == "__main__":
    main()
