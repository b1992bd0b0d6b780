"""Length of an edge relative to the edges that a law was learned on: transfers a law between resolutions."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.geometry.mesh_batch import MeshBatch

WIDEST = 0.5 * torch.pi
"""Angles of an edge of the mesh learned on that the law is asked for at most [rad]."""
SAME = 1e-4
"""Relative difference of scale up to which a mesh counts as the one learned on (positions are stored in float32)."""


ALL = slice(None)


class EdgeScale:
    """S of every edge of a mesh, such that ``S² φp(q/S)`` is the energy of the edge (q = (Δl, α, β)).

    With ``s² = face area at the edge / face area learned on``, strain and curvature of the edge are those of an edge
    learned on with q/s, and the energy per area is the same: this is what a continuum does. A fine mesh has angles
    that stand for curvatures far beyond what was learned, so S grows smoothly with ρ = |(α, β)|/s, ::

        S = s x/tanh(x),  x = ρ/WIDEST

    which keeps the angles of q/S below ``WIDEST`` and lets the energy grow beyond like a square; where φp is a
    quadratic form S cancels, whatever it is. A mesh like the one learned on has ``S = 1`` exactly.

    An edge of the boundary stands for half a strip of cloth, and in the mesh learned on has the stiffness of a whole
    one: a hem. Of its energy :attr:`share` counts, (1 + 1/s)/2: the half strip as it is, and a hem whose stiffness
    stays what it was; or else a cloth would lose its hem as it is refined.
    """

    def __init__(self, mesh: MeshBatch, face_area: float):
        faces = 2.0 - mesh.boundary.to(mesh.rest_lengths.dtype)
        self.rest = (mesh.rest.area / faces / face_area).sqrt()
        self.same = bool(((self.rest - 1.0).abs() < SAME).all())
        self.share = torch.where(mesh.boundary, 0.5 + 0.5 / self.rest, 1.0)

    def at(
        self, q: Float[Tensor, "3 edges"], edges: Int[Tensor, " edges"] | slice = ALL
    ) -> tuple[Tensor | float, Float[Tensor, "2 edges"] | None]:
        """S of ``edges``, and its derivatives in (α, β); a scale of exactly 1 has none."""
        if self.same:
            return 1.0, None
        angles = q[1:]
        # rounded up, so that nothing is divided by zero: x/tanh(x) is 1 and its slope 0 there
        size = (angles.square().sum(0) + 1e-12).sqrt()
        rest = self.rest[edges].to(q.dtype)
        x = size / (rest * WIDEST)
        cotangent = 1.0 / torch.tanh(x)
        slope = cotangent - x * (cotangent.square() - 1.0)
        return rest * x * cotangent, (slope / WIDEST / size) * angles
