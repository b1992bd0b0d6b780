"""A process that simulates cloth on bodies: ``python -m drape.blender.cloth_on_body_worker``.

A request is the path of a file with the arguments of ``garment_cloth.simulate_garment`` (npz, ``settings`` and
``contact`` as JSON), and the path where the positions go (npy); the answer is empty. bpy and numpy only; no torch.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from drape.blender.dressed_body import DressedBody
from drape.blender.process import serve


def main() -> None:
    def start() -> Callable[[list[str]], None]:
        from drape.blender.garment_cloth import simulate_garment

        def handle(paths: list[str]) -> None:
            with np.load(paths[0]) as file:
                stored = {name: file[name] for name in file.files}
            settings, contact = (json.loads(str(stored[name])) for name in ("settings", "contact"))
            dressed = _dressed(stored)
            fps = float(stored["fps"])
            x = simulate_garment(dressed, stored["start"], settings, contact, stored["gravity"], fps)
            np.save(paths[1], x)

        return handle

    serve(start)


def _dressed(stored: dict[str, np.ndarray]) -> DressedBody:
    body = stored["body_positions"]
    return DressedBody(
        rest_positions=stored["rest_positions"],
        faces=stored["faces"],
        pinned=np.zeros(0, np.int64),
        pin_positions=np.zeros((len(body), 0, 3)),
        body_faces=stored["body_faces"],
        body_positions=body,
    )


if __name__ == "__main__":
    main()
