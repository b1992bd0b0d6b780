"""From accelerations to positions."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step


def advance(network: nn.Module, step: Step) -> Float[Tensor, "vertices 3"]:
    """``x' = x + dt (v + dt a)`` with a = network(step) [m/s²] (paper, appendix), in the precision of the step.

    Pinned vertices go where they are led, ``x + dt v``.
    """
    acceleration = torch.where(step.free[:, None], network(step).to(step.x.dtype), 0.0)
    return step.x + step.dt * (step.v + step.dt * acceleration)
