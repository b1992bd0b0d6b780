"""Time steps of a scene as the energies see them: tensors in double precision, centred on the cloth."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.contact.sharp_points import SharpPoints
from drape.energy.step import ObstacleStep, Step
from drape.energy.terms.contact import Contact
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.surface_points import SurfacePoints
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State

ASKED = 2.0
"""Thicknesses of contact within which of the cloth points of the body are asked about it."""


class _Body(NamedTuple):
    """The body of a scene, and where cloth and body are asked about each other."""

    obstacle: Obstacle
    faces: Int[Tensor, "body_faces 3"]
    touching: SurfacePoints
    sharp: SharpPoints | None
    asked_within: float
    """Distance from the cloth up to which sharp points are asked [m]."""


class SceneSteps:
    """Makes the :class:`Step` from one time of a scene to another; times are counted in frames.

    Positions are relative to the middle of the cloth: where in the world a scene plays costs no accuracy. Between
    frames, pins and body move on straight lines.

    Args:
        scene: what is simulated.
        attributes: the scaled vector **a** of its fabric; empty for energies that read no attributes.
        device: where the energies are evaluated.
        contact: decides which points of the cloth meet the body; None: its vertices.
    """

    def __init__(
        self,
        scene: Scene,
        attributes: Float[Tensor, " attributes"],
        device: torch.device | str = "cpu",
        contact: Contact | None = None,
    ):
        self.scene = scene
        self.device = torch.device(device)
        batch = MeshBatch.from_meshes([scene.mesh])
        tensors = {f.name: getattr(batch, f.name) for f in fields(batch)}
        here: dict[str, Any] = {k: self._put(v) for k, v in tensors.items() if isinstance(v, Tensor)}
        self.mesh = replace(batch, **here)
        free = torch.ones(scene.mesh.num_vertices, dtype=torch.bool)
        if scene.pins is not None:
            free[torch.from_numpy(np.array(scene.pins.vertices))] = False
        self.free = free.to(self.device)
        self._mass = self._put(torch.tensor(scene.mass))
        self._gravity = self._put(torch.tensor(scene.gravity))
        self._attributes = attributes[None].to(self.device)
        force = scene.external_force
        self._force = None if force is None else self._put(torch.tensor(force))
        self._searched: tuple[float, np.ndarray, NearestFaces] | None = None
        self._body = None if scene.obstacle is None else self._asked_body(scene.obstacle, contact)

    def _asked_body(self, obstacle: Obstacle, contact: Contact | None) -> _Body:
        faces = torch.tensor(obstacle.welded_faces, device=self.device)
        if contact is None:
            return _Body(obstacle, faces, SurfacePoints.of(self.mesh), None, 0.0)
        sharp = contact.sharp_points(self.scene)
        return _Body(obstacle, faces, contact.surface(self.mesh), sharp, ASKED * contact.thickness)

    def _put(self, tensor: Tensor) -> Tensor:
        return tensor.to(self.device, torch.float64) if tensor.is_floating_point() else tensor.to(self.device)

    def origin(self, state: State) -> Float[np.ndarray, "3"]:
        """The middle of the cloth, which the positions of a step are relative to [m]."""
        return state.x.mean(axis=0)

    def step(self, state: State, start: float, stop: float) -> Step:
        """The step from ``state`` at time ``start`` to time ``stop``, both in frames."""
        origin, scene, body, obstacle = self.origin(state), self.scene, self._body, None
        if body is not None:
            x, x_next = (self._put(torch.from_numpy(_between(body.obstacle, t) - origin)) for t in (start, stop))
            obstacle = ObstacleStep(body.faces, x, x_next, torch.zeros_like(body.faces[:, 0]))
        step = Step(
            mesh=self.mesh,
            x=self._put(torch.from_numpy(state.x - origin)),
            v=self._put(torch.tensor(state.v)),
            mass=self._mass,
            free=self.free,
            attributes=self._attributes,
            gravity=self._gravity,
            dt=(stop - start) * scene.dt,
            external_force=self._force,
            obstacle=obstacle,
            touching=None if body is None else body.touching,
        )
        if body is None or obstacle is None:
            return step
        near = self._nearest(body, state.x, start).until(body.faces, obstacle.x_next)
        ways = step.x, step.inertial, body.faces, obstacle.x, obstacle.x_next
        return _with_near(step, near, body, ways)

    def with_near_at(
        self, step: Step, x: Float[Tensor, "vertices 3"], positions: Float[np.ndarray, "vertices 3"], stop: float
    ) -> Step:
        """``step`` with the faces in contact that are nearest to cloth when it ends, at time ``stop``, if any are.

        Args:
            x: where the cloth is then, as the step has positions.
            positions: the same in the world [m].
        """
        body, obstacle = self._body, step.obstacle
        if body is None or obstacle is None:
            return step
        near = self._nearest(body, positions, stop).until(body.faces, obstacle.x_next)
        return _with_near(step, near, body, (x, x, body.faces, obstacle.x_next, obstacle.x_next))

    def _nearest(self, body: _Body, x: Float[np.ndarray, "vertices 3"], time: float) -> NearestFaces:
        """At a time in frames; a step begins where the one before has ended, so the last search is kept."""
        if self._searched is not None and self._searched[0] == time and np.array_equal(self._searched[1], x):
            return self._searched[2]
        place, faces = torch.tensor(_between(body.obstacle, time), device=self.device), body.faces
        points = body.touching.at(torch.tensor(x, device=self.device))
        none = torch.zeros(max(len(points), len(faces)), dtype=torch.long, device=self.device)
        near = NearestFaces.find(points, none[: len(points)], faces, none[: len(faces)], place, place)
        self._searched = time, np.array(x), near
        return near

    def body(self, time: float) -> Float[np.ndarray, "body_vertices 3"] | None:
        """Positions of the body at a time in frames [m]."""
        return None if self.scene.obstacle is None else _between(self.scene.obstacle, time)

    def pinned(self, x: Float[Tensor, "vertices 3"], state: State, stop: float) -> Float[Tensor, "vertices 3"]:
        """Positions ``x`` of a step from ``state`` with the pinned vertices where they are at time ``stop``."""
        if self.scene.pins is None:
            return x
        targets = self._put(torch.from_numpy(self.pin_targets(stop) - self.origin(state)))
        return x.index_copy(0, torch.tensor(self.scene.pins.vertices, device=self.device), targets)

    def pin_targets(self, time: float) -> Float[np.ndarray, "pinned 3"]:
        """Positions of the pinned vertices at a time in frames [m]."""
        return np.empty((0, 3)) if self.scene.pins is None else _between(self.scene.pins, time)


Ways = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
"""Of cloth and body: x and x' of the cloth, the faces of the body, its vertices at both times."""


def _with_near(step: Step, near: NearestFaces, body: _Body, ways: Ways) -> Step:
    """``step`` with these nearest faces, and with what is near to sharp points of the body on these ``ways``."""
    if body.sharp is None:
        return step.with_near(near)
    surface, further = body.sharp.meeting(body.touching, *ways, body.asked_within)
    return step.with_near(near if further is None else near.joined(further), surface)


def _between(moving: Obstacle | Pins, time: float) -> np.ndarray:
    """Positions of pins or of a body at a time in frames."""
    first = int(np.floor(time + 1e-9))
    share = time - first
    before = moving.at(first)
    return before if share < 1e-9 else (1.0 - share) * before + share * moving.at(first + 1)
