"""A stored animation as objects of a Blender scene. Imports bpy: run it in a process of its own (see output_worker)."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from jaxtyping import Float, Int

from drape.data.look import Look
from drape.reading.mesh_record import Polygons

Positions = Callable[[int], np.ndarray]
"""Positions [m] of a mesh by frame."""


def new_scene(frames: int, dt: float, first: int = 0) -> bpy.types.Scene:
    """An empty scene whose frame ``first`` + k is that of time ``k * dt``, k from 0 on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, first + frames - 1
    scene.render.fps = max(1, round(1.0 / dt))
    scene.render.fps_base = scene.render.fps * dt  # frames per second are fps / fps_base
    return scene


def mesh_object(
    name: str, positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> bpy.types.Object:
    """A mesh with smooth shading, linked into the scene."""
    return polygon_object(name, positions, Polygons.of_faces(faces))


def polygon_object(
    name: str, positions: Float[np.ndarray, "vertices 3"], polygons: Polygons, uv: np.ndarray | None = None
) -> bpy.types.Object:
    """The same of polygons, with texture coordinates of their corners."""
    mesh = bpy.data.meshes.new(name)
    faces = [part.tolist() for part in np.split(polygons.corners, polygons.starts[1:])]
    mesh.from_pydata(positions.tolist(), [], faces)
    mesh.shade_smooth()
    if uv is not None:
        layer = mesh.uv_layers.new(name="UVMap")
        layer.data.foreach_set("uv", np.nan_to_num(uv).astype(np.float32).reshape(-1))
    mesh.update()
    mesh_object = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(mesh_object)
    return mesh_object


def moved_objects(
    look: Look, move: Callable[[bpy.types.Object, Positions, int], None], as_read: bool = False
) -> list[bpy.types.Object]:
    """Cloth and body, as they are in frame 0; ``move(object, positions, frames)`` lets those move that do.

    ``as_read``: with the polygons, vertices and texture coordinates of the files they came from.
    """
    header, frames = look.file.header, look.file.num_frames
    obstacle = header.obstacle
    made = []
    parts = [("cloth", look.cloth, header.faces, False)]
    if obstacle is not None:
        parts.append(("body", look.body, obstacle.faces, obstacle.is_static))
    for (name, positions, faces, still), form in zip(parts, header.forms if as_read else (None, None), strict=False):
        if form is None:
            thing = mesh_object(name, positions(0), faces)
        else:
            positions = functools.partial(positions, form=form)
            thing = polygon_object(name, positions(0), form.polygons, form.uv)
        if not still:
            move(thing, positions, frames)
        made.append(thing)
    return made


def move_by_cache(folder: Path, first: int = 0) -> Callable[[bpy.types.Object, Positions, int], None]:
    """Let objects follow a point cache (PC2, float32), written below ``folder``, from the frame ``first`` on."""

    def move(moving: bpy.types.Object, positions: Positions, frames: int) -> None:
        path = folder / f"{moving.name}.pc2"
        with open(path, "wb") as file:
            vertices, every = len(moving.data.vertices), 1.0
            file.write(struct.pack("<12siiffi", b"POINTCACHE2\0", 1, vertices, first, every, frames))
            for frame in range(frames):
                file.write(positions(frame).astype("<f4").tobytes())
        cache = moving.modifiers.new("cache", "MESH_CACHE")
        cache.cache_format, cache.filepath, cache.frame_start = "PC2", str(path), float(first)
        cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"

    return move


def move_by_shape_keys(moving: bpy.types.Object, positions: Positions, frames: int) -> None:
    """One shape key for each frame after the first; one fades into the next, so that time between frames is linear."""
    first = bpy.context.scene.frame_start
    moving.shape_key_add(name="frame 0", from_mix=False)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    for frame in range(1, frames):
        key = moving.shape_key_add(name=f"frame {frame}", from_mix=False)
        key.data.foreach_set("co", np.ascontiguousarray(positions(frame), np.float32).reshape(-1))
        for time in range(frame - 1, min(frame + 2, frames)):
            key.value = float(time == frame)
            key.keyframe_insert("value", frame=first + time)
