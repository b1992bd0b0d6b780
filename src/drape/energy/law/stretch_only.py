"""A law without its bending: what is left of a fabric when its edges feel their lengths alone."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.edge_law import EdgeLaw, Slopes

KEPT = torch.tensor([1.0, 0.0, 0.0])


class StretchOnly(EdgeLaw):
    """``φp(Δl, 0, 0)`` of another law, and its φd: no gradient from bending (the paper's ablation, appendix)."""

    def __init__(self, law: EdgeLaw):
        super().__init__()
        self.law = law
        self.face_area, self.dt, self.dissipates, self.bends = law.face_area, law.dt, law.dissipates, False

    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.law.potential(q * KEPT.to(q), attributes)

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.law.drag(speed, attributes)

    def potential_slopes(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"], *, hessian: bool
    ) -> Slopes:
        kept = KEPT.to(q)
        full = self.law.potential_slopes(q * kept, attributes, hessian=hessian)
        blocks = None if full.hessian is None else full.hessian * kept[:, None] * kept
        return Slopes(full.energy, full.gradient * kept, blocks)

    def drag_slopes(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        return self.law.drag_slopes(speed, attributes)
