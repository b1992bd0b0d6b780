"""The command ``drape``: ``drape train model=eunet`` is ``python src/train.py model=eunet``."""

from __future__ import annotations

import ast
import difflib
import runpy
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent
PROGRAMS = PACKAGE / "programs" if (PACKAGE / "programs").is_dir() else PACKAGE.parent
"""The folder of the entry points: ``src`` of a checkout, inside the package where that was installed from a wheel."""


def main() -> None:
    """Run the entry point that is named first, with the rest of the command line; exit status 2 where there is none."""
    paths = {path.stem: path for path in sorted(PROGRAMS.glob("*.py")) if path.stem != "__init__"}
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name in ("-h", "--help"):
        print(_help(paths))
        return
    if name not in paths:
        near = difflib.get_close_matches(name, paths, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        print(f"error: drape {name}: found no such command; expected one of {', '.join(paths)}{hint}", file=sys.stderr)
        sys.exit(2)
    sys.argv = [f"drape {name}", *sys.argv[2:]]
    runpy.run_path(str(paths[name]), run_name="__main__")


def _help(paths: dict[str, Path]) -> str:
    lines = ["Learn the law of a fabric, and animate garments with it.", ""]
    for name, path in paths.items():
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        lines.append(f"  drape {name:<11}{text.partition(': ``')[0]}")
    return "\n".join([*lines, "", HELP])


HELP = "drape <command> --help says more. Settings are key=value, as in: drape animate scene=sphere fabric=cotton"


if __name__ == "__main__":
    main()
