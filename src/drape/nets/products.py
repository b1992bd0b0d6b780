"""Products of the matrices of networks: by which library, of how many bits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def products_of_training() -> Iterator[None]:
    """Products of a training; afterwards they are as they were, as what comes next in a sweep may need others.

    Where weights are rounded for products (``+trainer.precision=bf16-mixed``), they are so each time. PyTorch would
    keep the rounded ones to the end of a training step, which may have several updates, or is captured and replayed.
    """
    before, kept = torch.get_float32_matmul_precision(), torch.is_autocast_cache_enabled()
    torch.set_autocast_cache_enabled(False)
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)
        torch.set_autocast_cache_enabled(kept)


def multiply_by_onednn() -> bool:
    """Let oneDNN multiply float32 matrices on a CPU, from now on, if it keeps all their bits; whether it does.

    MKL, which PyTorch asks otherwise, uses half the width of AMD's units. PyTorch hands products over to oneDNN where
    it may round factors to bfloat16; oneDNN rounds only on a CPU with units for such matrices (Intel's AMX, some of
    ARM's). One product tells, and if it is rounded, all stays as it was. Each new size costs half a millisecond: for
    trainings whose sizes stay.
    """
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("medium")
    factor = torch.full((64, 64), 1.0 + 2.0**-20)
    kept = torch.equal(factor @ torch.eye(64), factor)
    if not kept:
        torch.set_float32_matmul_precision(before)
    return kept


def round_products(device: torch.device) -> None:
    """Matrix products of networks on a GPU with 10 bits of each factor, several times as fast; nothing on a CPU.

    A prediction of 10 m/s² that is a thousandth off moves a vertex by 10 µm in a frame. Energies have no such products.
    """
    if device.type == "cuda":
        torch.set_float32_matmul_precision("high")
