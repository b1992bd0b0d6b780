"""Incremental potential contact (Li et al. 2020) between parts of one set of triangles, by ipctk."""

from __future__ import annotations

import ipctk
import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from drape.contact.gauss_newton import gauss_newton
from drape.errors import DrapeError

MARGIN = 0.02
"""Largest way of free points out of the region before pairs are searched again, as a share of the mean edge at rest. A
search takes 2 ms for 1000 vertices, 13 ms with a body of 5000, but every pair found costs in every evaluation."""
WIDE = 5.0
"""Margins by which the region may be larger than what is asked, on average, before pairs are searched anew: it is 2
after a search, and more after a search along a path."""

GAPS = (1e-6, 1e-7, 1e-8)
"""Distances that paths keep [m]. Without one, path after path leaves a tenth of what was left, and at 1e-11 m additive
CCD loses the crossing to rounding. A nearer start is left to tight inclusion (Wang et al. 2021), which is slow."""

ipctk.set_logger_level(ipctk.LoggerLevel.error)  # a path from nearer than a gap is no news
ipctk.set_num_threads(1)  # several threads add in another order each time, and are no faster at 6000 vertices

Points = Float[np.ndarray, "points 3"]


class Meeting:
    """Candidates of collision in a set of triangles whose first ``free`` points move, as the filter of ipctk allows.

    Positions are all points, those that move and those that are given, in metres. Candidates (pairs of primitives) are
    those whose boxes come near each other while each point stays in its box of the region; they serve every evaluation
    and every path inside the region, and are found again where positions leave it.

    Args:
        rest: all points at rest [m]; areas and lengths of edges are taken from here.
        faces: of all points.
        free: how many points move, the first ones; derivatives are with respect to them.
        filter: which points may meet.
        reach: distance at which the barrier begins [m]; 0 where only paths are looked at.
        stiffness: κ of the barrier [Pa], see ``barrier``.
    """

    def __init__(
        self,
        rest: Points,
        faces: Int[np.ndarray, "faces 3"],
        free: int,
        filter: ipctk.CollisionFilter,
        reach: float,
        stiffness: float,
    ):
        faces = np.asfortranarray(faces, dtype=np.int32)
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(rest, dtype=np.float64), ipctk.edges(faces), faces)
        self.mesh.can_collide = filter
        self.free = free
        self.reach, self.stiffness = reach, stiffness
        self.potential = ipctk.BarrierPotential(reach, stiffness, True) if reach else None
        self.ccd = ipctk.AdditiveCCD()
        self.searches = 0
        """Number of searches for pairs."""
        edges = np.subtract(*rest[self.mesh.edges[(self.mesh.edges < free).all(axis=1)].T])
        self.margin = MARGIN * float(np.linalg.norm(edges, axis=1).mean())
        self._candidates: ipctk.Candidates | None = None
        self._low = self._high = np.empty((0, 3))
        self._at: Points | None = None
        self._limit_areas()

    def forget(self) -> None:
        """Search again at the next call: sums then depend on what comes from here on alone, to the last bit."""
        self._candidates = self._at = None

    def energy_and_gradient(self, points: Points) -> tuple[float, Float[np.ndarray, "free 3"]]:
        """Barrier [J] and its gradient [N]."""
        near = self.collisions(points)
        if self.potential is None or not len(near):
            return 0.0, np.zeros((self.free, 3))
        gradient = self.potential.gradient(near, self.mesh, points).reshape(-1, 3)
        return float(self.potential(near, self.mesh, points)), gradient[: self.free]

    def hessian(self, points: Points) -> sparse.csr_array:
        """Gauss-Newton Hessian of the barrier [N/m]; all of it, 3 · free rows."""
        near = self.collisions(points)
        return gauss_newton(near, self.mesh, points, self.free, self.reach, self.stiffness)

    def free_share(self, start: Points, end: Points) -> float:
        """The largest share of the straight way that is free of crossings, by additive CCD (Li et al. 2021): 1 if all.

        At the share that is returned a tenth of the distance at the start is left where something would be met, and
        at least the first of ``GAPS`` that the start allows.
        """
        if self._too_short_to_meet(start, end):
            return 1.0
        candidates = self._candidates_for(start, end)
        for gap in GAPS:
            share = float(candidates.compute_collision_free_stepsize(self.mesh, start, end, gap, self.ccd))
            if share > 0.0:
                return share
        exact = ipctk.TightInclusionCCD()
        return float(candidates.compute_collision_free_stepsize(self.mesh, start, end, 0.0, exact))

    def collisions(self, points: Points) -> ipctk.NormalCollisions:
        """Pairs nearer than the reach; those of the last call are kept."""
        if self._at is None or not np.array_equal(points, self._at):
            self._near = ipctk.NormalCollisions()
            self._near.use_area_weighting = True
            if self.reach:
                self._near.build(self._candidates_for(points, points), self.mesh, points, self.reach)
            self._at = points
        return self._near

    def _too_short_to_meet(self, start: Points, end: Points) -> bool:
        """No two points approach each other by nine tenths of the least distance: CCD would find the way free."""
        if not self.reach or self._at is None or not np.array_equal(start, self._at):
            return False
        least = min(self.reach, np.sqrt(self._near.compute_minimum_distance(self.mesh, start)))
        moves = end - start
        moves -= 0.5 * (moves.min(axis=0) + moves.max(axis=0))
        return bool(2.0 * np.linalg.norm(moves, axis=1).max() <= 0.9 * least)

    def _candidates_for(self, start: Points, end: Points) -> ipctk.Candidates:
        low, high = np.minimum(start, end), np.maximum(start, end)
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            raise DrapeError(
                "contact: positions of cloth or body are not finite; expected metres. The simulation diverged before "
                "contact was asked: take smaller steps, or look at the forces"
            )
        if self._candidates is None or not self._serves(low, high):
            low[: self.free] -= self.margin
            high[: self.free] += self.margin
            self._low, self._high = np.asfortranarray(low), np.asfortranarray(high)
            self._candidates = ipctk.Candidates()
            self._candidates.build(self.mesh, self._low, self._high, 0.5 * self.reach, ipctk.LBVH())
            self.searches += 1
        return self._candidates

    def _serves(self, low: Points, high: Points) -> bool:
        """The region holds the boxes, and is not so much larger that its many pairs cost more than a search."""
        holds = (low >= self._low).all() and (high <= self._high).all()
        spare = (self._high - self._low)[: self.free].mean() - (high - low)[: self.free].mean()
        return bool(holds and spare <= WIDE * self.margin)

    def _limit_areas(self) -> None:
        """No point or edge that is given weighs more than a mean one of the cloth: a floor may be two triangles."""
        for kind, is_free in (("vertex_areas", np.arange(self.mesh.num_vertices) < self.free),
                              ("edge_areas", (self.mesh.edges < self.free).all(axis=1))):
            areas = np.array(getattr(self.mesh, kind))
            areas[~is_free] = np.minimum(areas[~is_free], areas[is_free].mean())
            setattr(self.mesh, kind, areas)
