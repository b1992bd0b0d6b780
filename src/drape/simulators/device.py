"""The device on which energies are evaluated, checked before anything is put there."""

from __future__ import annotations

import torch

from drape.errors import DrapeError


def check_device(name: str) -> None:
    """Refuse a device that this PyTorch does not know, or that this machine does not have.

    Raises:
        DrapeError: it, with what PyTorch says of it.
    """
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:  # the latter where PyTorch was built without it
        reason = str(error).splitlines()[0].partition(", ipu")[0]
        raise DrapeError(
            f"simulator.device: found {name!r}; expected cpu, or an accelerator that PyTorch sees here, as cuda "
            f"({reason}); use simulator.device=cpu"
        ) from error
