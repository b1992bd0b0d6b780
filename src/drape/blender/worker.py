"""A process that simulates sequences: ``python -m drape.blender.worker <parts>``.

It reads sequence numbers from standard input, one a line, stores each finished sequence below ``<parts>`` and answers
with one JSON line: ``index`` and ``attempts``, or ``index``, ``error`` and ``errno``. It ends with its input, so it
never outlives the generator by more than one sequence. bpy and numpy only; no torch.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

from drape.blender.sequence import make_sequence, save_part
from drape.errors import DrapeError


def main(parts: Path) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # whatever Blender prints belongs to the log
    from drape.blender.cloth import simulate

    plan = json.loads((parts / "manifest.json").read_text(encoding="utf-8"))
    for line in sys.stdin:
        index = int(line)
        try:
            positions, attempts = make_sequence(index, plan, simulate)
            save_part(parts, index, positions, attempts)
            answer = {"index": index, "attempts": attempts}
        except (DrapeError, OSError) as error:
            answer = {"index": index, "error": str(error), "errno": getattr(error, "errno", None)}
        try:
            print(json.dumps(answer), file=answers)
        except BrokenPipeError:
            return


if __name__ == "__main__":
    main(Path(sys.argv[1]))
