"""Incremental potential contact (Li et al. 2020) of a cloth with itself and with a body that is given: no crossings."""

from __future__ import annotations

import ipctk
import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from drape.contact.crossings import Crossings, Hits, crossings, hits
from drape.contact.friction import Friction, LaggedFriction
from drape.contact.meeting import Meeting
from drape.errors import DrapeError

Cloth = Float[np.ndarray, "vertices 3"]
Body = Float[np.ndarray, "body_vertices 3"] | None


class Collisions:
    """Pairs of primitives that meet in a cloth, and between the cloth and a body; derivatives are those of the cloth.

    The barrier is documented in ``barrier``, where ``stiffness_for`` gives a stiffness. All calls take all positions;
    searches for pairs are kept as long as they hold. The same call gives the same answer up to rounding: which
    candidates were kept changes no value.

    Args:
        rest_positions: cloth at rest [m].
        faces: of the cloth.
        self_distance: where the barrier between cloth and cloth begins [m].
        self_stiffness: its stiffness [Pa].
        body: vertices of the body in any pose [m]; its areas weigh pairs. None without a body.
        body_faces: of the body.
        body_distance: where the barrier between cloth and body begins [m]; None where another term keeps them apart:
            then the body only stops paths in ``free_share``.
        body_stiffness: its stiffness [Pa].

    Raises:
        DrapeError: a distance or stiffness that is not positive, body vertices without faces.
    """

    def __init__(
        self,
        rest_positions: Cloth,
        faces: Int[np.ndarray, "faces 3"],
        *,
        self_distance: float,
        self_stiffness: float,
        body: Body = None,
        body_faces: Int[np.ndarray, "body_faces 3"] | None = None,
        body_distance: float | None = None,
        body_stiffness: float = 1.0,
    ):
        numbers = [self_distance, self_stiffness, body_stiffness, *([] if body_distance is None else [body_distance])]
        if not all(0.0 < number < np.inf for number in numbers) or (body is None) != (body_faces is None):
            raise DrapeError(
                f"contact: self_distance {self_distance} m, self_stiffness {self_stiffness} Pa, body_distance "
                f"{body_distance} m, body_stiffness {body_stiffness} Pa, body {'absent' if body is None else 'given'}, "
                f"body_faces {'absent' if body_faces is None else 'given'}; expected positive numbers, and vertices "
                "and faces of a body or neither"
            )
        count = len(rest_positions)
        self.cloth = Meeting(rest_positions, faces, count, ipctk.CollisionFilter(), self_distance, self_stiffness)
        self.body: Meeting | None = None
        if body is not None and body_faces is not None:
            both = np.concatenate([faces, body_faces + count])
            apart = ipctk.make_vertex_patches_filter(np.repeat(np.array([0, 1], np.int32), [count, len(body)]))
            rest = np.concatenate([rest_positions, body])
            self.body = Meeting(rest, both, count, apart, body_distance or 0.0, body_stiffness)

    def forget(self) -> None:
        """Keep nothing of the searches so far."""
        for meeting in filter(None, (self.cloth, self.body)):
            meeting.forget()

    def energy_and_gradient(self, x: Cloth, body: Body = None) -> tuple[float, Cloth]:
        """Barrier of cloth and cloth, and of cloth and body [J], and its gradient [N]."""
        parts = [meeting.energy_and_gradient(points) for meeting, points in self._meetings(x, body)]
        return sum((energy for energy, _ in parts), 0.0), sum((gradient for _, gradient in parts), np.zeros(x.shape))

    def hessian(self, x: Cloth, body: Body = None) -> sparse.csr_array:
        """Upper triangle of the Gauss-Newton Hessian [N/m], of 3V coordinates; positive semi-definite."""
        whole = sum(meeting.hessian(points) for meeting, points in self._meetings(x, body))
        return sparse.triu(whole, format="csr")

    def free_share(self, x_from: Cloth, body_from: Body, x_to: Cloth, body_to: Body) -> float:
        """The largest share of the straight way of cloth and body that is free of crossings: 1 where all of it is.

        The start must be free of crossings. 0 means that something cannot move at all, as the start touches or crosses.
        """
        ways = zip(self._meetings(x_from, body_from), self._meetings(x_to, body_to), strict=True)
        return min(meeting.free_share(start, end) for (meeting, start), (_, end) in ways)

    def friction(
        self, x: Cloth, body: Body, *, dt: float, eps_v: float, self_friction: float, body_friction: float = 0.0
    ) -> Friction:
        """Coulomb's friction with the pressures that the barrier has at ``x``."""
        meetings = self._meetings(x, body)
        parts = [
            LaggedFriction(meeting.collisions(points), meeting.mesh, meeting.potential, points, mu, eps_v, dt)
            for (meeting, points), mu in zip(meetings, [self_friction, body_friction][: len(meetings)], strict=True)
        ]
        return Friction(self._points, parts, len(x))

    def crossings(self, x: Cloth, body: Body = None) -> Crossings:
        """Faces that cross, cloth with cloth and cloth with body."""
        return crossings_of(self.hits(x, body))

    def hits(self, x: Cloth, body: Body = None) -> list[tuple[Meeting, Hits]]:
        """Edges that pass through faces, in the cloth and then with the body."""
        return [(meeting, hits(meeting.mesh, points)) for meeting, points in self._meetings(x, body)]

    def _meetings(self, x: Cloth, body: Body) -> list[tuple[Meeting, Float[np.ndarray, "points 3"]]]:
        return list(zip(filter(None, (self.cloth, self.body)), self._points(x, body), strict=True))

    def _points(self, x: Cloth, body: Body) -> list[Float[np.ndarray, "points 3"]]:
        """Points of the cloth, and of cloth and body where there is one, as ipctk wants them."""
        given = (len(x), 0 if body is None else len(body))
        count = self.cloth.mesh.num_vertices
        expected = (count, self.body.mesh.num_vertices - count if self.body else 0)
        if given != expected:
            raise DrapeError(f"contact: found {given} vertices of cloth and body, expected {expected} as at the start")
        cloth = np.array(x, np.float64, order="F")
        return [cloth] if body is None else [cloth, np.asfortranarray(np.concatenate([cloth, body]))]


def crossings_of(found: list[tuple[Meeting, Hits]]) -> Crossings:
    """Faces that cross where :meth:`Collisions.hits` has found edges that pass through faces."""
    parts = [crossings(meeting.mesh, each) for meeting, each in found]
    return Crossings(*map(np.concatenate, zip(*parts, strict=True)))
