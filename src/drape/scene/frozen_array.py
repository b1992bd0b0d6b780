"""Arrays of frozen dataclasses: copied, in one precision, read-only, finite."""

from __future__ import annotations

import numpy as np

from drape.errors import DrapeError

AXES = {1: ("entry",), 2: ("vertex",), 3: ("frame", "vertex")}
"""Names of the leading axes of an array, by number of dimensions."""


def frozen_floats(values: object, shape: tuple[int | None, ...], what: str) -> np.ndarray:
    """``values`` as a read-only float64 copy of the given shape (None: any length from 1 on), all finite.

    Raises:
        DrapeError: another shape, no numbers, NaN or infinity. ``what`` opens the sentence.
    """
    try:
        array = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise DrapeError(f"{what}: found {values!r}; expected numbers of shape {_shown(shape)}") from None
    fits = array.ndim == len(shape) and all(
        found == expected or (expected is None and found > 0)
        for found, expected in zip(array.shape, shape, strict=True)
    )
    if not fits:
        raise DrapeError(f"{what}: found shape {array.shape}; expected {_shown(shape)}")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        names = AXES[array.ndim]
        where = ", ".join(f"{name} {index}" for name, index in zip(names, bad[: len(names)].tolist(), strict=True))
        raise DrapeError(f"{what}: {where}: found {array[tuple(bad[: len(names)])]}; expected finite numbers")
    array.setflags(write=False)
    return array


def frozen_indices(values: object, shape: tuple[int | None, ...], what: str) -> np.ndarray:
    """``values`` as a read-only int64 copy of the given shape (None: any length from 1 on), none negative.

    Raises:
        DrapeError: another shape, numbers that are not whole, a negative index. ``what`` opens the sentence.
    """
    array = frozen_floats(values, shape, what)
    whole = array.astype(np.int64)
    bad = (whole != array) | (whole < 0)
    if bad.any():
        raise DrapeError(f"{what}: found {array[bad][0]:g}; expected whole numbers from 0 on")
    whole.setflags(write=False)
    return whole


def _shown(shape: tuple[int | None, ...]) -> str:
    return f"({', '.join('any' if length is None else str(length) for length in shape)})"
