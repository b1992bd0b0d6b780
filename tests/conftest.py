"""Small cloths for all tests, float64 throughout, and the same random numbers every time."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator

os.environ.setdefault("OMP_NUM_THREADS", "1")  # of torch, here and in commands: more wait for each other in small tests

import numpy as np
import pytest
import torch

from drape.geometry import fixed_size
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.composing import kept_configs


def pytest_collection_finish() -> None:
    """What is there by now stays: not to be gone through again and again while thousands of tests are run."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _configs() -> Iterator[None]:
    with kept_configs():
        yield


@pytest.fixture(autouse=True)
def _seeds() -> None:
    """Every test starts from the same random numbers."""
    torch.manual_seed(0)
    np.random.seed(0)  # noqa: NPY002


@pytest.fixture(scope="session")
def cloth() -> ClothMesh:
    """A square of 1 m, 8 x 8 vertices."""
    return square_grid(1.0, 8)


@pytest.fixture(scope="session")
def small_cloth() -> ClothMesh:
    """A square of 1 m, 3 x 3 vertices: small enough for numerical second derivatives."""
    return square_grid(1.0, 3)


@pytest.fixture(scope="session")
def cloth_batch(cloth: ClothMesh) -> MeshBatch:
    """The 8 x 8 cloth alone."""
    return MeshBatch.from_meshes([cloth])


@pytest.fixture
def fixed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes of arrays stay on the CPU too, as on a device."""
    own = fixed_size.is_fixed
    for module in list(sys.modules.values()):
        if getattr(module, "is_fixed", None) is own:
            monkeypatch.setattr(module, "is_fixed", lambda _: True)


def bent(rest: torch.Tensor, amount: float = 0.3) -> torch.Tensor:
    """Smoothly bent, stretched and twisted positions: no angle and no length change is zero."""
    x, y, _ = rest.unbind(-1)
    return torch.stack([1.1 * x + 0.05 * y * x, y + 0.1 * x**2, amount * (x + 0.7 * y**2 + torch.sin(3 * x * y))], -1)
