"""Small data sets of trajectories, of random numbers."""

from __future__ import annotations

import numpy as np

from drape.data import schema
from drape.data.hdf5_writer import DatasetHeader, StoredSequence
from drape.geometry.grid import square_grid

SETTINGS = dict.fromkeys(schema.MATERIAL_ATTRIBUTES, 1.0) | {"preset": "Silk", "mass_per_vertex": 0.15}


def header(**changes: object) -> DatasetHeader:
    values = {
        "mesh": square_grid(1.0, 4),
        "pinned": np.array([0, 3]),
        "materials": {"silk": SETTINGS, "denim": SETTINGS | {"preset": "Denim", "mass_per_vertex": 1.0}},
        "fps": 30.0,
        "gravity": (0.0, 0.0, -9.81),
        "seed": 3,
        "blender_version": "5.0.1",
        "config": "data: {}",
    }
    return DatasetHeader(**(values | changes))


def sequences(count: int = 4, frames: int = 5) -> list[StoredSequence]:
    rng = np.random.default_rng(0)
    rows = [rng.normal(size=(frames, 16, 3)).astype(np.float32) for _ in range(count)]
    return [StoredSequence(x, fabric=i % 2, split=int(i >= 3), attempts=1 + i) for i, x in enumerate(rows)]
