"""The public names: each is there, and a scene is animated with them as the documentation of the package says."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hydra.core.global_hydra import GlobalHydra

import drape


def test_every_name_is_there():
    assert 10 <= len(drape.PUBLIC) <= 20
    for name in drape.PUBLIC:
        assert getattr(drape, name).__doc__
        assert name in dir(drape)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = drape.nothing


def test_a_scene_is_animated():
    """What is far from the pins falls in its first step as implicit Euler says, by ``g dt²``; pins stay."""
    config = drape.compose("animate", "scene=hanging", "energy=phys", "scene.resolution=9", "scene.frames=2")
    scene, fabric = drape.instantiate(config.scene), drape.instantiate(config.energy)
    positions = drape.animate(scene, fabric)
    assert positions.shape == (3, 81, 3)
    np.testing.assert_allclose(positions[1, 40] - positions[0, 40], [0.0, 0.0, -9.81 * scene.dt**2], atol=1e-5)
    assert np.array_equal(positions[2, scene.pins.vertices], positions[0, scene.pins.vertices])


def test_composing_leaves_what_hydra_had():
    before = GlobalHydra.instance().hydra
    assert drape.compose("animate", "fabric=denim").fabric.name == "denim"
    assert GlobalHydra.instance().hydra is before


def test_importing_the_package_loads_no_torch():
    code = "import sys, drape; drape.DrapeError; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("said", "expected"), [({}, "10000"), ({"GOMP_SPINCOUNT": "7"}, "7"), ({"OMP_WAIT_POLICY": "active"}, "None")]
)
def test_threads_sleep_soon_unless_the_user_says_how_they_wait(said: dict[str, str], expected: str):
    code = "import os, drape; print(os.environ.get('GOMP_SPINCOUNT'))"
    kept = {name: value for name, value in os.environ.items() if name not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    told = subprocess.run([sys.executable, "-c", code], check=True, env=kept | said, capture_output=True, text=True)
    assert told.stdout.strip() == expected
