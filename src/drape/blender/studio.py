"""Light, backdrop, materials and camera around an animated scene. Imports bpy (see output_worker)."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from jaxtyping import Float
from mathutils import Matrix

from drape.blender.animated_scene import mesh_object
from drape.scene.camera import Camera

BODY_COLOUR = (0.58, 0.58, 0.60)
BACKDROP_COLOUR = (0.86, 0.86, 0.87)
"""sRGB."""
BACK_SHADE = 0.6
"""Brightness of the back of the cloth, relative to its front."""
LIGHTS = {
    "key": ((-0.9, 0.6, 0.7), 0.6, 9.0),
    "fill": ((1.2, 0.1, 0.8), 1.6, 0.7),
    "rim": ((0.5, 1.0, -1.0), 0.8, 2.5),
}
"""Direction (right, up, towards the viewer), side, power [W/m²]; lengths in radii of the scene."""


def linear(colour: Sequence[float]) -> tuple[float, float, float, float]:
    """An sRGB colour as Blender takes it."""
    value = np.asarray(colour, float)
    return (*np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).tolist(), 1.0)


def material(name: str, colour: Sequence[float], roughness: float = 0.6) -> bpy.types.Material:
    """A plain surface of an sRGB colour."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    surface = made.node_tree.nodes["Principled BSDF"]
    surface.inputs["Base Color"].default_value = linear(colour)
    surface.inputs["Roughness"].default_value = roughness
    return made


def cloth_material(colour: Sequence[float]) -> bpy.types.Material:
    """Soft, with the sheen of fibres."""
    made = material("cloth", colour, roughness=0.75)
    made.use_backface_culling = False
    surface = made.node_tree.nodes["Principled BSDF"]
    surface.inputs["Specular IOR Level"].default_value = 0.25
    surface.inputs["Sheen Weight"].default_value = 0.35
    surface.inputs["Sheen Roughness"].default_value = 0.4
    return made


def shade_back(cloth: bpy.types.Material) -> None:
    """Make the back of the cloth darker than its front."""
    nodes, links = cloth.node_tree.nodes, cloth.node_tree.links
    surface, geometry, mix = nodes["Principled BSDF"], nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    front = np.array(surface.inputs["Base Color"].default_value)
    mix.inputs["A"].default_value = front
    mix.inputs["B"].default_value = (*(front[:3] * BACK_SHADE), 1.0)
    links.new(geometry.outputs["Backfacing"], mix.inputs["Factor"])
    links.new(mix.outputs["Result"], surface.inputs["Base Color"])


def build_studio(box: Float[np.ndarray, "2 3"], camera: Camera, hangs: bool) -> None:
    """Backdrop, lights and camera for a motion that stays in ``box`` (lowest and highest coordinates [m]).

    The floor is right below the box, or some way down if the cloth ``hangs`` in the air.
    """
    scene = bpy.context.scene
    centre, radius = box.mean(axis=0), 0.5 * float(np.linalg.norm(box[1] - box[0]))
    floor = np.array([centre[0], centre[1], box[0, 2] - (0.15 if hangs else 0.004) * radius])
    backdrop = _backdrop(floor, radius, camera)
    backdrop.data.materials.append(material("backdrop", BACKDROP_COLOUR, roughness=0.9))
    scene.world = bpy.data.worlds.new("studio")
    scene.world.use_nodes = True
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = linear((0.96, 0.97, 1.0))
    background.inputs["Strength"].default_value = 0.42
    for name, (direction, side, power) in LIGHTS.items():
        _light(name, centre, camera.axes @ np.array(direction), radius, side, power)
    _camera(camera)


def _backdrop(floor: np.ndarray, radius: float, camera: Camera) -> bpy.types.Object:
    """A floor that curves up into a wall behind the scene."""
    away = -camera.axes[:, 2] * [1.0, 1.0, 0.0]
    away /= np.linalg.norm(away)
    across = np.array([-away[1], away[0], 0.0])
    turn = np.linspace(0.0, np.pi / 2, 24)
    bend = np.column_stack([4.0 + 4.0 * np.sin(turn), 4.0 - 4.0 * np.cos(turn)])
    profile = radius * np.concatenate([[[-40.0, 0.0]], bend, [[8.0, 40.0]]])
    line = floor + profile @ np.stack([away, [0.0, 0.0, 1.0]])
    k, count = np.arange(len(profile) - 1), len(profile)
    a, b, c, d = k, k + 1, count + k + 1, count + k
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    side = 40.0 * radius * across
    return mesh_object("backdrop", np.concatenate([line - side, line + side]), faces)


def _light(name: str, centre: np.ndarray, direction: np.ndarray, radius: float, side: float, power: float) -> None:
    """A square lamp at three radii that shines at the centre."""
    lamp = bpy.data.lights.new(name, "AREA")
    lamp.size, lamp.energy = 2.0 * side * radius, power * 9.0 * radius**2
    lamp_object = bpy.data.objects.new(name, lamp)
    towards = direction / np.linalg.norm(direction)
    _place(lamp_object, centre + 3.0 * radius * towards, _facing(towards))
    bpy.context.scene.collection.objects.link(lamp_object)


def _facing(back: np.ndarray) -> np.ndarray:
    """Axes (columns) of an object that looks along ``-back``."""
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back], axis=1)


def _camera(camera: Camera) -> None:
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit = "HORIZONTAL"
    lens.angle = 2.0 * float(np.arctan(camera.half_angles[0]))
    lens.clip_start, lens.clip_end = 1e-3, 1e6
    viewer = bpy.data.objects.new("camera", lens)
    _place(viewer, camera.position, camera.axes)
    bpy.context.scene.collection.objects.link(viewer)
    bpy.context.scene.camera = viewer


def _place(placed: bpy.types.Object, position: np.ndarray, axes: np.ndarray) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, position
    placed.matrix_world = Matrix(matrix.tolist())
