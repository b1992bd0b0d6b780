"""A stored animation as objects of a Blender scene. Imports bpy: run it in a process of its own (see output_worker)."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from jaxtyping import Float, Int

from drape.data.look import Look

Positions = Callable[[int], np.ndarray]
"""Positions [m] of a mesh by frame."""


def new_scene(frames: int, dt: float) -> bpy.types.Scene:
    """An empty scene whose frame k is at time ``k * dt``, k from 0 on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 0, frames - 1
    scene.render.fps = max(1, round(1.0 / dt))
    scene.render.fps_base = scene.render.fps * dt  # frames per second are fps / fps_base
    return scene


def mesh_object(
    name: str, positions: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> bpy.types.Object:
    """A mesh with smooth shading, linked into the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(positions.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    mesh.update()
    mesh_object = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(mesh_object)
    return mesh_object


def moved_objects(look: Look, move: Callable[[bpy.types.Object, Positions, int], None]) -> list[bpy.types.Object]:
    """Cloth and body, as they are in frame 0; ``move(object, positions, frames)`` lets those move that do."""
    header, frames = look.file.header, look.file.num_frames
    cloth = mesh_object("cloth", look.cloth(0), header.faces)
    move(cloth, look.cloth, frames)
    if not look.has_body:
        return [cloth]
    body = mesh_object("body", look.body(0), header.obstacle.faces)
    if not header.obstacle.is_static:
        move(body, look.body, frames)
    return [cloth, body]


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
    moving.shape_key_add(name="frame 0", from_mix=False)
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    for frame in range(1, frames):
        key = moving.shape_key_add(name=f"frame {frame}", from_mix=False)
        key.data.foreach_set("co", np.ascontiguousarray(positions(frame), np.float32).reshape(-1))
        for time in range(frame - 1, min(frame + 2, frames)):
            key.value = float(time == frame)
            key.keyframe_insert("value", frame=time)
