"""The order of training windows: a permutation for each epoch, continued where it was left."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from drape.data.loader import WindowLoader


def loader(**changes) -> WindowLoader:
    """23 windows in batches of 4; a batch is the list of its numbers."""
    values = {"num_windows": 23, "batch_size": 4, "seed": 7} | changes
    return WindowLoader(list, **values)


def test_every_epoch_is_another_permutation_that_depends_on_the_seed_only():
    """Full batches of different windows, another order in each epoch, the same for the same seed."""
    one, same, other = loader(), loader(), loader(seed=8)
    epochs = [list(one), list(one), list(one)]
    assert [len(batches) for batches in epochs] == [5, 5, 5]
    for batches in epochs:
        assert len(set(np.concatenate(batches))) == 20
    assert epochs[0] != epochs[1]
    assert epochs == [list(same), list(same), list(same)]
    assert epochs[0] != list(other)


def test_an_iteration_that_is_left_before_its_end_does_not_shorten_the_next():
    """Lightning takes len(loader) batches and no more, or fewer where it is told so."""
    trained, whole = loader(), loader()
    assert list(islice(trained, 5)) == list(whole)
    assert list(islice(trained, 2)) == list(whole)[:2]
    assert list(trained) == list(whole)


@pytest.mark.parametrize("stop", [0, 2, 5])
def test_continued_from_its_state(stop):
    """A new loader with the state of one that stopped gives the rest of the epoch, then the next epoch."""
    first = loader()
    list(first)
    taken = iter(first)
    begun = [next(taken) for _ in range(stop)]
    continued = loader()
    continued.load_state_dict(first.state_dict())
    reference = loader()
    list(reference)
    expected = list(reference)
    if 0 < stop < 5:
        assert begun + list(continued) == expected
        assert list(continued) == list(reference)
    elif stop == 5:
        assert list(continued) == list(reference)
    else:
        assert list(continued) == expected


def test_order_of_the_file_without_a_seed():
    """Every window, the last batch short, every time from the beginning."""
    plain = loader(seed=None)
    assert len(plain) == 6
    assert next(iter(plain)) == [0, 1, 2, 3]
    assert np.concatenate(list(plain)).tolist() == list(range(23))


def test_processes_share_the_batches():
    """Two processes see different batches, together those of one."""
    whole = list(loader())
    shares = [list(loader(rank=rank, world_size=2)) for rank in (0, 1)]
    assert [len(share) for share in shares] == [2, 2]
    assert [shares[0][0], shares[1][0], shares[0][1], shares[1][1]] == whole[:4]
    tested = [np.concatenate(list(loader(seed=None, rank=rank, world_size=2))).tolist() for rank in (0, 1)]
    assert sorted(tested[0] + tested[1]) == list(range(23))


def test_groups_stay_together_and_show_all_their_windows():
    """Members with fewer windows show them again; batches of the groups are mixed, anew in each epoch."""
    groups = [[np.arange(6), np.arange(6, 10)], [np.arange(10, 15), np.arange(10, 15)]]
    whole = loader(num_windows=15, batch_size=2, groups=groups)
    epochs = [list(whole), list(whole)]
    for batches in epochs:
        assert len(batches) == len(whole) == 10
        first, second = ([batch for batch in batches if (batch[0] < 10) == own] for own in (True, False))
        assert len({one for one, _ in first}) == len(first) == 5, "of six windows five, each once"
        assert {other for _, other in first} == {6, 7, 8, 9}
        assert np.bincount(np.concatenate(second)).tolist() == [0] * 10 + [2] * 5
        assert any(one != other for one, other in second), "members are shuffled each for itself"
    assert epochs[0] != epochs[1]
    assert {batch[0] >= 10 for batch in epochs[0][:5]} == {True, False}, "not group after group"
    continued = loader(num_windows=15, batch_size=2, groups=groups)
    continued.load_state_dict({"epoch": 1, "next": 4})
    assert list(continued) == epochs[1][4:]
