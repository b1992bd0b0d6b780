"""A process that reads an animated body: ``python -m drape.blender.read_animation``.

A request has the ``path`` of a GLB, glTF, Alembic or USD file, the npz file for ``arrays``, ``dt`` and ``frames``; in
the npz are then ``faces`` and ``positions`` (``frames vertices 3``) of all meshes as one, and the answer is the number
of frames per second, null where Blender does not tell. bpy and numpy only; no torch.
"""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drape.blender.process import serve
from drape.errors import DrapeError

CLOCK = 6000
"""Frames per second inside Blender: it rounds times of a file to frames; 24, 25, 30, 50, 60, 120, 240 divide this."""
GLTF = (".glb", ".gltf")


def main() -> None:
    serve(lambda: answer)


def answer(request: Mapping) -> float | None:
    """Store the arrays of ``request["path"]`` in ``request["arrays"]``; frames per second.

    Raises:
        DrapeError: see :func:`read`; or Blender cannot open the file.
    """
    try:
        faces, positions, fps = read(Path(request["path"]), request["dt"], request["frames"])
    except RuntimeError as error:  # how Blender's operators fail
        raise DrapeError(f"Blender cannot open it ({str(error).strip()}); export the body again") from error
    np.savez(request["arrays"], faces=faces, positions=positions)
    return fps


def read(path: Path, dt: float, frames: int) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Faces, positions in metres with +z up per frame, and frames per second.

    glTF and Alembic count in seconds: positions at ``k * dt`` from the first key on, k = 0..``frames`` or to the end.
    USD counts in time codes, and Blender does not tell how many there are in a second: one frame a time code.

    Raises:
        DrapeError: no Blender, no mesh in the file, a topology that changes.
    """
    if importlib.util.find_spec("bpy") is None:
        raise DrapeError(
            "this kind of file is read by Blender, and Blender is not installed for this Python "
            f"({sys.version_info.major}.{sys.version_info.minor}, no module bpy); bpy 5.0.1 needs Python 3.11 exactly: "
            'python3.11 -m pip install -e ".[blender]"; or export the body as a folder of OBJ files'
        )
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = CLOCK
    fps = _open(bpy, path, dt)
    first, last = _range(bpy, path)
    step = 1.0 if fps is None else dt * CLOCK
    count = int((last - first) / step + 1e-6) + 1
    faces, moments = None, []
    for frame in range(count if fps is None else min(count, frames + 1)):
        whole = math.floor(first + frame * step)
        bpy.context.scene.frame_set(whole, subframe=first + frame * step - whole)
        positions, found = _joined(bpy)
        if faces is not None and not np.array_equal(found, faces):
            raise DrapeError(
                f"frame {frame}: found {len(positions)} vertices and {len(found)} triangles that are not those of "
                f"frame 0 ({len(moments[0])} and {len(faces)}); expected the same topology in every frame; export the "
                "body without changing its mesh"
            )
        faces = found if faces is None else faces
        moments.append(positions)
    if count == 1 or (count > frames and all(np.array_equal(moment, moments[0]) for moment in moments)):
        moments = moments[:1]  # it stands still
    return faces, np.stack(moments), fps


def _open(bpy, path: Path, dt: float) -> float | None:
    """Import the file; frames per second at which :func:`read` will sample it."""
    kind = path.suffix.lower()
    if kind in GLTF:
        bpy.ops.import_scene.gltf(filepath=str(path), merge_vertices=True)
    elif kind == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(path), set_frame_range=True, as_background_job=False)
    else:
        bpy.ops.wm.usd_import(filepath=str(path), set_frame_range=True)
        return None
    return 1.0 / dt


def _range(bpy, path: Path) -> tuple[float, float]:
    """First and last frame; Blender sets the scene's range from Alembic and USD, but not from glTF."""
    if path.suffix.lower() not in GLTF:
        return bpy.context.scene.frame_start, bpy.context.scene.frame_end
    keys = [thing.data.shape_keys for thing in bpy.data.objects if thing.type == "MESH" and thing.data.shape_keys]
    playing = [owner.animation_data for owner in [*bpy.data.objects, *keys] if owner.animation_data]
    ranges = [data.action.frame_range for data in playing if data.action]
    return min((start for start, _ in ranges), default=0.0), max((end for _, end in ranges), default=0.0)


def _joined(bpy) -> tuple[np.ndarray, np.ndarray]:
    """Positions in world space and triangles of all meshes at the current frame."""
    graph = bpy.context.evaluated_depsgraph_get()
    positions, triangles, count = [], [], 0
    for thing in sorted(bpy.context.scene.objects, key=lambda thing: thing.name):
        if thing.type != "MESH" or _is_bone_shape(bpy, thing):
            continue
        evaluated = thing.evaluated_get(graph)
        mesh = evaluated.to_mesh()
        local = np.empty((len(mesh.vertices), 3), np.float32)
        mesh.vertices.foreach_get("co", local.reshape(-1))
        mesh.calc_loop_triangles()
        corners = np.empty((len(mesh.loop_triangles), 3), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners.reshape(-1))
        world = np.array(evaluated.matrix_world, np.float64)
        positions.append(local @ world[:3, :3].T + world[:3, 3])
        triangles.append(corners.astype(np.int64) + count)
        count += len(local)
        evaluated.to_mesh_clear()
    if not triangles or not sum(map(len, triangles)):
        raise DrapeError("found no mesh with faces; expected an animated body; export its meshes")
    return np.concatenate(positions), np.concatenate(triangles)


def _is_bone_shape(bpy, thing) -> bool:
    """The glTF importer draws bones with a mesh of its own, which is no part of the body."""
    armatures = [other for other in bpy.data.objects if other.type == "ARMATURE"]
    return any(bone.custom_shape == thing for armature in armatures for bone in armature.pose.bones)


if __name__ == "__main__":
    main()
