"""Friction of incremental potential contact (Li et al. 2020): pressures and directions of a lagged position."""

from __future__ import annotations

from collections.abc import Callable

import ipctk
import numpy as np
from jaxtyping import Float
from scipy import sparse

Points = Float[np.ndarray, "points 3"]
Cloth = Float[np.ndarray, "vertices 3"]
Body = Float[np.ndarray, "body_vertices 3"] | None


class LaggedFriction:
    """``Σ w μ N f₀(|slip|)`` [J] over a step of ``dt`` [s]: convex in the positions at its end.

    N is the pressure, and the tangents are those of the lagged position; the slip is that of the displacement in the
    step. f₀ is |slip| above ``eps_v dt``, a C¹ cubic below: Coulomb's friction is full from the slip speed ``eps_v``
    [m/s] on. (ipctk's potential of velocities is a power; the energy here is dt times that.)
    """

    def __init__(
        self,
        near: ipctk.NormalCollisions,
        mesh: ipctk.CollisionMesh,
        barrier: ipctk.BarrierPotential,
        lagged: Points,
        coefficient: float,
        eps_v: float,
        dt: float,
    ):
        self.mesh, self.dt = mesh, dt
        self.potential = ipctk.FrictionPotential(eps_v)
        self.pairs = ipctk.TangentialCollisions()
        if len(near) and coefficient > 0:
            self.pairs.build(mesh, lagged, near, barrier, coefficient)

    def energy_and_gradient(self, displacement: Points) -> tuple[float, Points]:
        """Energy [J] of the displacement of all points in the step [m], and gradient [N]."""
        if not len(self.pairs):
            return 0.0, np.zeros(displacement.shape)
        v = np.asfortranarray(displacement / self.dt)
        gradient = self.potential.gradient(self.pairs, self.mesh, v).reshape(-1, 3)
        return self.dt * float(self.potential(self.pairs, self.mesh, v)), gradient

    def hessian(self, displacement: Points) -> sparse.csr_array:
        """[N/m], of all points; positive semi-definite without a projection, as f₀ is convex."""
        if not len(self.pairs):
            return sparse.csr_array((displacement.size, displacement.size))
        v = np.asfortranarray(displacement / self.dt)
        return sparse.csr_array(self.potential.hessian(self.pairs, self.mesh, v)) / self.dt


class Friction:
    """Lagged friction of a cloth with itself and a body: energy of a step from start to end, derivatives of the end."""

    def __init__(self, points: Callable, parts: list[LaggedFriction], count: int):
        self._points, self._parts, self._count = points, parts, count

    def energy_and_gradient(self, x_from: Cloth, body_from: Body, x_to: Cloth, body_to: Body) -> tuple[float, Cloth]:
        """[J] and [N]."""
        ways = zip(self._parts, self._points(x_from, body_from), self._points(x_to, body_to), strict=True)
        parts = [part.energy_and_gradient(end - start) for part, start, end in ways]
        gradients = (gradient[: self._count] for _, gradient in parts)
        return sum((energy for energy, _ in parts), 0.0), sum(gradients, np.zeros((self._count, 3)))

    def hessian(self, x_from: Cloth, body_from: Body, x_to: Cloth, body_to: Body) -> sparse.csr_array:
        """Upper triangle [N/m] of 3V coordinates; positive semi-definite."""
        free = 3 * self._count
        ways = zip(self._parts, self._points(x_from, body_from), self._points(x_to, body_to), strict=True)
        whole = sum(part.hessian(end - start)[:free, :free] for part, start, end in ways)
        return sparse.triu(whole, format="csr")
