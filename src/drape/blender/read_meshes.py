"""A process that reads meshes which only Blender opens: ``python -m drape.blender.read_meshes``.

A request has the ``path`` of a file, the npz file for ``arrays``, ``dt``, ``frames``, ``clip`` and the object that is
``wanted``; in the npz are then ``corners``, ``sizes``, ``positions`` (``frames vertices 3``) of all its meshes as one,
``uv`` and ``material``; the answer has what is no array. bpy and numpy only; no torch.
"""

from __future__ import annotations

import importlib.util
import itertools
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drape.blender.clips import chosen_clip, keyed
from drape.blender.process import serve
from drape.errors import DrapeError
from drape.reading.objects import chosen, said

CLOCK = 6000
"""Frames per second inside Blender: it rounds times of a file to frames; 24, 25, 30, 50, 60, 120, 240 divide this."""
RATES = (24, 25, 30, 48, 50, 60, 100, 120, 240)
"""Frame rates at which a file that counts in seconds may have been recorded [1/s]."""
OTHERWISE = 30
GLTF = (".glb", ".gltf")
PROBES = 12
"""Moments between frames at which a rate is tried."""


def main() -> None:
    serve(lambda: answer)


def answer(request: Mapping) -> dict:
    """Store the arrays of ``request["path"]`` in ``request["arrays"]``; what else there is to know.

    Raises:
        DrapeError: see :func:`read`; or Blender cannot open the file.
    """
    try:
        options = (request[name] for name in ("dt", "frames", "clip", "wanted"))
        arrays, rest = read(Path(request["path"]), *options)
    except RuntimeError as error:  # how Blender's operators fail
        raise DrapeError(f"Blender cannot open it ({str(error).strip()}); export it again") from error
    np.savez(request["arrays"], **arrays)
    return rest


def read(
    path: Path, dt: float | None, frames: int | None, clip: str | None, wanted: str | None = None
) -> tuple[dict[str, np.ndarray], dict]:
    """Polygons, positions in metres with +z up per frame, texture coordinates; frames per second and the first one.

    glTF and Alembic count in seconds: positions at ``k * dt`` from the first key on, k = 0..``frames`` or to the end;
    ``dt`` None is the rate of the keys, or of the samples, and frames as far as ``frames`` of :data:`OTHERWISE` or that
    rate go. FBX says its rate. USD counts in time codes, and Blender does not tell how many there are in a second: one
    frame a time code, no rate.

    Raises:
        DrapeError: no Blender, no mesh in the file, no object of the name ``wanted``, several clips, a topology that
            changes.
    """
    if importlib.util.find_spec("bpy") is None:
        raise DrapeError(
            "this kind of file is read by Blender, and Blender is not installed for this Python "
            f"({sys.version_info.major}.{sys.version_info.minor}, no module bpy); bpy 5.0.1 needs Python 3.11 exactly: "
            'python3.11 -m pip install -e ".[blender]"; or export it as OBJ, a body as a folder of OBJ files'
        )
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = CLOCK
    _open(bpy, path)
    things, told = _wanted(bpy, path, wanted)
    told += chosen_clip(bpy, path.suffix.lower(), clip) if frames != 0 else []
    first, last, clock = _range(bpy, path)
    rate = None if clock is None else (1.0 / dt if dt else _rate(bpy, path, things, (first, last, clock)))
    step = 1.0 if rate is None or clock is None else clock / rate
    count = int((last - first) / step + 1e-6) + 1
    number = min(count, _needed(frames, rate if dt is None else None) + 1) if rate or not frames else count
    arrays: dict[str, Any] = {}
    moments: list[np.ndarray] = []
    for frame in range(number):
        positions, found = _joined(bpy, things, first + frame * step)
        if arrays and not all(np.array_equal(found[name], arrays[name]) for name in ("corners", "sizes")):
            raise DrapeError(
                f"frame {frame}: found {len(positions)} vertices and {len(found['sizes'])} faces that are not those of "
                f"frame 0 ({len(moments[0])} and {len(arrays['sizes'])}); expected the same topology in every frame; "
                "export the body without changing its mesh"
            )
        arrays = arrays or found
        moments.append(positions)
    if number == 1 or (number > 1 and all(np.array_equal(moment, moments[0]) for moment in moments)):
        moments = moments[:1]  # it stands still
    materials = arrays.pop("names")
    start = int(first) if rate is None or clock is None else round(first / clock * rate)
    return arrays | {"positions": np.stack(moments)}, {
        "fps": None if rate is None else float(rate), "first": start, "materials": materials, "said": told,
    }  # fmt: skip


def _open(bpy, path: Path) -> None:
    kind, name = path.suffix.lower(), str(path)
    if kind in GLTF:
        bpy.ops.import_scene.gltf(filepath=name, merge_vertices=False, disable_bone_shape=True)
    elif kind == ".abc":
        bpy.ops.wm.alembic_import(filepath=name, set_frame_range=True, as_background_job=False)
    elif kind == ".fbx":
        bpy.ops.wm.fbx_import(filepath=name)
    else:
        bpy.ops.wm.usd_import(filepath=name, set_frame_range=True, merge_parent_xform=False)


def _wanted(bpy, path: Path, wanted: str | None) -> tuple[list, list[str]]:
    """The objects with meshes that are read, in the order of their names, and what there is to say about them."""
    things = sorted((thing for thing in bpy.context.scene.objects if thing.type == "MESH"), key=lambda each: each.name)
    paths = [_path(thing, path.suffix.lower().startswith(".usd")) for thing in things]
    return [things[number] for number in chosen(paths, wanted)], said(paths, wanted)


