"""A simulation's scene, checked once: cloth, fabric, pins, forces, body, time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.reading.mesh_record import FileForm
from drape.scene.frozen_array import frozen_floats
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.state import State


@dataclass(frozen=True, eq=False)
class Scene:
    """One cloth and everything that acts on it, in SI units; what is None is not there.

    Frame 0 is ``initial``; ``frames`` more are asked for, frame k at time ``k * dt``. Pins and body that move have a
    position for each of the ``frames + 1``.

    Raises:
        DrapeError: anything that does not fit together, in a sentence that opens with ``scene <name>``.
    """

    name: str
    mesh: ClothMesh
    initial: State
    material: Material
    mass: Float[np.ndarray, " vertices"]
    """Mass of each vertex [kg]; see :func:`drape.scene.mass.vertex_masses`."""
    gravity: Float[np.ndarray, "3"]
    """[m/s²]"""
    dt: float
    """Time between frames [s]."""
    frames: int
    """Number of frames to simulate, the initial state not counted."""
    pins: Pins | None = None
    external_force: Float[np.ndarray, "vertices 3"] | None = None
    """Constant force on each vertex [N]."""
    obstacle: Obstacle | None = None
    friction: float | None = None
    """Coefficient between cloth and body; None: they slip freely."""
    enlarged: float = 1.0
    """Scale over the real size of everything; the distance that cloth keeps from bodies grows with it."""
    reference: Float[np.ndarray, "recorded vertices 3"] | None = None
    """Positions of the cloth by another simulator in frames 0 to ``frames``, to compare with [m]."""
    said: tuple[str, ...] = ()
    """Remarks of reading its files, a line each."""
    forms: tuple[FileForm | None, FileForm | None] = (None, None)
    """Forms of cloth and body in their files, to be written like that."""

    def __post_init__(self) -> None:
        where, count = f"scene {self.name}", self.mesh.num_vertices
        self._check_time(where)
        if len(self.initial.x) != count or len(self.initial.v) != count:
            raise DrapeError(
                f"{where}: initial: found positions of {len(self.initial.x)} and velocities of {len(self.initial.v)} "
                f"vertices; expected {count}, as the mesh has; the initial state must belong to this mesh"
            )
        mass = frozen_floats(self.mass, (count,), f"{where}: mass")
        if (mass <= 0).any():
            where_bad = int(np.flatnonzero(mass <= 0)[0])
            raise DrapeError(f"{where}: mass: vertex {where_bad}: found {mass[where_bad]:g} kg; expected more than 0")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "gravity", frozen_floats(self.gravity, (3,), f"{where}: gravity"))
        if self.external_force is not None:
            force = frozen_floats(self.external_force, (count, 3), f"{where}: external_force")
            object.__setattr__(self, "external_force", force)
        self._check_pins(where)
        self._check_obstacle(where)

    def _check_time(self, where: str) -> None:
        if not math.isfinite(self.dt) or self.dt <= 0:
            raise DrapeError(f"{where}: dt: found {self.dt}; expected seconds between frames, more than 0")
        if self.frames < 1:
            raise DrapeError(f"{where}: frames: found {self.frames}; expected at least 1 frame to simulate")

    def _check_pins(self, where: str) -> None:
        if self.pins is None:
            return
        count, highest = self.mesh.num_vertices, int(self.pins.vertices.max())
        if highest >= count:
            raise DrapeError(
                f"{where}: pins: found vertex {highest}; expected 0..{count - 1}, as the mesh has {count} vertices"
            )
        if len(self.pins.vertices) == count:
            raise DrapeError(f"{where}: pins: found all {count} vertices; expected some that are free; pin fewer")
        self._check_length(where, "pins", self.pins)

    def _check_obstacle(self, where: str) -> None:
        if self.obstacle is not None:
            self._check_length(where, "body", self.obstacle)
        if self.friction is None:
            return
        if self.obstacle is None:
            raise DrapeError(
                f"{where}: friction: found {self.friction} in a scene without a body; leave it out, or add a body"
            )
        if not math.isfinite(self.friction) or self.friction < 0:
            raise DrapeError(f"{where}: friction: found {self.friction}; expected a coefficient from 0 on, or none")

    def _check_length(self, where: str, what: str, moving: Pins | Obstacle) -> None:
        if not moving.is_static and moving.num_frames < self.frames + 1:
            raise DrapeError(
                f"{where}: {what}: found {moving.num_frames} frames; expected {self.frames + 1} (frame 0 and "
                f"{self.frames} more), or 1 that holds at all times; set frames to {moving.num_frames - 1} or fewer, "
                "or give a longer motion"
            )


def frame_time(fps: float) -> float:
    """Time between frames [s] of a scene with ``fps`` frames per second.

    Raises:
        DrapeError: a rate that is not positive.
    """
    if not math.isfinite(fps) or fps <= 0:
        raise DrapeError(f"scene.fps: found {fps}; expected frames per second, more than 0")
    return 1.0 / fps
