"""A process that simulates sequences: ``python -m drape.blender.worker <parts>``.

A request is the number of a sequence; it is stored below ``<parts>``, and the answer is the number of attempts. bpy and
numpy only; no torch.
"""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from drape.blender.part import save_part
from drape.blender.plan import has_bodies
from drape.blender.process import serve
from drape.blender.sequence import Draw, make_sequence
from drape.errors import DrapeError


def main(parts: Path) -> None:
    def start() -> Callable[[int], int]:
        manifest = parts / "manifest.json"
        plan = json.loads(manifest.read_text(encoding="utf-8"))
        draw = _draw(plan, parts)

        def handle(index: int) -> int:
            part = make_sequence(index, plan, draw)
            # A worker outlives a killed generator by one sequence; the folder may be another plan's by then.
            if json.loads(manifest.read_text(encoding="utf-8")) != plan:
                raise DrapeError(f"{parts}: belongs to another plan now; run the command again")
            save_part(parts, index, part)
            return part.sequence.attempts

        return handle

    serve(start)


def _draw(plan: Mapping, parts: Path) -> Draw:
    """Drawer of the sequences of a plan; imports bpy, and of the rest what they need."""
    if not has_bodies(plan["data"]):
        from drape.blender.cloth import simulate
        from drape.blender.sheet_sequence import DrawnSheet

        return functools.partial(DrawnSheet, simulate=simulate)
    from drape.blender.crossing_faces import crossing_faces
    from drape.blender.garment_cloth import simulate_garment
    from drape.blender.garment_people import people_of
    from drape.blender.garment_sequence import DrawnGarment

    return functools.partial(
        DrawnGarment, simulate=simulate_garment, crossing=crossing_faces, people=people_of(parts)
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
