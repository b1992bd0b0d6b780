"""The metric of the solver against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import sparse

from drape.energy.term import Stencils
from drape.simulators.metric import MEMORY, Metric

COUNT = 5


def positive(rng: np.random.Generator, size: int) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return root @ root.T + np.eye(size)


def local_at(rng: np.random.Generator, vertices: list[int]) -> list[Stencils]:
    blocks = np.stack([positive(rng, 3) for _ in vertices])
    return [Stencils(torch.tensor(vertices)[:, None], torch.from_numpy(blocks)[:, None, :, None, :])]


def dense(local: list[Stencils]) -> np.ndarray:
    full = np.zeros((3 * COUNT, 3 * COUNT))
    for vertex, block in zip(local[0].vertices[:, 0].tolist(), local[0].blocks[:, 0, :, 0].numpy(), strict=True):
        full[3 * vertex : 3 * vertex + 3, 3 * vertex : 3 * vertex + 3] += block
    return full


@pytest.mark.parametrize("pairs", [0, 3, MEMORY + 2])
@pytest.mark.parametrize("again", [False, True])
def test_solutions_with_other_local_terms_are_those_of_the_corrected_matrix(pairs, again):
    rng = np.random.default_rng(0)
    free = torch.tensor([True, True, False, True, True])
    slots = np.flatnonzero(np.repeat(free.numpy(), 3))
    truth, start = positive(rng, 3 * COUNT), positive(rng, 3 * COUNT)
    metric = Metric(free)
    metric.factorise(sparse.csr_array(np.triu(start)), local_at(rng, [0, 2]))
    remembered = []
    for _ in range(pairs):
        change = rng.normal(size=(COUNT, 3)) * free.numpy()[:, None]
        turn = (truth @ change.reshape(-1)).reshape(COUNT, 3)
        metric.remember(torch.from_numpy(change), torch.from_numpy(turn))
        metric.solve_with(local_at(rng, [1]), torch.from_numpy(change), 0.1)
        remembered.append((change.reshape(-1)[slots], turn.reshape(-1)[slots]))
    expected = start[np.ix_(slots, slots)]
    for change, turn in remembered[-MEMORY:]:
        image = expected @ change
        expected += np.outer(turn, turn) / (turn @ change) - np.outer(image, image) / (image @ change)
    local = local_at(rng, [1, 3])
    if again:
        metric.factorise_again(local)
    right = torch.from_numpy(rng.normal(size=(COUNT, 3))) * free[:, None]
    found, image = metric.solve_with(local, right, 1e-12)
    total = expected + dense(local)[np.ix_(slots, slots)]
    np.testing.assert_allclose(total @ found.reshape(-1).numpy()[slots], right.reshape(-1).numpy()[slots], atol=1e-7)
    np.testing.assert_allclose(image.reshape(-1).numpy()[slots], expected @ found.reshape(-1).numpy()[slots], atol=1e-7)
    assert not found[~free].any()
