"""Incremental potential contact (Li et al. 2020): cloth never crosses itself, other cloth or the body."""

from __future__ import annotations

from weakref import ref

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor

from drape.contact.barrier import stiffness_for
from drape.contact.collisions import Collisions
from drape.contact.friction import Friction
from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.energy.terms.contact import SurfaceContact
from drape.errors import DrapeError
from drape.geometry.normals import face_normals
from drape.scene.scene import Scene

STANDARD_GRAVITY = 9.81
"""Acceleration that presses layers together where a scene has no gravity [m/s²]."""
LOAD = 100.0
"""Weights of a layer under which layers are half as far apart as where the barrier begins; one weight takes 5 % of it.
Cloth that is stopped within a frame presses with v/(g dt), ten weights for 3 m/s, on the few points that meet first."""
SLIP_SPEED = 1e-3
"""From which on friction between cloth and cloth is full [m/s]."""


class Barrier(EnergyTerm):
    """Barrier that grows without bound as cloth comes near to itself or to the body: :mod:`drape.contact.barrier`.

    Its energy is smooth only between places that are free of crossings, and a step may go along a straight way as far
    as :meth:`free_share` says.

    Args:
        scene: whose cloth, body and gravity decide which pairs there are and how stiff the barrier is.
        self_distance: between cloth and cloth, at which the barrier begins [m].
        body_distance: between cloth and body [m].
        self_friction: coefficient between cloth and cloth; 0: none.
    """

    name = "barrier"

    def __init__(self, scene: Scene, self_distance: float, body_distance: float, self_friction: float):
        super().__init__()
        if not 0.0 <= self_friction < np.inf:
            raise DrapeError(f"contact.self_friction: found {self_friction}; expected a coefficient from 0 on")
        mesh, body = scene.mesh, scene.obstacle
        area = 0.5 * np.linalg.norm(face_normals(mesh.rest_positions, mesh.faces), axis=-1)
        gravity = float(np.linalg.norm(scene.gravity)) or STANDARD_GRAVITY
        pressure = LOAD * gravity * float(scene.mass.sum() / area.sum())
        edge = float(mesh.rest_lengths.mean())
        self.collisions = Collisions(
            mesh.rest_positions,
            mesh.faces,
            self_distance=self_distance,
            self_stiffness=stiffness_for(pressure, self_distance, edge),
            body=None if body is None else body.at(0),
            body_faces=None if body is None else body.faces,
            body_distance=None if body is None else body_distance,
            body_stiffness=stiffness_for(pressure, body_distance, edge),
        )
        self.self_friction = self_friction
        self._lagged: tuple[ref[Step], Friction] | None = None

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        return _Known.apply(x_next, *self.energy_and_gradient(x_next, step))

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        x, body = _array(x_next), _body(step, "x_next")
        energy, gradient = self.collisions.energy_and_gradient(x, body)
        if self.self_friction:
            slip, pull = self._friction(step).energy_and_gradient(_array(step.x), _body(step, "x"), x, body)
            energy, gradient = energy + slip, gradient + pull
        return x_next.new_tensor([energy], dtype=torch.float64), torch.from_numpy(gradient).to(x_next)

    def loose_hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array:
        x, body = _array(x_next), _body(step, "x_next")
        total = self.collisions.hessian(x, body)
        if self.self_friction:
            total = total + self._friction(step).hessian(_array(step.x), _body(step, "x"), x, body)
        return total

    def free_share(self, x_from: Float[Tensor, "vertices 3"], x_to: Float[Tensor, "vertices 3"], step: Step) -> float:
        """The largest share of a straight way of the cloth that crosses nothing, beside the body at t + dt."""
        body = _body(step, "x_next")
        return self.collisions.free_share(_array(x_from), body, _array(x_to), body)

    def share_beside_body(
        self, x_from: Float[Tensor, "vertices 3"], x_to: Float[Tensor, "vertices 3"], step: Step
    ) -> float:
        """The same where the body moves as well, from t to t + dt."""
        ends = _array(x_from), _body(step, "x"), _array(x_to), _body(step, "x_next")
        return self.collisions.free_share(*ends)

    def _friction(self, step: Step) -> Friction:
        """With the pressures at t; made once a step."""
        if self._lagged is None or self._lagged[0]() is not step:
            found = self.collisions.friction(
                _array(step.x),
                _body(step, "x"),
                dt=step.dt,
                eps_v=SLIP_SPEED,
                self_friction=self.self_friction,
            )
            self._lagged = ref(step), found
        return self._lagged[1]


class IpcContact(SurfaceContact):
    """:class:`SurfaceContact`, and a barrier that lets nothing cross.

    The surface of the cloth is held at ``thickness`` from the body as without it; the barrier begins where cloth is
    much nearer, at ``body_distance`` [m], and between cloth and cloth at ``self_distance`` [m].

    Raises:
        DrapeError: as :class:`SurfaceContact`, :class:`Barrier` and :class:`Collisions`.
    """

    def __init__(
        self,
        *,
        self_distance: float,
        body_distance: float,
        self_friction: float,
        stiffness: float = 2e7,
        thickness: float = 5e-3,
        reach: float = 0.2,
        per_edge: int = 1,
        per_face: int = 0,
    ):
        super().__init__(stiffness, thickness, reach, per_edge, per_face)
        self.self_distance, self.body_distance, self.self_friction = self_distance, body_distance, self_friction

    def beside(self, scene: Scene) -> list[tuple[EnergyTerm, str]]:
        times = scene.enlarged
        barrier = Barrier(scene, times * self.self_distance, times * self.body_distance, self.self_friction)
        met = "itself" if scene.obstacle is None else "itself and the body"
        return [(barrier, f"cloth must not cross {met}")]


class _Known(torch.autograd.Function):
    """An energy whose gradient is known already."""

    @staticmethod
    def forward(ctx, _, energy, gradient):
        ctx.save_for_backward(gradient)
        return energy

    @staticmethod
    def backward(ctx, upstream):
        (gradient,) = ctx.saved_tensors
        return upstream * gradient, None, None


def _array(x: Float[Tensor, "points 3"]) -> Float[np.ndarray, "points 3"]:
    return x.detach().double().cpu().numpy()


def _body(step: Step, when: str) -> Float[np.ndarray, "body_vertices 3"] | None:
    return None if step.obstacle is None else _array(getattr(step.obstacle, when))
