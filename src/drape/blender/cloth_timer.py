"""A process that simulates a cloth frame by frame: ``python -m drape.blender.cloth_timer <file.npz>``.

The file holds the arguments of ``cloth.simulated_frames``, ``settings`` as JSON. A request is the path of a file for
the positions of the next frame (npy); the answer is the time that Blender took for it [s]. bpy and numpy only; no
torch.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drape.blender.process import serve
from drape.errors import DrapeError


def main(path: Path) -> None:
    def start() -> Callable[[str], float]:
        from drape.blender.cloth import simulated_frames

        with np.load(path) as stored:
            arguments = {name: stored[name] for name in stored.files}
        settings, fps = json.loads(str(arguments.pop("settings"))), float(arguments.pop("fps"))
        frames = simulated_frames(**arguments, settings=settings, fps=fps)
        next(frames)  # the start

        def handle(target: str) -> float:
            began = time.perf_counter()
            x = next(frames, None)
            seconds = time.perf_counter() - began
            if x is None:
                raise DrapeError("there are no more frames")
            np.save(target, x)
            return seconds

        return handle

    serve(start)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
