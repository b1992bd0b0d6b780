"""Devices that are not there are refused with a sentence."""

from __future__ import annotations

import pytest
import torch

from drape.errors import DrapeError
from drape.simulators.device import check_device


def test_a_device_is_there_or_refused_with_a_sentence():
    check_device("cpu")
    with pytest.raises(DrapeError, match=r"simulator\.device: found 'tpu'; expected cpu, or .* use simulator\.device="):
        check_device("tpu")
    if not torch.cuda.is_available():
        with pytest.raises(DrapeError, match=r"simulator\.device: found 'cuda'; expected cpu"):
            check_device("cuda")
