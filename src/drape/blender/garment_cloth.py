"""A garment on a moving body, simulated by Blender. Imports bpy: run it in a process of its own (see worker).

It has what a sheet has (cloth), and is led and touched: a body that moves by a point cache, contact, pins that are led.
A sheet has none of them, and is pushed by another acceleration in every frame; so each has its own loop over frames.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from jaxtyping import Float

from drape.blender.animated_scene import mesh_object, move_by_cache
from drape.blender.cloth import CLOCK, cloth_modifier, cloth_object, read_positions
from drape.blender.dressed_body import DressedBody
from drape.data.blender_friction import blender_number

FIRST = 1
"""Blender's cloth is right only if its frames are visited from this one on and none is left out."""


def simulate_garment(*arguments: Any) -> Float[np.ndarray, "frames vertices 3"]:
    """All frames of :func:`simulated_frames` [m]."""
    return np.stack(list(simulated_frames(*arguments)))


def simulated_frames(
    dressed: DressedBody,
    start: Float[np.ndarray, "vertices 3"],
    settings: Mapping[str, float | int | str],
    contact: Mapping[str, float | int],
    gravity: Float[np.ndarray, " 3"],
    fps: float,
) -> Iterator[Float[np.ndarray, "vertices 3"]]:
    """Positions [m] of the garment at ``start`` (velocity 0), then in each later frame of the body, 1/``fps`` s apart.

    ``gravity`` [m/s²] is really applied: the scene's is ``gravity * 1000 / fps²`` (see cloth). The rest shape is
    ``dressed.rest_positions``, whatever the start. The garment touches body and itself as ``contact`` says (conf/data/
    garments.yaml). ``settings``: a fabric's, with the solver steps per frame as ``quality``. All frames have to be
    asked for.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.use_gravity = True
    scene.gravity = np.asarray(gravity) * CLOCK / fps**2
    with tempfile.TemporaryDirectory() as folder:
        _body_object(dressed, contact, Path(folder))
        garment = _garment_object(dressed, start, settings, contact, Path(folder))
        for frame in range(dressed.num_frames):
            scene.frame_set(FIRST + frame)
            yield read_positions(garment).astype(np.float32, copy=False)
        bpy.ops.wm.read_factory_settings(use_empty=True)  # before the caches that it reads are removed


def _body_object(dressed: DressedBody, contact: Mapping, folder: Path) -> bpy.types.Object:
    """A body that moves by a point cache; moved from Python the cloth would not see its motion within a frame."""
    body = mesh_object("body", dressed.body_positions[0], dressed.body_faces)
    move_by_cache(folder, FIRST)(body, dressed.body_positions.__getitem__, dressed.num_frames)
    body.modifiers.new("collision", "COLLISION")
    body.collision.thickness_outer = contact["thickness"]
    body.collision.cloth_friction = blender_number(contact["friction"])
    body.collision.damping = contact["damping"]
    return body


def _garment_object(
    dressed: DressedBody, start: np.ndarray, settings: Mapping, contact: Mapping, folder: Path
) -> bpy.types.Object:
    garment = cloth_object(dressed.rest_positions, dressed.faces, dressed.pinned, start)
    if len(dressed.pinned):
        move_by_cache(folder, FIRST)(garment, lambda frame: dressed.led(start, frame), dressed.num_frames)
    touch = cloth_modifier(garment, settings, dressed.pinned, dressed.num_frames).collision_settings
    touch.use_collision = touch.use_self_collision = True
    touch.distance_min = contact["distance"]
    touch.self_distance_min = contact["self_distance"]
    touch.collision_quality = contact["quality"]
    return garment
