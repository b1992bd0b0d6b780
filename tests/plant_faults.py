"""Plant faults in the program, one at a time, and count those that the tests notice.

    python tests/plant_faults.py                    all of tests/faults, and sweeps/results/planted_faults.md
    python tests/plant_faults.py loss metrics       those of two folders, printed only

Nothing is written to the source: all tests run once without a fault, then each fault is planted in the memory of a
forked process, in the code of the functions that it is in, and the test files of its folder run there until one fails.
So a fault costs its tests alone. Types and shapes of arguments, which every other test session checks, are not checked
here: that would notice some more.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")  # more threads would not outlive a fork
os.environ.setdefault("MKL_NUM_THREADS", "1")

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "drape"
RESULT = ROOT / "sweeps" / "results" / "planted_faults.md"
FOLDERS = ("loss", "training", "metrics", "data", "simulators", "energy", "contact", "geometry")
SECONDS = 120
"""After which tests count as failed: a fault may well keep a loop from ending."""
OPTIONS = ["-x", "-q", "-o", "addopts=", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore"]


class Planted(NamedTuple):
    """Faults of one file below ``src/drape``; each ``before`` is at one place in it."""

    file: str
    tests: str
    """Names of the test files that are run, those of its folder that concern it: ``unit/test_<name>.py``, or
    ``contracts/test_<name>.py`` behind an asterisk."""
    faults: list[tuple[str, str]]
    """(before, after)."""

    @property
    def test_files(self) -> list[str]:
        """Their paths."""
        names = [("contracts", name[1:]) if name.startswith("*") else ("unit", name) for name in self.tests.split()]
        return [str(ROOT / "tests" / folder / f"test_{name}.py") for folder, name in names]


class Row(NamedTuple):
    """What became of a fault."""

    file: str
    before: str
    after: str
    failed: str | None
    """The test that noticed; None: none did."""


def planted(folder: str) -> list[Planted]:
    """The faults of a folder of the program, as ``tests/faults/<folder>.txt`` lists them.

    A line that begins with ``=`` names a file and its tests; one that begins with ``-`` what stands there, the next
    one, with ``+``, what is planted instead. ``\\n`` is the end of a line.
    """
    found, before = [], ""
    for line in (ROOT / "tests" / "faults" / f"{folder}.txt").read_text(encoding="utf-8").splitlines():
        sign, text = line[:1], line[2:].replace("\\n", "\n")
        if sign == "=":
            found.append(Planted(*text.split(": "), []))
        elif sign == "-":
            before = text
        elif sign == "+":
            found[-1].faults.append((before, text))
    return found


def codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a module and of all functions in it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from codes(inner)


def functions() -> dict[str, list[FunctionType]]:
    """All functions of the program that there are, by their file."""
    found: dict[str, list[FunctionType]] = {}
    for each in gc.get_objects():
        if type(each) is FunctionType and each.__code__.co_filename.startswith(str(SOURCE)):
            found.setdefault(each.__code__.co_filename, []).append(each)
    return found


def plant(there: list[FunctionType], path: Path, before: str, after: str) -> int:
    """Put ``after`` in the place of ``before`` in the functions of a module; returns how many were changed.

    Raises:
        SystemExit: ``before`` is not at one place in the file.
    """
    text = path.read_text(encoding="utf-8")
    if text.count(before) != 1:
        raise SystemExit(f"{path}: found {before!r} {text.count(before)} times; expected once; mend tests/faults")
    right, wrong = (compile(one, str(path), "exec") for one in (text, text.replace(before, after)))
    pairs = {one.co_qualname: (one, other) for one, other in zip(codes(right), codes(wrong), strict=True)}
    changed = 0
    for function in there:
        one, other = pairs.get(function.__code__.co_qualname, (None, None))
        if one != other and one.co_freevars == function.__code__.co_freevars:
            function.__code__ = other
            changed += 1
    return changed


def noticed(there: list[FunctionType], one: Planted, before: str, after: str) -> str | None:
    """The test that fails with the fault, in a process of its own; None: none does."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _run(there, one, before, after, writing)
    os.close(writing)
    deadline = time.monotonic() + SECONDS
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return f"no end within {SECONDS} s"
        time.sleep(0.02)
    said = os.read(reading, 4096).decode()
    os.close(reading)
    return said or ("no end but a crash" if ended[1] else None)


def _run(there: list[FunctionType], one: Planted, before: str, after: str, writing: int) -> None:
    """In the child: plant, test, say what failed, and end."""
    said = []

    class First:
        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.failed:
                said.append(report.nodeid)

    try:
        if not plant(there, SOURCE / one.file, before, after):
            said.append("NOT PLANTED: no function has changed")
        else:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            code = pytest.main([*OPTIONS, *filter(os.path.exists, one.test_files)], plugins=[First()])
            said += [f"pytest ended with {code}"] if code and not said else []
    except BaseException as error:  # whatever happens here must not go on as the parent
        said.append(f"{type(error).__name__}: {error}")
    os.write(writing, "".join(said[:1]).encode()[:4000])
    os._exit(0)


def tried(there: list[FunctionType], one: Planted) -> Iterator[Row]:
    """Each fault of a file."""
    for before, after in one.faults:
        began = time.monotonic()
        row = Row(one.file, before, after, noticed(there, one, before, after))
        took = time.monotonic() - began
        word = "noticed " if row.failed else "SURVIVED"
        print(f"{word} {took:4.0f} s  {row.file}: {after!r}  {row.failed}", flush=True)
        if row.failed and row.failed.startswith("NOT PLANTED"):
            raise SystemExit(f"{row.file}: {before!r}: stands in no function; expected one")
        yield row


def document(found: dict[str, list[Row]]) -> str:
    """The score of each folder, and what survived."""
    counts = {folder: (len(rows), sum(row.failed is not None for row in rows)) for folder, rows in found.items()}
    counts["all"] = tuple(map(sum, zip(*counts.values(), strict=True)))
    lines = ["# Planted faults", "", "Which of the faults of `tests/faults/` the tests of their folder notice:", ""]
    lines += ["    PYTHONPATH=src python tests/plant_faults.py", ""]
    lines += ["| folder | faults | noticed | share |", "|---|---|---|---|"]
    lines += [f"| {folder} | {several} | {seen} | {seen / several:.0%} |" for folder, (several, seen) in counts.items()]
    silent = [row for rows in found.values() for row in rows if row.failed is None]
    lines += ["", "## Survivors", ""]
    lines += [f"* `{row.file}`: `{row.before.strip()}` became `{row.after.strip()}`" for row in silent] or ["None."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Plant all faults that are asked for."""
    folders = sys.argv[1:] or FOLDERS
    os.chdir(ROOT)
    lists = {folder: planted(folder) for folder in folders}
    tests = sorted({test for each in lists.values() for one in each for test in one.test_files if Path(test).exists()})
    if pytest.main([*OPTIONS, *tests]):
        raise SystemExit("tests: found one that fails without a fault; expected none")
    gc.unfreeze()  # the tests' own freeze hides the functions
    there = functions()
    gc.freeze()  # what is there already is not gone through by every child
    found: dict[str, list[Row]] = {folder: [] for folder in folders}
    for folder, each in lists.items():
        for one in each:
            found[folder] += tried(there[str(SOURCE / one.file)], one)
    text = document(found)
    print(text)
    if not sys.argv[1:]:
        RESULT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
