"""The body pushes the cloth away."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.nearest_faces import NearestFaces
from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.errors import DrapeError


class Contact(EnergyTerm):
    """``stiffness · Σ max(thickness - d, 0)³`` [J] (paper, appendix; FACTS 3.4).

    ``d = (x' - p') · n'`` is the signed distance of a vertex from the plane of the body face that is nearest to it at
    t, with the point p' and the outward normal n' of this face at t + dt. The energy is convex in x', and only the
    vertices near the body at t take part. The body is an open or closed surface with normals to the outside.

    Args:
        stiffness: [N/m²]; the default is what HOOD trains with in the end. The force on a vertex is
            ``3 · stiffness · (thickness - d)²``: 6 N on the surface itself.
        thickness: distance from the body at which the force begins [m].
        search_range: how far away from the body a vertex at t is looked at [m]; at least what cloth and body
            can move towards each other within a step.

    Raises:
        DrapeError: a number that is not positive and finite, or ``search_range < thickness``.
    """

    name = "contact"

    def __init__(self, stiffness: float = 5e5, thickness: float = 2e-3, search_range: float = 0.1):
        super().__init__()
        if not (0 < stiffness < math.inf and 0 < thickness <= search_range < math.inf):
            raise DrapeError(
                f"energy term contact: stiffness {stiffness} N/m², thickness {thickness} m, search_range "
                f"{search_range} m; expected finite numbers with stiffness > 0 and 0 < thickness <= search_range"
            )
        self.stiffness = stiffness
        self.thickness = thickness
        self.search_range = search_range

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        near = step.nearest_faces(self.search_range)
        return step.sum_stencils(self.stiffness * self._depth(x_next, near) ** 3, near.vertices)

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        near = step.nearest_faces(self.search_range)
        depth = self._depth(x_next.detach(), near)
        push = self.normal_force(depth)
        gradient = torch.zeros_like(x_next).index_add(0, near.vertices, -push[:, None] * near.end.normal)
        return step.sum_stencils(push * depth / 3.0, near.vertices), gradient

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """``6 · stiffness · (thickness - d) n' n'ᵀ``: exact."""
        near = step.nearest_faces(self.search_range)
        curvature = 6.0 * self.stiffness * self._depth(x_next.detach(), near)
        normal = near.end.normal
        blocks = curvature[:, None, None] * normal[:, :, None] * normal[:, None, :]
        return [Stencils(near.vertices[:, None], blocks[:, None, :, None, :])]

    def normal_force(self, depth: Float[Tensor, " near"]) -> Float[Tensor, " near"]:
        """``3 · stiffness · depth²`` [N] of vertices ``depth`` [m] closer to the body than the thickness."""
        return 3.0 * self.stiffness * depth.square()

    def depth_at_start(self, near: NearestFaces) -> Float[Tensor, " near"]:
        """max(thickness - d, 0) of the vertices at t [m]."""
        return (self.thickness - near.height).clamp(min=0.0)

    def _depth(self, x_next: Tensor, near: NearestFaces) -> Float[Tensor, " near"]:
        arm = x_next[near.vertices] - near.end.point
        return (self.thickness - (arm * near.end.normal).sum(-1)).clamp(min=0.0)
