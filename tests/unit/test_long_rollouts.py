"""What long rollouts are judged by: the motion that goes there and back, and energies that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.benchmark.long_rollouts import LongRollouts, largest_rise, prolonged, there_and_back, total_energy
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from tests import garments


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = garments.write(tmp_path_factory.mktemp("garments") / "garments.h5")
    return recorded_scene(GarmentFile(path).sequence("00001"))


def test_there_and_back_and_then_still():
    assert there_and_back(11, 4, 8).tolist() == [0, 1, 2, 3, 2, 1, 0, 1, 2, 2, 2, 2]


def test_body_and_pins_go_the_same_way(scene):
    longer = prolonged(scene, 40, 30)
    shown = there_and_back(40, scene.frames + 1, 30)
    np.testing.assert_array_equal(longer.obstacle.positions, scene.obstacle.positions[shown])
    assert longer.frames == 40
    assert (longer.obstacle.positions[30:] == longer.obstacle.positions[30]).all()
    assert np.abs(np.diff(longer.obstacle.positions[:31], axis=0)).max(axis=(1, 2)).min() > 0.0
    if scene.pins is not None:
        np.testing.assert_array_equal(longer.pins.targets, scene.pins.targets[shown])


def test_energy_of_free_fall_is_kept_and_that_of_stretching_is_added(scene):
    """Of vertices that weigh differently."""
    mass = scene.mass * np.linspace(0.5, 2.0, len(scene.mass))
    scene = replace(scene, mass=mass)
    time = np.arange(20)[:, None, None] * scene.dt
    x = scene.initial.x + time * np.array([0.3, 0.0, 1.0]) + 0.5 * time**2 * scene.gravity
    energy = total_energy(x, scene, [], torch.empty(0))
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-9)

    term = StVK(30.0, 20.0, 1e-3)
    stretched = x.copy()
    stretched[10:] = 1.1 * stretched[10:]
    with_term, without = (total_energy(stretched, scene, terms, torch.empty(0)) for terms in ([term], []))
    added = with_term - without
    assert added[:9] == pytest.approx(added[0], rel=1e-9)
    assert added[9:] == pytest.approx(added[9], rel=1e-6)
    assert added[9] > added[0] + 1e-6


def test_the_largest_rise_is_from_any_earlier_time():
    assert largest_rise(np.array([5.0, 3.0, 4.0, 1.0, 2.5, 2.0])) == pytest.approx(1.5)
    assert largest_rise(np.array([3.0, 2.0, 1.0])) == 0.0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"stand": 0}, "0 < stand < frames"),
        ({"stand": 300}, "0 < stand < frames"),
        ({"sequences": 0}, "at least one sequence"),
        ({"checkpoints": ["nowhere/*.ckpt"]}, "found no file nowhere"),
    ],
)
def test_what_cannot_be_measured_is_refused(change, told, tmp_path):
    (tmp_path / "a.ckpt").touch()
    values = {"checkpoints": [str(tmp_path / "*.ckpt")], "path": "x.h5", "sequences": 1, "frames": 300, "stand": 150}
    with pytest.raises(DrapeError, match=told):
        LongRollouts(**(values | change))
