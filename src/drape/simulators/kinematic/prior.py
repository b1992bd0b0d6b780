"""Kinematic prior of networks: cloth goes with its body and hardly stretches, without being learned."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from drape.energy.step import Step
from drape.errors import DrapeError
from drape.geometry.fixed_size import counted
from drape.simulators.kinematic.body_points import BodyPoints
from drape.simulators.kinematic.edge_lengths import nearer_to_rest


class KinematicPrior(nn.Module):
    """The acceleration [m/s²] after which ``x' = nearer_to_rest(x + dt (ṽ + dt network(x, ṽ)))``.

    ``ṽ = v + share (1 - (d / reach)²) (v_b - v)``, with the distance d from the body and the velocity v_b that
    the vertex would have if it were fixed to its closest point p there: ``v_b = v_p + (R - 1)(x - p) / dt``, R the
    rotation of the body's closest points to the garment (:class:`RigidMotion`; each counts as much as it pulls). A
    garment that moves rigidly with its body so goes on to. ṽ is what the network is told as the velocity; it predicts
    what happens beyond. In recorded garments (data=garments, 4 cm edges) going with the body leaves 29 % of the mean
    squared acceleration within 1.5 cm of the body and 60 % within 10 cm; without it a network spends its first
    thousands of steps on learning as much. :func:`nearer_to_rest` takes from its errors what is elastically dear.
    Ours, not the paper's.

    Args:
        network: what predicts the rest.
        share: of the relative velocity that is gone after a step, on the body itself; 0 leaves that out.
        rounds: of :func:`nearer_to_rest`; 0 leaves it out.
        reach: distance from the body at which the share has fallen to 0 [m].

    Raises:
        DrapeError: numbers out of range.
    """

    def __init__(self, network: nn.Module, share: float, rounds: int, reach: float):
        super().__init__()
        if not (0.0 <= share <= 1.0 and 0.0 < reach < math.inf and rounds >= 0):
            raise DrapeError(
                f"kinematic prior: share {share}, rounds {rounds}, reach {reach} m; expected a share "
                "from 0 to 1, no less than 0 rounds, and a positive length"
            )
        self.network = network
        self.share, self.rounds, self.reach = share, rounds, reach

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        """In world axes and the precision of the step; 0 at pinned vertices."""
        following = self._following(step)
        acceleration = self.network(following) + (following.v - step.v) / step.dt
        if not self.rounds:
            return acceleration
        x_next = step.x + step.dt * (step.v + step.dt * acceleration)
        kept = nearer_to_rest(x_next, step.mesh, step.free, self.rounds)
        return acceleration + (kept - x_next) / step.dt**2

    def _following(self, step: Step) -> Step:
        """The same step of cloth that has begun to go with the body; the search is shared."""
        if step.obstacle is None or self.share == 0.0:
            return step
        near = BodyPoints.of(step, self.reach)
        gone = counted(self.share * (1.0 - (near.distance / self.reach).clamp(0.0, 1.0).square()), near.there)
        mesh_of = step.mesh.mesh_of_vertex[near.vertices]
        turn = RigidMotion.fit(near.x, near.x_next, gone, mesh_of, step.mesh.num_meshes)
        beyond = turn.shift(step.x[near.vertices], mesh_of) - turn.shift(near.x, mesh_of)
        pulled = gone[:, None] * (near.velocity + beyond / step.dt - step.v[near.vertices])
        v = step.v + torch.zeros_like(step.v).index_add(0, near.vertices, pulled) * step.free[:, None]
        return replace(step, v=v).with_near(step.near)


class Nothing(nn.Module):
    """A network that has learned nothing: accelerations of 0."""

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        return torch.zeros_like(step.x)


ROUNDS = 6
"""Of raising a matrix to the power of 32: its largest eigenvalue stands out if it does by a billionth."""
UNTURNED = 1e-6
"""Weight of the identity beside what is fitted, as a share of it: points on one line, or none, do not turn about it."""


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """For each mesh of a batch the rotation R and the centres c, c' that minimise ``Σ w |c' + R (x - c) - x'|²``.

    Horn's ("Closed-form solution of absolute orientation using unit quaternions", 1987): the quaternion of R is the
    eigenvector of the largest eigenvalue of a symmetric matrix made of ``M = Σ w (x' - c') (x - c)ᵀ``; here by squaring
    the matrix again and again, which asks a device for nothing. In float64. Exact for what moves rigidly. No graph.
    """

    rotation: Float[Tensor, "meshes 3 3"]
    centre: Float[Tensor, "meshes 3"]
    """Of the points before [m]."""
    centre_next: Float[Tensor, "meshes 3"]
    """And after the motion [m]."""

    @classmethod
    def fit(
        cls,
        x: Float[Tensor, "points 3"],
        x_next: Float[Tensor, "points 3"],
        weight: Float[Tensor, " points"],
        mesh_of: Int[Tensor, " points"],
        num_meshes: int,
    ) -> RigidMotion:
        """To points that move from ``x`` to ``x_next``; of a mesh without points the identity."""
        with torch.no_grad():
            w = weight.double()[:, None]

            def total(values: Tensor) -> Tensor:
                return values.new_zeros(num_meshes, values.shape[-1]).index_add(0, mesh_of, values)

            mass = total(w).clamp(min=torch.finfo(w.dtype).tiny)
            centre, centre_next = (total(w * p) / mass for p in (x, x_next))
            before, after = x - centre[mesh_of], x_next - centre_next[mesh_of]
            covariance = total((w * after)[:, :, None].mul(before[:, None]).flatten(1)).view(-1, 3, 3)
            spread = total(w * before.square()).sum(-1) + torch.finfo(w.dtype).tiny
            identity = torch.eye(3, dtype=w.dtype, device=w.device)
            return cls(_nearest_rotation(covariance / spread[:, None, None] + UNTURNED * identity), centre, centre_next)

    def shift(self, x: Float[Tensor, "points 3"], mesh_of: Int[Tensor, " points"]) -> Float[Tensor, "points 3"]:
        """Displacements by the motion of ``mesh_of`` of points at ``x`` [m], in their precision."""
        arm = x - self.centre[mesh_of]
        turned = (self.rotation[mesh_of] @ arm[..., None])[..., 0]
        return (turned - arm + (self.centre_next - self.centre)[mesh_of]).to(x.dtype)


def _nearest_rotation(matrix: Float[Tensor, "meshes 3 3"]) -> Float[Tensor, "meshes 3 3"]:
    """The rotation R with the largest ``tr(Rᵀ M)``."""
    products = _rotation_of_products(matrix.device)
    horn = (matrix.flatten(1) @ products).view(-1, 4, 4)
    largest = horn.square().sum((1, 2), keepdim=True).sqrt()  # no eigenvalue is larger, nor below minus this
    power = horn / largest + torch.eye(4, dtype=horn.dtype, device=horn.device)
    for _ in range(ROUNDS):
        power = torch.linalg.matrix_power(power / power.diagonal(dim1=1, dim2=2).sum(-1)[:, None, None], 32)
    projection = power / power.diagonal(dim1=1, dim2=2).sum(-1)[:, None, None]  # q qᵀ
    return (projection.flatten(1) @ products.T).view(-1, 3, 3)


@cache
def _rotation_of_products(device: torch.device) -> Float[Tensor, "9 16"]:
    """R of a unit quaternion q = (w, x, y, z) is linear in the products q qᵀ."""
    w, x, y, z = range(4)
    signs = (
        {(w, w): 1, (x, x): 1, (y, y): -1, (z, z): -1}, {(x, y): 2, (w, z): -2}, {(x, z): 2, (w, y): 2},
        {(x, y): 2, (w, z): 2}, {(w, w): 1, (x, x): -1, (y, y): 1, (z, z): -1}, {(y, z): 2, (w, x): -2},
        {(x, z): 2, (w, y): -2}, {(y, z): 2, (w, x): 2}, {(w, w): 1, (x, x): -1, (y, y): -1, (z, z): 1},
    )  # fmt: skip
    found = torch.zeros(9, 4, 4, dtype=torch.float64)
    for entry, products in enumerate(signs):
        for (one, other), sign in products.items():
            found[entry, one, other] += sign / 2.0
            found[entry, other, one] += sign / 2.0
    return found.flatten(1).to(device)
