"""One sheet of cloth simulated by Blender. Imports bpy: run it in a process of its own (see worker)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import bpy
import numpy as np
from jaxtyping import Float, Int

CLOCK = 1000.0
"""Blender's cloth moves a free vertex by gravity / 1000 per frame², whatever the scene's frame rate.

Measured: docs/sources.md, Blender's clock.
"""


def simulate(
    rest_positions: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    pinned: Int[np.ndarray, " pinned"],
    settings: Mapping[str, float | int | str],
    start: Float[np.ndarray, "vertices 3"],
    acceleration: Float[np.ndarray, "steps 3"],
    fps: float,
) -> Float[np.ndarray, "steps+1 vertices 3"]:
    """Positions [m] at ``start`` (velocity 0) and after each of the steps of 1/``fps`` seconds.

    ``acceleration[k]`` [m/s²] acts from frame k to frame k + 1 on every vertex that is not pinned. One frame of
    Blender's cloth is one step; the scene's gravity is ``acceleration * 1000 / fps²`` so that gravity is right in
    metres and seconds. The rest shape is ``rest_positions``. No self-collision, no obstacle.
    """
    positions = np.empty((len(acceleration) + 1, len(rest_positions), 3), np.float32)
    for frame, x in enumerate(simulated_frames(rest_positions, faces, pinned, settings, start, acceleration, fps)):
        positions[frame] = x
    return positions


def simulated_frames(
    rest_positions: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    pinned: Int[np.ndarray, " pinned"],
    settings: Mapping[str, float | int | str],
    start: Float[np.ndarray, "vertices 3"],
    acceleration: Float[np.ndarray, "steps 3"],
    fps: float,
) -> Iterator[Float[np.ndarray, "vertices 3"]]:
    """The frames of :func:`simulate`, each simulated when it is asked for."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.use_gravity = True
    cloth = cloth_object(rest_positions, faces, pinned, start)
    modifier = cloth_modifier(cloth, settings, pinned, frames=len(acceleration) + 1)
    modifier.collision_settings.use_collision = False
    modifier.collision_settings.use_self_collision = False
    for frame in range(len(acceleration) + 1):
        if frame > 0:
            scene.gravity = acceleration[frame - 1] * CLOCK / fps**2
        scene.frame_set(frame + 1)
        yield read_positions(cloth)


def read_positions(simulated: bpy.types.Object) -> Float[np.ndarray, "vertices 3"]:
    """Positions of an object's vertices after its modifiers in the current frame [m]."""
    x = np.empty((len(simulated.data.vertices), 3), np.float32)
    evaluated = simulated.evaluated_get(bpy.context.evaluated_depsgraph_get())
    evaluated.data.vertices.foreach_get("co", x.reshape(-1))
    return x


def cloth_object(
    rest: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    pinned: Int[np.ndarray, " pinned"],
    start: Float[np.ndarray, "vertices 3"],
) -> bpy.types.Object:
    """A mesh at ``start``, linked into the scene, with the shape key ``rest`` and the vertex group ``pinned``."""
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata(rest.tolist(), [], faces.tolist())
    mesh.update()
    cloth = bpy.data.objects.new("cloth", mesh)
    bpy.context.scene.collection.objects.link(cloth)
    cloth.shape_key_add(name="basis", from_mix=False)  # the first key counts as none when it is the rest shape
    cloth.shape_key_add(name="rest", from_mix=False)
    pose = cloth.shape_key_add(name="start", from_mix=False)
    pose.data.foreach_set("co", np.ascontiguousarray(start, np.float32).reshape(-1))
    pose.value = 1.0
    if len(pinned):
        cloth.vertex_groups.new(name="pinned").add(pinned.tolist(), 1.0, "REPLACE")
    return cloth


def cloth_modifier(
    cloth: bpy.types.Object,
    settings: Mapping[str, float | int | str],
    pinned: Int[np.ndarray, " pinned"],
    frames: int,
) -> bpy.types.ClothModifier:
    """Make an object of :func:`cloth_object` a cloth, from frame 1 to ``frames``, with the rest shape ``rest``."""
    # Blender 5.0 hands the rest shape to the cloth only behind another modifier; this one moves nothing.
    cloth.modifiers.new("rest shape", "WEIGHTED_NORMAL")
    modifier = cloth.modifiers.new("cloth", "CLOTH")
    for name, value in settings.items():
        if name != "preset":
            setattr(modifier.settings, name, value)
    if len(pinned):
        modifier.settings.vertex_group_mass = "pinned"
    modifier.settings.rest_shape_key = cloth.data.shape_keys.key_blocks["rest"]
    modifier.point_cache.frame_start = 1
    modifier.point_cache.frame_end = frames
    return modifier
