"""A process that exports and renders one animation: ``python -m drape.blender.output_worker <file.h5> <folder>``.

Requests: ``{"export": path}``, ``{"frame": k, "picture": path, "samples": n, "size": [w, h]}``,
``{"film": path, "pictures": [path, …], "dt": seconds}``. ``<folder>`` is for temporary files. bpy and numpy only; no
torch.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from drape.blender.process import serve
from drape.data.animation_hdf5 import AnimationFile
from drape.data.look import Look


def main(path: Path, folder: Path) -> None:
    def start() -> Callable[[dict], None]:
        from drape.blender.export import export_animation
        from drape.blender.render import Pictures, film

        look = Look(AnimationFile(path))
        studio: list[Pictures] = []

        def handle(request: dict) -> None:
            if "export" in request:
                export_animation(look, Path(request["export"]), folder)
            elif "film" in request:
                film([Path(picture) for picture in request["pictures"]], request["dt"], Path(request["film"]))
            else:
                if not studio:
                    studio.append(Pictures(look, request["samples"], request["size"], folder))
                studio[0].take(request["frame"], Path(request["picture"]))

        return handle

    serve(start)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
