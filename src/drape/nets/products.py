"""The library that multiplies the matrices of networks on a CPU."""

from __future__ import annotations

import torch


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
