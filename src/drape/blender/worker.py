"""A process that simulates sequences: ``python -m drape.blender.worker <parts>``.

A request is the number of a sequence; it is stored below ``<parts>``, and the answer is the number of attempts. bpy and
numpy only; no torch.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from drape.blender.process import serve
from drape.blender.sequence import make_sequence, save_part


def main(parts: Path) -> None:
    def start() -> Callable[[int], int]:
        from drape.blender.cloth import simulate

        plan = json.loads((parts / "manifest.json").read_text(encoding="utf-8"))

        def handle(index: int) -> int:
            positions, attempts = make_sequence(index, plan, simulate)
            save_part(parts, index, positions, attempts)
            return attempts

        return handle

    serve(start)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
