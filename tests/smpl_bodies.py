"""A body with SMPL's joints and hardly any vertices, stored as the user's own model would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drape.data.smpl.body_model import JOINTS, SmplModel

PARENTS = np.array([-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21])


def small_model(seed: int = 0, vertices: int = 30, **changes: np.ndarray) -> SmplModel:
    """A cloud of vertices: everything random but the topology."""
    rng = np.random.default_rng(seed)
    regressor, weights = rng.random((JOINTS, vertices)), rng.random((vertices, JOINTS))
    arrays = {
        "rest_positions": rng.normal(size=(vertices, 3)),
        "faces": np.arange(vertices).reshape(-1, 3),
        "shape_directions": rng.normal(size=(vertices, 3, 12)),
        "pose_directions": rng.normal(size=(vertices, 3, 207)),
        "joint_regressor": regressor / regressor.sum(axis=1, keepdims=True),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "parents": PARENTS,
    }
    return SmplModel(**(arrays | changes))


def save_model(path: Path, body: SmplModel, **changes: np.ndarray | None) -> Path:
    """As ``drape.data.smpl.convert_pickle`` stores it; None: without this array."""
    arrays = {name: getattr(body, name) for name in SmplModel.__dataclass_fields__} | changes
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path
