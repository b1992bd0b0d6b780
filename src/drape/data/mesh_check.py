"""Check the numbers of a body or a garment: finite, indices in range, masses above 0, weights that sum to 1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drape.data.schema import AGAIN
from drape.errors import DrapeError
from drape.stored import sound

SUM_ERROR = 1e-3
"""Skinning weights of a vertex sum to 1 within this."""


def check_mesh(arrays: Mapping[str, np.ndarray], where: str) -> None:
    """Rest positions are finite, ``faces`` and ``pinned`` are vertices of the mesh.

    Raises:
        DrapeError: opens with ``where``.
    """
    _check_finite(arrays, "rest_positions", where)
    vertices = len(arrays["rest_positions"])
    for name in ("faces", "pinned"):
        values = arrays.get(name, np.zeros(0, np.int64))
        if values.size and not (values.min() >= 0 and values.max() < vertices):
            bad = values[(values < 0) | (values >= vertices)][0]
            raise DrapeError(f"{where}/{name}: found vertex {bad}; expected 0..{vertices - 1}; {AGAIN}")


def check_masses(mass: np.ndarray, where: str) -> None:
    """Masses are positive numbers.

    Raises:
        DrapeError: opens with ``where``.
    """
    if not (np.isfinite(mass).all() and (mass > 0).all()):
        raise DrapeError(f"{where}/mass: found {mass.min()}; expected positive numbers [kg]; {AGAIN}")


def check_weights(arrays: Mapping[str, np.ndarray], where: str) -> int:
    """Number of joints that the skinning weights need; they are shares of 1 for every vertex.

    Raises:
        DrapeError: opens with ``where``.
    """
    for here, missing in (("bones", "weights"), ("weights", "bones")):
        if missing not in arrays:
            raise DrapeError(f"{where}: found {here} alone; expected bones and weights, or neither; {AGAIN}")
    _check_finite(arrays, "weights", where)
    weights, bones = arrays["weights"], arrays["bones"]
    sums = weights.sum(axis=1)
    worst = int(np.argmax(np.abs(sums - 1.0)))
    if weights.min() < 0 or abs(sums[worst] - 1.0) > SUM_ERROR:
        raise DrapeError(
            f"{where}/weights: vertex {worst}: found a sum of {sums[worst]:g} (least weight {weights.min():g}); "
            f"expected shares of 1; {AGAIN}"
        )
    if bones.min() < 0:
        raise DrapeError(f"{where}/bones: found joint {bones.min()}; expected 0 or more; {AGAIN}")
    return int(bones.max()) + 1


def _check_finite(arrays: Mapping[str, np.ndarray], name: str, where: str) -> None:
    usable = sound(arrays[name])
    if not usable.all():
        vertex = int(np.argmin(usable.all(axis=-1)))
        raise DrapeError(
            f"{where}/{name}: vertex {vertex}: found {arrays[name][vertex]}; expected finite numbers; {AGAIN}"
        )
