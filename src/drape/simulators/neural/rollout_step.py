"""From a rollout to its time steps."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.garment_rollout import GarmentRollout
from drape.energy.step import ObstacleStep, Step
from drape.geometry.surface_points import SurfacePoints
from drape.simulators.neural.cloths import Cloth


def rollout_step(
    rollout: GarmentRollout,
    k: int,
    x: Float[Tensor, "vertices 3"],
    v: Float[Tensor, "vertices 3"],
    cloth: Cloth,
    touching: SurfacePoints | None = None,
) -> Step:
    """The step from frame t + k of ``rollout`` to the next one, of garments that are at ``x`` with velocities ``v``.

    ``touching``: the points of the garments that can touch bodies; None for the vertices alone.
    """
    led = (rollout.x[k + 2] - x) / rollout.dt
    return Step(
        mesh=rollout.mesh,
        x=x,
        v=torch.where(rollout.free[:, None], v, led),
        mass=cloth.mass,
        free=rollout.free,
        attributes=cloth.attributes,
        gravity=rollout.gravity,
        dt=rollout.dt,
        external_force=cloth.external_force,
        obstacle=ObstacleStep(rollout.body_faces, rollout.body[k + 1], rollout.body[k + 2], rollout.mesh_of_face),
        touching=touching,
        fabric=cloth.terms,
    )
