"""The user's own garment and body, by path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.scene.follow import follow
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.mesh_file import read_cloth
from drape.scene.obstacle_file import read_obstacle
from drape.scene.pin_rule import pinned_vertices
from drape.scene.pins import Pins
from drape.scene.proportions import check_garment_and_body
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State


def custom(
    mesh: str,
    start: str | None,
    scale: float,
    body: str | None,
    body_scale: float,
    body_fps: float | None,
    up_axis: str,
    pins: Sequence[int] | Mapping[str, float] | None,
    pins_follow_body: bool,
    friction: float | None,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """A garment (rest shape ``mesh``, initial positions ``start`` or the rest shape) and perhaps a body.

    A ``scale`` above 1 enlarges the scene, as files are in metres at most. Units, axes and kinds of file: see
    :func:`read_cloth` and :func:`read_obstacle`. ``pins``: see
    :func:`pinned_vertices`; they are held where they start, or move with the body's surface.

    Raises:
        DrapeError: whatever is wrong with files, sizes, pins or masses, before anything is simulated.
    """
    where, dt, gravity = Path(mesh), frame_time(fps), frozen_floats(gravity, (3,), "scene.gravity")
    cloth = read_cloth(where, scale, up_axis)
    x = cloth.rest_positions if start is None else _initial(Path(start), cloth.faces, scale, up_axis, where)
    obstacle = None
    if body is not None:
        obstacle = read_obstacle(body, dt, frames, body_fps, body_scale, up_axis)
        check_garment_and_body(x, obstacle.at(0), str(start or mesh), body)
    vertices = pinned_vertices(pins, x, gravity)
    if pins_follow_body and (obstacle is None or vertices is None):
        missing = "body: set scene.body" if obstacle is None else "pinned vertex: set scene.pins"
        raise DrapeError(f"scene.pins_follow_body: found true without a {missing}, or leave pins_follow_body false")
    if vertices is None:
        held = None
    elif pins_follow_body:
        held = Pins(vertices, follow(obstacle, x[vertices]))
    else:
        held = Pins.fixed(vertices, x)
    return Scene(
        name=where.stem,
        mesh=cloth,
        initial=State.at_rest(x),
        material=material,
        mass=vertex_masses(cloth, mass),
        gravity=gravity,
        dt=dt,
        frames=frames,
        pins=held,
        obstacle=obstacle,
        friction=None if obstacle is None else friction,
        enlarged=max(1.0, scale),
    )


def _initial(
    start: Path, faces: np.ndarray, scale: float, up_axis: str, mesh: Path
) -> Float[np.ndarray, "vertices 3"]:
    posed = read_cloth(start, scale, up_axis)
    if not np.array_equal(posed.faces, faces):
        raise DrapeError(
            f"{start}: found {posed.num_vertices} vertices and {posed.num_faces} faces that are not those of {mesh} "
            f"({len(np.unique(faces))} and {len(faces)}); expected the same mesh in another pose; export both with the "
            "vertices in the same order"
        )
    return posed.rest_positions
