"""Pictures of a stored animation by Cycles on the CPU, and a film of pictures. Imports bpy (see output_worker)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from drape.blender.animated_scene import move_by_cache, moved_objects, new_scene
from drape.blender.studio import BODY_COLOUR, build_studio, cloth_material, material, shade_back
from drape.data.look import Look
from drape.data.whole_file import whole_file
from drape.errors import DrapeError


class Pictures:
    """A studio around an animation, to be photographed frame by frame.

    ``size``: width and height in pixels; ``samples``: light paths per pixel, the picture is denoised.
    """

    def __init__(self, look: Look, samples: int, size: Sequence[int], folder: Path) -> None:
        scene = new_scene(look.file.num_frames, look.file.header.dt)
        cloth, *bodies = moved_objects(look, move_by_cache(folder))
        fabric = cloth_material(look.colour)
        shade_back(fabric)
        cloth.data.materials.append(fabric)
        for body in bodies:
            body.data.materials.append(material("body", BODY_COLOUR))
        build_studio(look.box, look.camera(size[0] / size[1]), hangs=not bodies)
        scene.render.engine = "CYCLES"
        scene.render.resolution_x, scene.render.resolution_y = size
        scene.render.resolution_percentage = 100
        scene.render.image_settings.file_format = "PNG"
        scene.render.image_settings.color_mode = "RGB"
        scene.render.use_persistent_data = True
        scene.cycles.device = "CPU"
        scene.cycles.samples = samples
        scene.cycles.use_denoising = True
        scene.cycles.denoiser = "OPENIMAGEDENOISE"
        scene.cycles.max_bounces = 4
        scene.view_settings.view_transform = "Standard"
        self._scene = scene

    def take(self, frame: int, path: Path) -> None:
        """Render one frame to a PNG that is whole or absent."""
        self._scene.frame_set(frame)
        with whole_file(path) as temporary:
            self._scene.render.filepath = str(temporary.absolute())
            try:
                bpy.ops.render.render(write_still=True)
            except RuntimeError as error:  # what the operator reports
                raise DrapeError(f"{path}: Blender could not render it: {error}") from None


def film(pictures: Sequence[Path], dt: float, path: Path) -> None:
    """Write an MP4 (H.264) of PNG pictures of one size, one every ``dt`` seconds.

    Raises:
        DrapeError: Blender could not write it.
    """
    scene = new_scene(len(pictures), dt)
    strips = scene.sequence_editor_create().strips
    strip = strips.new_image("film", str(pictures[0]), channel=1, frame_start=0)
    for picture in pictures[1:]:
        strip.elements.append(picture.name)
    first, render = strip.elements[0], scene.render
    render.resolution_x, render.resolution_y = first.orig_width, first.orig_height
    render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"  # the pictures are as they are to be seen
    render.image_settings.media_type = "VIDEO"
    render.image_settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec = "MPEG4", "H264"
    render.ffmpeg.constant_rate_factor, render.ffmpeg.gopsize = "HIGH", 15
    with whole_file(path) as temporary:
        render.filepath = str(temporary.absolute())
        try:
            bpy.ops.render.render(animation=True)
        except RuntimeError as error:
            raise DrapeError(f"{path}: Blender could not write it: {error}") from None
