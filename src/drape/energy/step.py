"""A time step before its end: all that the energy terms of an incremental potential depend on."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.surface_points import SurfacePoints

Kept = TypeVar("Kept")


@dataclass(frozen=True, eq=False)
class ObstacleStep:
    """The bodies of a batch over one step as one big triangle mesh."""

    faces: Int[Tensor, "body_faces 3"]
    x: Float[Tensor, "body_vertices 3"]
    """Positions at t [m]."""
    x_next: Float[Tensor, "body_vertices 3"]
    """Positions at t + dt [m]."""
    mesh_of_face: Int[Tensor, " body_faces"]
    """The cloth of the batch that the face is the obstacle of."""


@dataclass(frozen=True, eq=False)
class Step:
    """The step from t to t + dt of one or several cloths; positions at t + dt are what is looked for."""

    mesh: MeshBatch
    x: Float[Tensor, "vertices 3"]
    """Positions at t [m]."""
    v: Float[Tensor, "vertices 3"]
    """Velocities at t [m/s]."""
    mass: Float[Tensor, " vertices"]
    """Mass of each vertex [kg]."""
    free: Bool[Tensor, " vertices"]
    """False where a vertex is pinned."""
    attributes: Float[Tensor, "meshes attributes"]
    """The vector **a** of each cloth's fabric, scaled."""
    gravity: Float[Tensor, "3"]
    """[m/s²]"""
    dt: float
    """Time step [s]."""
    external_force: Float[Tensor, "vertices 3"] | None = None
    """Constant over the step [N]."""
    obstacle: ObstacleStep | None = None
    touching: SurfacePoints | None = None
    """The points of the cloth that can touch bodies, its vertices first; None for the vertices alone."""
    fabric: Sequence[nn.Module] = ()
    """The energies of the fabric, of class :class:`drape.energy.term.EnergyTerm`; () for a network that asks none."""

    @cached_property
    def geometry(self) -> EdgeGeometry:
        """Geometry of the edges at t."""
        return EdgeGeometry(self.x, self.mesh)

    @cached_property
    def inertial(self) -> Float[Tensor, "vertices 3"]:
        """x̂ = x + dt v: where the cloth would be without forces [m] (paper, after eq. 11)."""
        return self.x + self.dt * self.v

    @cached_property
    def surface(self) -> SurfacePoints:
        """The points of the cloth that can touch bodies: ``touching``, or the vertices."""
        return SurfacePoints.of(self.mesh) if self.touching is None else self.touching

    @property
    def body(self) -> ObstacleStep:
        """The ``obstacle`` of a step that has one.

        Raises:
            DrapeError: a step without obstacle.
        """
        if self.obstacle is None:
            raise DrapeError("nearest faces: the step has no obstacle; add terms of contact only to scenes with one")
        return self.obstacle

    @cached_property
    def near(self) -> NearestFaces:
        """The face of the bodies that each point of ``surface`` is nearest to at t; searched once, for all who ask.

        The first points are the vertices.

        Raises:
            DrapeError: a step without obstacle.
        """
        body, points = self.body, self.surface.at(self.x)
        return NearestFaces.find(points, self.surface.mesh_of_point, body.faces, body.mesh_of_face, body.x, body.x_next)

    def near_vertices(self, reach: float) -> NearestFaces:
        """Of ``near`` the vertices at most ``reach`` [m] from the body; their ``points`` are numbers of vertices."""
        return self.once(("vertices", reach), lambda: self.near.within(reach, self.mesh.num_vertices))

    def once(self, key: Hashable, make: Callable[[], Kept]) -> Kept:
        """The result of ``make``, made once for this step."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def with_near(self, near: NearestFaces, surface: SurfacePoints | None = None) -> Step:
        """The same step with other nearest faces than those at t, of the points of another ``surface``."""
        step = replace(self)
        step.__dict__.update(near=near, surface=surface or self.surface)
        return step

    @cached_property
    def _kept(self) -> dict[Hashable, Any]:
        return {}

    def sum_stencils(self, per_stencil: Float[Tensor, " stencils"], vertex: Int[Tensor, " stencils"]) -> Tensor:
        """Sum energies of stencils over the meshes that their vertices belong to, in float64.

        Single precision would drown the last improvements of a line search in the rounding of a long sum.
        """
        per_stencil = per_stencil.double()
        if self.mesh.num_meshes == 1:
            return per_stencil.sum()[None]
        total = per_stencil.new_zeros(self.mesh.num_meshes)
        return total.index_add(0, self.mesh.mesh_of_vertex[vertex], per_stencil)
