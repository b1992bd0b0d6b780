"""A process that simulates cloth on bodies: ``python -m drape.blender.cloth_on_body_worker``.

A request is the path of a file with the arguments of ``garment_cloth.simulated_frames`` (npz, ``settings`` and
``contact`` as JSON), and the path where the positions go (npy); the answer is the time that Blender took for each frame
after the first [s]. bpy and numpy only; no torch.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable

import numpy as np

from drape.blender.dressed_body import DressedBody
from drape.blender.process import serve


def main() -> None:
    def start() -> Callable[[list[str]], list[float]]:
        from drape.blender.garment_cloth import simulated_frames

        def handle(paths: list[str]) -> list[float]:
            with np.load(paths[0]) as file:
                stored = {name: file[name] for name in file.files}
            settings, contact = (json.loads(str(stored[name])) for name in ("settings", "contact"))
            dressed = _dressed(stored)
            fps = float(stored["fps"])
            frames, marks = [], []
            for x in simulated_frames(dressed, stored["start"], settings, contact, stored["gravity"], fps):
                frames.append(x)
                marks.append(time.perf_counter())
            np.save(paths[1], np.stack(frames))
            return np.diff(marks).tolist()

        return handle

    serve(start)


def _dressed(stored: dict[str, np.ndarray]) -> DressedBody:
    return DressedBody(
        rest_positions=stored["rest_positions"],
        faces=stored["faces"],
        pinned=stored["pinned"],
        pin_positions=stored["pin_positions"],
        body_faces=stored["body_faces"],
        body_positions=stored["body_positions"],
    )


if __name__ == "__main__":
    main()
