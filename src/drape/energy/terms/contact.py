"""The body pushes the cloth away."""

from __future__ import annotations

import copy
import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.contact.coarseness import point_spacing
from drape.contact.sharp_points import SharpPoints
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Kernel, Stencils, array
from drape.energy.terms import point_kernel
from drape.energy.terms.point_stencils import point_stencils
from drape.errors import DrapeError
from drape.geometry.fixed_size import counted
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_faces import NearestFaces
from drape.geometry.surface_points import ChosenPoints, SurfacePoints
from drape.linalg.stencil_sum import Filled
from drape.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Touch:
    """Points near a body over a step."""

    faces: NearestFaces
    points: ChosenPoints
    stiffness: Float[Tensor, " near"]
    """k of each point [N/m²]."""

    @cached_property
    def compiled(self) -> point_kernel.Points:
        """As the kernels need it."""
        end = self.faces.end
        parts = self.points.weights, end.point, end.normal, end.tangents, self.faces.along
        return point_kernel.Points(self.points.vertices.numpy(), *(array(part) for part in parts))


class Contact(EnergyTerm):
    """``Σ k_p max(thickness - d_p, 0)³`` [J] over points p of the surface (paper, eq. 24).

    ``d = (y' - b') · n'`` is the signed distance of a point y' from the plane of the body face that is nearest to it at
    t, with the point b' and the outward normal n' of this face at t + dt. The energy is convex in x', and only points
    near the body at t take part. The body is an open or closed surface with normals to the outside.

    Args:
        thickness: distance from the body at which the force begins [m].
        reach: points farther from the body at t take no part [m]; at least what cloth and body can move towards each
            other within a step.

    Raises:
        DrapeError: a number that is not positive and finite, or ``reach < thickness``.
    """

    name = "contact"
    per_edge = per_face = 0
    """Points of the cloth's edges and faces that touch the body, beside its vertices."""

    def __init__(self, stiffness: float, thickness: float, reach: float):
        super().__init__()
        if not (0 < stiffness < math.inf and 0 < thickness <= reach < math.inf):
            raise DrapeError(
                f"energy term contact: stiffness {stiffness}, thickness {thickness} m, reach {reach} m; expected "
                "finite numbers with stiffness > 0 and 0 < thickness <= reach"
            )
        self.stiffness: float | Tensor = stiffness
        self.thickness, self.reach = thickness, reach

    @abstractmethod
    def point_stiffness(self, step: Step, points: ChosenPoints) -> Float[Tensor, " points"]:
        """Stiffness k of each point [N/m²]."""

    def enlarged(self, times: float) -> Contact:
        """The same contact in a scene that is so many times its real size: lengths grow with it."""
        grown = copy.copy(self)
        grown.thickness, grown.reach = times * self.thickness, times * self.reach
        return grown

    def stiffened(self, times: float | Tensor) -> Contact:
        """The same contact, so many times as stiff."""
        changed = copy.copy(self)
        changed.stiffness = times * self.stiffness
        return changed

    def beside(self, scene: Scene) -> list[tuple[EnergyTerm, str]]:
        """Further terms of this contact, and why a scene requires them."""
        return []

    def surface(self, mesh: MeshBatch) -> SurfacePoints:
        """The points of cloths that touch bodies."""
        return SurfacePoints.of(mesh, self.per_edge, self.per_face)

    def sharp_points(self, scene: Scene) -> SharpPoints | None:
        """The points of the body that are asked too, where this contact asks any and the scene needs them."""
        return None

    def near(self, step: Step) -> NearestFaces:
        """The points that take part, and their faces.

        Raises:
            DrapeError: a step without obstacle.
        """
        return step.near.within(self.reach)

    def touch(self, step: Step) -> Touch:
        """The same, made ready for many evaluations; once a step."""
        return step.once((self, "touch"), lambda: self._touch(step, self.near(step)))

    def pressed(self, step: Step) -> tuple[Touch, Float[Tensor, " pressed"]]:
        """The points that the contact pushes at t, and how strongly [N]; once a step."""
        return step.once((self, "pressed"), lambda: self._pressed(step))

    def _touch(self, step: Step, near: NearestFaces) -> Touch:
        points = step.surface.chosen(near.points, step.mesh.num_vertices)
        return Touch(near, points, counted(self.point_stiffness(step, points).to(near.distance), near.there))

    def _pressed(self, step: Step) -> tuple[Touch, Float[Tensor, " pressed"]]:
        near = self.near(step)
        touch = self._touch(step, near.where(near.height < self.thickness))
        return touch, 3.0 * touch.stiffness * (self.thickness - touch.faces.height).square()

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        touch = self.touch(step)
        return step.sum_stencils(touch.stiffness * self._depth(x_next, touch) ** 3, touch.points.first_vertex)

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        touch = self.touch(step)
        depth = self._depth(x_next.detach(), touch)
        push = 3.0 * touch.stiffness * depth.square()
        gradient = touch.points.spread(-push[:, None] * touch.faces.end.normal)
        return step.sum_stencils(push * depth / 3.0, touch.points.first_vertex), gradient

    def kernel(self, step: Step) -> Kernel | None:
        if step.x.device.type != "cpu":
            return None
        given = self._compiled(step)
        return lambda x: point_kernel.contact(x, *given)

    def _compiled(self, step: Step) -> tuple[point_kernel.Points, np.ndarray, float]:
        """Arrays of a step for the kernels."""
        touch = self.touch(step)
        return touch.compiled, step.once((self, "stiffness"), lambda: array(touch.stiffness)), self.thickness

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils | Filled]:
        """``6 k (thickness - d) n' n'ᵀ`` of each point: exact."""
        touch = self.touch(step)
        if x_next.device.type == "cpu":
            found = point_kernel.contact_blocks(array(x_next), *self._compiled(step))
            pushed, blocks = map(torch.from_numpy, found)
            return point_stencils(touch.points, blocks.to(x_next.dtype), pushed)
        curvature = 6.0 * touch.stiffness * self._depth(x_next.detach(), touch)
        pushed = curvature.nonzero()[:, 0]
        normal = touch.faces.end.normal[pushed]
        blocks = curvature[pushed, None, None] * normal[:, :, None] * normal[:, None, :]
        return point_stencils(touch.points, blocks, pushed)

    def _depth(self, x_next: Tensor, touch: Touch) -> Float[Tensor, " near"]:
        end = touch.faces.end
        return (self.thickness - ((touch.points.at(x_next) - end.point) * end.normal).sum(-1)).clamp(min=0.0)


