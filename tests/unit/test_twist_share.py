"""How the twist fades out where a normal lies along its edge."""

from __future__ import annotations

import pytest
import torch

from drape.energy.terms.elastic import FADES_BELOW, twist_share


def test_the_share_is_a_smooth_step():
    """0, 5/32, 1/2, 1 at 0, 1/4, 1/2 and from 1 of the range on; flat at both ends, 3/2 in the middle."""
    part = torch.tensor([0.0, 0.25, 0.5, 1.0, 3.0], dtype=torch.float64)
    share, slope = twist_share(part * FADES_BELOW)
    assert share.tolist() == pytest.approx([0.0, 5 / 32, 0.5, 1.0, 1.0])
    assert (slope * FADES_BELOW).tolist() == pytest.approx([0.0, 1.125, 1.5, 0.0, 0.0])
