"""Arrays of a fixed size on devices: rows that do not count are masked instead of left out."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def is_fixed(device: torch.device) -> bool:
    """Whether arrays on a device keep their sizes, whatever is near to a body; rows that do not count are masked.

    On a CPU fewer rows are less work. A GPU would have to be asked for their number, and a step of changing sizes
    cannot be recorded (:class:`drape.training.captured_step.CapturedStep`).
    """
    return device.type != "cpu"


def counted(values: Float[Tensor, "near ..."], there: Bool[Tensor, " near"] | None) -> Float[Tensor, "near ..."]:
    """``values`` of rows, 0 for those that are not ``there``; None: all are."""
    return values if there is None else values.masked_fill(~there.view(-1, *[1] * (values.dim() - 1)), 0.0)
