"""The user's own garment and body, by path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.reading.mesh_record import ReadMesh
from drape.reading.triangles import looking_outwards
from drape.scene.follow import follow
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.mesh_file import read_cloth, read_pose
from drape.scene.obstacle import Obstacle
from drape.scene.obstacle_file import obstacle_of, read_body
from drape.scene.pins import Pins, pinned_vertices
from drape.scene.proportions import beside, check_garment_and_body, check_upright, perhaps_lying
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State

FPS = 30.0
USUAL = (20.0, 60.0)
"""Rates of bodies at which cloth is animated, too; motion capture at 120 per second is resampled to :data:`FPS`."""


def custom(
    mesh: str,
    mesh_object: str | None,
    start: str | None,
    start_object: str | None,
    scale: float | None,
    weld: float | None,
    body: str | None,
    body_object: str | None,
    body_scale: float | None,
    body_fps: float | None,
    body_clip: str | None,
    body_weld: float | None,
    up_axis: str | None,
    body_up_axis: str | None,
    pins: Sequence[int] | Mapping[str, float] | None,
    pins_follow_body: bool,
    friction: float | None,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float | None,
    frames: int,
) -> Scene:
    """A garment (rest shape ``mesh``, initial positions ``start`` or the rest shape) and perhaps a body.

    A ``scale`` above 1 enlarges the scene, as files are in metres at most. Units, axes, seams, objects and kinds of
    file: see :func:`read_cloth` and :func:`read_body`. ``pins``: see :func:`pinned_vertices`, counted as in the file or
    its object; they are held where they start, or move with the body's surface. ``fps``: frames per second; None for
    those of the body, if they are usual, else 30.

    Raises:
        DrapeError: whatever is wrong with files, sizes, pins or masses, before anything is simulated.
    """
    _check_apart((mesh, mesh_object), (body, body_object))
    where, down = Path(mesh), frozen_floats(gravity, (3,), "scene.gravity")
    dt = None if fps is None else frame_time(fps)
    cloth, read = read_cloth(where, scale, up_axis, weld, mesh_object)
    x = cloth.rest_positions if start is None else read_pose(start, read, start_object)
    said, worn, obstacle = [read.summary("garment")], None, None
    if body is not None:
        options = (body_fps, body_scale, body_up_axis, body_clip, body_weld, body_object)
        worn = read_body(body, dt, frames, *options)
        assumed = (_assumed(read, up_axis), _assumed(worn, body_up_axis))
        check_upright(worn.positions[0], body, assumed[1])
        check_garment_and_body(x, worn.positions[0], str(start or mesh), body, assumed)
        worn = looking_outwards(worn, x)
        said += [worn.summary("body"), *beside(x, worn.positions[0])]
    else:
        said += perhaps_lying(x, _assumed(read, up_axis))
    dt = dt or frame_time(_rate(worn))
    obstacle = None if worn is None else obstacle_of(worn, dt, frames)
    vertices = pinned_vertices(pins, x, down, read.form.vertex)
    return Scene(
        name=where.stem,
        mesh=cloth,
        initial=State.at_rest(x),
        material=material,
        mass=vertex_masses(cloth, mass),
        gravity=down,
        dt=dt,
        frames=frames,
        pins=_held(vertices, x, obstacle, pins_follow_body),
        obstacle=obstacle,
        friction=None if obstacle is None else friction,
        enlarged=max(1.0, scale or 1.0),
        said=tuple(said),
        forms=(read.form, None if worn is None else worn.form),
    )


def _check_apart(cloth: tuple[str, str | None], body: tuple[str | None, str | None]) -> None:
    if cloth == body:
        raise DrapeError(
            f"scene.mesh and scene.body: found {cloth[0]} for both; expected two meshes; name an object of the file "
            "for each: scene.mesh_object and scene.body_object"
        )


def _assumed(read: ReadMesh, up_axis: str | None) -> str | None:
    """Remark on the axis taken to be up as neither the file nor anybody says it."""
    return read.source.usual if up_axis is None and read.source.up is None else None


def _rate(body: ReadMesh | None) -> float:
    """Frames per second where none are asked for."""
    rate = None if body is None else body.source.fps
    return rate if rate is not None and USUAL[0] <= rate <= USUAL[1] else FPS


def _held(
    vertices: np.ndarray | None, x: Float[np.ndarray, "vertices 3"], obstacle: Obstacle | None, follows: bool
) -> Pins | None:
    if follows and (obstacle is None or vertices is None):
        missing = "body: set scene.body" if obstacle is None else "pinned vertex: set scene.pins"
        raise DrapeError(f"scene.pins_follow_body: found true without a {missing}, or leave pins_follow_body false")
    if vertices is None:
        return None
    if follows and obstacle is not None:
        return Pins(vertices, follow(obstacle, x[vertices]))
    return Pins.fixed(vertices, x)
