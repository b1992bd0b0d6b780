"""Checks of every file before a value of it is used: whole, self-contained, plain numbers and texts."""

from __future__ import annotations

import contextlib
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from drape.errors import DrapeError

DAMAGED = (
    OSError, ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RuntimeError, MemoryError,
    EOFError, ArithmeticError, AssertionError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Errors that readers raise at bytes that are not what they say they are."""
SMALLEST_SHARE = 1 / 2000
"""A file is at least this share of what it says it holds: no compression of HDF5 reaches more."""
LARGEST_NUMBER = 1e15
"""Of any quantity, in any unit that is used here."""


def sound(values: np.ndarray) -> np.ndarray:
    """Mask of numbers that are finite and of a size that a quantity can have."""
    return np.abs(values) < LARGEST_NUMBER


@contextlib.contextmanager
def reading(path: Path | str, cure: str) -> Iterator[None]:
    """Turn what goes wrong while a file is read into one sentence that names it; ``cure`` says what to do.

    Raises:
        DrapeError: the block raised one of :data:`DAMAGED`; a sentence of its own stays as it is.
    """
    try:
        yield
    except DrapeError:
        raise
    except FileNotFoundError:
        raise
    except DAMAGED as error:
        text = (str(error).splitlines() or [""])[0][:200]
        raise DrapeError(f"{path}: damaged: {type(error).__name__}: {text}; {cure}") from error


def check_hdf5(file: h5py.File, path: Path) -> None:
    """Check that an HDF5 file stands alone and holds nothing but groups, numbers and texts.

    Links to elsewhere, data in other files, virtual data, loops, objects, and sizes that the file cannot hold are
    refused, and attributes that are not finite.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    seen, groups, size = set(), [("", file)], path.stat().st_size
    while groups:
        name, group = groups.pop()
        address = h5py.h5o.get_info(group.id).addr
        if address in seen:
            raise DrapeError(f"{path}: {name}: found a group that stands in two places; expected no loops")
        seen.add(address)
        _check_attributes(group, path, name)
        for key in group:
            where, link = f"{name}/{key}".lstrip("/"), group.get(key, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise DrapeError(f"{path}: {where}: found a link to elsewhere; expected the data themselves")
            member = group[key]
            if isinstance(member, h5py.Group):
                groups.append((where, member))
            else:
                _check_dataset(member, path, where, size)


def _check_dataset(dataset: object, path: Path, name: str, size: int) -> None:
    if not isinstance(dataset, h5py.Dataset):
        raise DrapeError(f"{path}: {name}: found a {type(dataset).__name__}; expected a dataset")
    if dataset.external or dataset.is_virtual:
        raise DrapeError(f"{path}: {name}: found data that are kept in other files; expected them in this one")
    if dataset.shape is None or dataset.dtype.kind not in "biufSO" or not _is_text_or_number(dataset.dtype):
        raise DrapeError(f"{path}: {name}: found {dataset.dtype}; expected numbers")
    if dataset.size * dataset.dtype.itemsize * SMALLEST_SHARE > size:
        raise DrapeError(
            f"{path}: {name}: found shape {dataset.shape} in a file of {size} bytes; expected numbers that are there"
        )
    _check_attributes(dataset, path, name)


def _check_attributes(holder: h5py.Group | h5py.Dataset, path: Path, name: str) -> None:
    for key in holder.attrs:
        where, value = f"{path}: {name or 'file'}: attribute {key}", holder.attrs[key]
        array = np.asarray(value)
        if array.dtype.kind == "f" and not (np.abs(array) < LARGEST_NUMBER).all():
            raise DrapeError(f"{where}: found {array.tolist()}; expected finite numbers")
        if array.dtype.kind not in "biufSUO" or isinstance(value, h5py.Empty | h5py.Reference):
            raise DrapeError(f"{where}: found {type(value).__name__}; expected numbers or texts")


def _is_text_or_number(dtype: np.dtype) -> bool:
    return dtype.kind != "O" or h5py.check_string_dtype(dtype) is not None


def attribute(path: Path, name: str, value: Any, expected: str) -> Any:
    """An attribute that must be of the kind ``expected``: text, texts, count, above 0, from 0 on, three numbers.

    Raises:
        DrapeError: path, name, what was found, what was expected.
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < LARGEST_NUMBER
    fits = {
        "a text": lambda: isinstance(value, str),
        "names": lambda: _are_names(value),
        "a whole number from 1 on": lambda: is_number and isinstance(value, int) and value >= 1,
        "a whole number from 0 on": lambda: is_number and isinstance(value, int) and value >= 0,
        "'z'": lambda: value == "z",
        "a number above 0": lambda: is_number and value > 0,
        "a number from 0 on": lambda: is_number and value >= 0,
        "three numbers": lambda: _are_three(value),
    }[expected]
    if not fits():
        raise DrapeError(f"{path}: attribute {name}: found {repr(value)[:80]}; expected {expected}; make it again")
    return value


def _are_names(value: object) -> bool:
    if not isinstance(value, list) or not all(isinstance(each, str) and each for each in value):
        return False
    return len(set(value)) == len(value) and not any("/" in each or each in (".", "..") for each in value)


def _are_three(value: object) -> bool:
    array = np.asarray(value)
    return array.shape == (3,) and array.dtype.kind in "iuf" and bool((np.abs(array) < LARGEST_NUMBER).all())
