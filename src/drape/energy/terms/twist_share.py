"""The share of an edge's twist that counts: all of it, but for normals that nearly lie along the edge."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

FADES_BELOW = 0.25
"""Of :attr:`EdgeDeformation.upright`. Sheets that are learned from stay above 0.9."""


def twist_share(upright: Float[Tensor, " edges"]) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
    """The weight w of the twist, from 0 at ``upright = 0`` to 1 from ``FADES_BELOW`` on, and its slope.

    The twist α is an angle between projections along the edge. A normal that passes through the edge's own direction
    has none, and α jumps by up to half a turn: an energy that sees it has cliffs, which crumpled cloth runs against
    and no line search gets over. ``w φ(Δl, α, β) + (1 - w) φ(Δl, 0, β)`` with ``w = t² (3 - 2t)``, t = upright /
    FADES_BELOW, is continuously differentiable there, and φ itself everywhere else.
    """
    t = (upright / FADES_BELOW).clamp(max=1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / FADES_BELOW