def _path(thing, numbered: bool) -> tuple[str, ...]:
    """Names of the objects above it and its own; ``numbered``: a dot and digits are Blender's, as USD allows none."""
    names: list[str] = []
    while thing:
        names.insert(0, re.sub(r"\.\d+$", "", thing.name) if numbered else thing.name)
        thing = thing.parent
    return tuple(names)


def _range(bpy, path: Path) -> tuple[float, float, float | None]:
    """First and last frame, and how many of these there are in a second; None for time codes."""
    scene, kind = bpy.context.scene, path.suffix.lower()
    if kind == ".abc":
        return scene.frame_start, scene.frame_end, CLOCK
    if kind not in (*GLTF, ".fbx"):
        return scene.frame_start, scene.frame_end, None
    clock = scene.render.fps / scene.render.fps_base
    ranges = [owner.animation_data.action.frame_range for owner in keyed(bpy) if owner.animation_data.action]
    return min((start for start, _ in ranges), default=0.0), max((end for _, end in ranges), default=0.0), clock


def _rate(bpy, path: Path, things: list, moments: tuple[float, float, float]) -> float:
    """Frames per second of what stands still or was not told a rate: of the keys, or between linear samples."""
    first, last, clock = moments
    if path.suffix.lower() == ".fbx":
        return clock
    if path.suffix.lower() in GLTF:
        return _rate_of_keys(bpy, clock)
    at = np.array([first, last])[:, None] / clock * RATES  # in frames of each rate
    fits = np.array(RATES)[(np.abs(at - np.round(at)) < 1e-3).all(axis=0)].tolist()
    for rate in fits if last > first else []:
        step = clock / rate
        count = round((last - first) / step)
        at = first + step * np.unique(np.linspace(0, count - 1, PROBES).astype(int))
        shares = (0, 0.5, 1)
        before, middle, after = (np.stack([_joined(bpy, things, t + s * step)[0] for t in at]) for s in shares)
        size = np.ptp(before.reshape(-1, 3), axis=0).max()
        if np.abs(0.5 * (before + after) - middle).max() < 1e-5 * size:
            return rate
    return OTHERWISE


def _rate_of_keys(bpy, clock: float) -> float:
    """Of the keys that are nearest to each other, if any rate has them."""
    strips = [strip for action in bpy.data.actions for layer in action.layers for strip in layer.strips]
    curves = [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]
    gaps = [np.diff(_of(curve.keyframe_points, "co", 2)[:, 0]) for curve in curves]
    every = np.concatenate(gaps) if gaps else np.zeros(0)
    nearest = every[every > 1e-3].min(initial=np.inf)
    return next((rate for rate in RATES if abs(clock / nearest - rate) < 0.01 * rate), OTHERWISE)


def _needed(frames: int | None, rate: float | None) -> int:
    """The last frame that a scene of so many can reach."""
    return sys.maxsize if frames is None else math.ceil(frames * max(1.0, (rate or OTHERWISE) / OTHERWISE))


def _joined(bpy, things: list, time: float) -> tuple[np.ndarray, dict]:
    """Positions in world space at a time, and polygons of all meshes of ``things``."""
    bpy.context.scene.frame_set(math.floor(time), subframe=time - math.floor(time))
    graph = bpy.context.evaluated_depsgraph_get()
    positions: list[np.ndarray] = []
    parts: dict[str, list[np.ndarray]] = {"corners": [], "sizes": [], "uv": [], "material": []}
    names: list[str] = []
    count = 0
    for thing in things:
        evaluated = thing.evaluated_get(graph)
        mesh = evaluated.to_mesh()
        world = np.array(evaluated.matrix_world, np.float64)
        positions.append(_of(mesh.vertices, "co", 3) @ world[:3, :3].T + world[:3, 3])
        parts["corners"].append(_of(mesh.loops, "vertex_index", 1, np.int32)[:, 0].astype(np.int64) + count)
        parts["sizes"].append(_of(mesh.polygons, "loop_total", 1, np.int32)[:, 0].astype(np.int64))
        layer = mesh.uv_layers.active
        parts["uv"].append(_of(layer.data, "uv", 2) if layer else np.full((len(mesh.loops), 2), np.nan))
        numbers = itertools.count(len(names))
        slots = [next(numbers) if m else -1 for m in mesh.materials] or [-1]
        names += [m.name for m in mesh.materials if m]
        index = _of(mesh.polygons, "material_index", 1, np.int32)[:, 0]
        parts["material"].append(np.array(slots)[np.minimum(index, len(slots) - 1)])
        count += len(mesh.vertices)
        evaluated.to_mesh_clear()
    if not positions or not sum(map(len, parts["sizes"])):
        raise DrapeError("found no mesh with faces; expected a mesh; export its faces, not curves or a skeleton")
    arrays = {name: np.concatenate(part) for name, part in parts.items()}
    if np.isnan(arrays["uv"]).all():
        del arrays["uv"]
    return np.concatenate(positions), arrays | {"names": names}


def _of(collection, name: str, width: int, dtype: type = np.float32) -> np.ndarray:
    found: np.ndarray = np.empty(len(collection) * width, dtype)
    collection.foreach_get(name, found)
    return found.reshape(-1, width).astype(np.float64 if dtype is np.float32 else dtype)


if __name__ == "__main__":
    main()
