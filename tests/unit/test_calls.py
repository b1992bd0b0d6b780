"""Operations and waits of a program, counted."""

from __future__ import annotations

import torch

from drape.benchmark.calls import calls


def test_operations_and_waits_of_a_small_program():
    """A sum, a product and its transpose, which is a view; its value is asked for, and where it is not 0."""
    x = torch.ones(3, 3)

    def run() -> None:
        y = (x + x).mul(2.0)[:2].T
        y.sum().item()
        y.nonzero()

    assert calls(run) == {"operations": 5, "waits": 2}
    assert calls(lambda: x.view(9)[:3][0].detach()) == {"operations": 0, "waits": 0}
