"""A stored animation in the formats of animation tools: Alembic, USD, GLB. Imports bpy (see output_worker).

All are in metres and seconds with frame k at time ``k * dt``; each turns the up axis into its own. Alembic and USD hold
the positions of every frame. GLB holds a morph target (with normals) for every frame, one fading into the next: all
viewers that play morph targets play it, without a limit of their number where they are kept in textures (three.js,
Babylon.js, Blender do; very old viewers show eight).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from drape.blender.animated_scene import move_by_cache, move_by_shape_keys, moved_objects, new_scene
from drape.blender.studio import cloth_material, material
from drape.data.look import Look
from drape.errors import DrapeError


def export_animation(look: Look, path: Path, folder: Path) -> None:
    """Write ``path``: ``.abc``, ``.usdc`` or ``.glb``; ``folder`` is for temporary files.

    Raises:
        DrapeError: Blender could not write it.
    """
    frames = look.file.num_frames
    new_scene(frames, look.file.header.dt)
    move = move_by_shape_keys if path.suffix == ".glb" else move_by_cache(folder)
    cloth, *bodies = moved_objects(look, move)
    cloth.data.materials.append(cloth_material(look.colour))
    for body in bodies:
        body.data.materials.append(material("body", (0.5, 0.5, 0.5)))
    bpy.context.scene.frame_set(0)
    try:
        WRITERS[path.suffix](path, frames)
    except RuntimeError as error:  # what an operator reports
        raise DrapeError(f"{path}: Blender could not write it: {error}") from None
    if not path.is_file():
        raise DrapeError(f"{path}: Blender wrote nothing")


def _alembic(path: Path, frames: int) -> None:
    bpy.ops.wm.alembic_export(filepath=str(path), start=0, end=frames - 1, as_background_job=False)


def _usd(path: Path, frames: int) -> None:
    bpy.ops.wm.usd_export(filepath=str(path), export_animation=frames > 1)


def _glb(path: Path, frames: int) -> None:
    rate = bpy.context.scene.render
    rate.fps_base = 1.0 / rate.fps_base  # the exporter of 5.0 multiplies by it where the rest of Blender divides
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        export_format="GLB",
        export_animations=frames > 1,
        export_animation_mode="SCENE",  # cloth and body in one animation: viewers play one at a time
        export_anim_scene_split_object=False,
        export_morph=True,
        export_morph_normal=True,
        export_morph_animation=True,
        export_frame_range=True,
        export_optimize_animation_size=False,
        export_yup=True,
    )


WRITERS: dict[str, Callable[[Path, int], None]] = {".abc": _alembic, ".usdc": _usd, ".glb": _glb}
"""By ending."""