class PaperContact(Contact):
    """Contact of the paper: of vertices only, with the same ``stiffness`` [N/m²] whatever a vertex weighs.

    The default stiffness is what HOOD trains with in the end: 6 N on the surface itself.
    """

    def __init__(self, stiffness: float = 5e5, thickness: float = 2e-3, reach: float = 0.1):
        super().__init__(stiffness, thickness, reach)

    def near(self, step: Step) -> NearestFaces:
        return step.near_vertices(self.reach)

    def point_stiffness(self, step: Step, points: ChosenPoints) -> Float[Tensor, " points"]:
        return self.stiffness * torch.ones_like(points.first_vertex, dtype=step.x.dtype)


class SurfaceContact(Contact):
    """Contact of the surface of the cloth: of its vertices and of points of its edges and faces.

    And of the points of the cloth that are nearest to corners and sharp edges of the body, and to what of it is too
    curved for a cloth as coarse: :class:`SharpPoints`.

    ``k_p = stiffness · m_p`` with the mass m_p that the point carries, so that fabrics of any weight sink in alike:
    lying flat by ``sqrt(g / (3 stiffness))``.

    Args:
        stiffness: [1/(m s²)], i.e. N/m² for each kg.
        per_edge: points inside each edge of the cloth.
        per_face: points inside each face of the cloth: 0, 1 or 3.

    Raises:
        DrapeError: as :class:`Contact`; or numbers of points that there are not.
    """

    def __init__(
        self,
        stiffness: float = 2e7,
        thickness: float = 5e-3,
        reach: float = 0.2,
        per_edge: int = 1,
        per_face: int = 0,
    ):
        super().__init__(stiffness, thickness, reach)
        if per_edge < 0 or per_face not in (0, 1, 3):
            raise DrapeError(
                f"energy term contact: found per_edge {per_edge}, per_face {per_face}; expected a number of points "
                "from 0 on inside each edge, and 0, 1 or 3 inside each face"
            )
        self.per_edge, self.per_face = per_edge, per_face
        self._sharp: tuple[Scene, float, SharpPoints | None] | None = None

    def sharp_points(self, scene: Scene) -> SharpPoints | None:
        if scene.obstacle is None:
            return None
        if self._sharp is None or self._sharp[0] is not scene or self._sharp[1] != self.thickness:
            spacing = point_spacing(scene.mesh, self.per_edge)
            self._sharp = scene, self.thickness, SharpPoints.of(scene.obstacle, spacing, self.thickness)
        return self._sharp[2]

    def point_stiffness(self, step: Step, points: ChosenPoints) -> Float[Tensor, " points"]:
        return self.stiffness * points.mass(step.mass)
