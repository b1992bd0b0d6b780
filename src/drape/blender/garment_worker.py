"""A process that simulates sequences of garments: ``python -m drape.blender.garment_worker <parts>``.

A request is the number of a sequence; it is stored below ``<parts>``, and the answer is the number of attempts.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from drape.blender.garment_part import save_garment_part
from drape.blender.garment_people import people_of
from drape.blender.garment_sequence import make_garment_sequence
from drape.blender.process import serve
from drape.errors import DrapeError


def main(parts: Path) -> None:
    def start() -> Callable[[int], int]:
        from drape.blender.crossing_faces import crossing_faces
        from drape.blender.garment_cloth import simulate_garment

        manifest = parts / "manifest.json"
        plan = json.loads(manifest.read_text(encoding="utf-8"))

        def handle(index: int) -> int:
            part = make_garment_sequence(index, plan, simulate_garment, crossing_faces, people_of(parts))
            # A worker outlives a killed generator by one sequence; the folder may be another plan's by then.
            if json.loads(manifest.read_text(encoding="utf-8")) != plan:
                raise DrapeError(f"{parts}: belongs to another plan now; run the command again")
            save_garment_part(parts, index, part)
            return part.sequence.attempts

        return handle

    serve(start)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
