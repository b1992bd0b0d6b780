"""A stored animation in the formats of animation tools: Alembic, USD, GLB. Imports bpy (see output_worker).

GLB and USD are in metres and say so, Alembic in the unit of the file of the cloth; frames count from the first of the
body on; each turns the up axis into its own. Meshes that came from files have the polygons, vertices, texture
coordinates and names of materials that they had. Alembic and USD hold the positions of every frame. GLB holds a morph
target (with normals) for every frame, one fading into the next: all viewers that play morph targets play it, without a
limit of their number where they are kept in textures (three.js, Babylon.js, Blender do; very old viewers show eight).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from drape.blender.animated_scene import move_by_cache, move_by_shape_keys, moved_objects, new_scene
from drape.blender.studio import cloth_material, material
from drape.data.look import Look
from drape.errors import DrapeError
from drape.reading.mesh_record import FileForm


def export_animation(look: Look, path: Path, folder: Path) -> None:
    """Write ``path``: ``.abc``, ``.usdc`` or ``.glb``; ``folder`` is for temporary files.

    Raises:
        DrapeError: Blender could not write it.
    """
    header = look.file.header
    scene = new_scene(look.file.num_frames, header.dt, header.first)
    move = move_by_shape_keys if path.suffix == ".glb" else move_by_cache(folder, header.first)
    colours = ((lambda: cloth_material(look.colour)), (lambda: material("body", (0.5, 0.5, 0.5))))
    for thing, form, coloured in zip(moved_objects(look, move, as_read=True), header.forms, colours, strict=False):
        _give_materials(thing.data, form, coloured)
    scene.frame_set(header.first)
    try:
        WRITERS[path.suffix](path, scene, 1.0 if header.forms[0] is None else 1.0 / header.forms[0].scale)
    except RuntimeError as error:  # what an operator reports
        raise DrapeError(f"{path}: Blender could not write it: {error}") from None
    if not path.is_file():
        raise DrapeError(f"{path}: Blender wrote nothing")


def _give_materials(mesh: bpy.types.Mesh, form: FileForm | None, coloured: Callable[[], bpy.types.Material]) -> None:
    """One material, or those of the file by name."""
    if form is None or form.material is None or not form.materials:
        mesh.materials.append(coloured())
        return
    for name in form.materials:
        made = coloured()
        made.name = name
        mesh.materials.append(made)
    mesh.polygons.foreach_set("material_index", np.maximum(form.material, 0).astype(np.int32))


def _alembic(path: Path, scene: bpy.types.Scene, scale: float) -> None:
    """Alembic says no unit: that of the file of the cloth."""
    start, end = scene.frame_start, scene.frame_end
    bpy.ops.wm.alembic_export(filepath=str(path), start=start, end=end, global_scale=scale, as_background_job=False)


def _usd(path: Path, scene: bpy.types.Scene, _scale: float) -> None:
    bpy.ops.wm.usd_export(filepath=str(path), export_animation=scene.frame_end > scene.frame_start)


def _glb(path: Path, scene: bpy.types.Scene, _scale: float) -> None:
    rate = scene.render
    rate.fps_base = 1.0 / rate.fps_base  # the exporter of 5.0 multiplies by it where the rest of Blender divides
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        export_format="GLB",
        export_animations=scene.frame_end > scene.frame_start,
        export_animation_mode="SCENE",  # cloth and body in one animation: viewers play one at a time
        export_anim_scene_split_object=False,
        export_morph=True,
        export_morph_normal=True,
        export_morph_animation=True,
        export_frame_range=True,
        export_optimize_animation_size=False,
        export_yup=True,
    )


WRITERS: dict[str, Callable[[Path, bpy.types.Scene, float], None]] = {".abc": _alembic, ".usdc": _usd, ".glb": _glb}
"""By ending."""
