"""Read arrays out of a pickle without running anything that stands in it."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path

# A pickle is a program: it names functions and calls them. The class below is the reason why this is the only place
# that reads one: whatever a pickle names is looked up in a short table of constructors of plain numbers, and nothing
# else is ever imported or called.
from pickle import Unpickler, UnpicklingError
from typing import Any

import numpy as np
import scipy.sparse as sparse

from drape.errors import DrapeError


class Recorded:
    """Stands in for an object of a foreign class: keeps its state, and does nothing."""

    def __new__(cls, *_: object) -> Recorded:
        made = super().__new__(cls)
        made.state = {}
        return made

    def __setstate__(self, state: object) -> None:
        self.state = state if isinstance(state, dict) else {}


def _bytes(text: str, _encoding: str = "latin1") -> bytes:
    """Bytes as Python 3 writes them for Python 2."""
    return text.encode("latin1")


class _ArrayType(Recorded):
    """Type that a pickle hands to ``_reconstruct``; it must not be called by itself, with a buffer of raw bytes."""


def _empty_array(kind: type, _shape: tuple = (0,), _dtype: object = b"b") -> np.ndarray:
    """An array as numpy makes it again: an empty one, whose shape, type and numbers follow."""
    if kind is not _ArrayType:
        raise UnpicklingError(f"asks for an array of {kind!r}")
    again: Any = np.zeros(1).__reduce__()[0]
    return again(np.ndarray, (0,), b"b")


def _new(kind: type, _base: type = object, _state: object = None) -> object:
    """An object as old pickles make it: an empty one, whose state follows."""
    if not (isinstance(kind, type) and issubclass(kind, Recorded)):
        raise UnpicklingError(f"asks for a bare object of {kind!r}")
    return kind()


CONSTRUCTORS = {
    "ndarray": _ArrayType,
    "dtype": np.dtype,
    "_reconstruct": _empty_array,
    "scalar": np.float64(0.0).__reduce__()[0],
    "_frombuffer": np.zeros(1).__reduce_ex__(5)[0],
}
"""Constructors by which numpy makes an array again."""
PLAIN = {
    ("collections", "OrderedDict"): OrderedDict,
    ("copyreg", "_reconstructor"): _new,
    ("_codecs", "encode"): _bytes,
    **{("builtins", kind.__name__): kind for kind in (set, frozenset, slice, complex, bytearray, object)},
}
PYTHON_2 = {"__builtin__": "builtins", "copy_reg": "copyreg"}
RECORDED = ("chumpy", "scipy")
"""Packages whose objects are kept as what they are made of: SMPL's models have chumpy arrays and sparse matrices."""


class PlainUnpickler(Unpickler):
    """Makes numbers, strings, containers and numpy arrays; records chumpy's and scipy's objects; refuses all else."""

    def find_class(self, module: str, name: str) -> object:
        """Stand-in for ``module.name``.

        Raises:
            UnpicklingError: anything but numbers and arrays.
        """
        module = PYTHON_2.get(module, module)
        package = module.partition(".")[0]
        if package == "numpy" and name in CONSTRUCTORS:
            return CONSTRUCTORS[name]
        if (module, name) in PLAIN:
            return PLAIN[module, name]
        if package in RECORDED:
            return type(name, (Recorded,), {})
        raise UnpicklingError(f"asks for {module}.{name}")


def read_plain_pickle(path: Path) -> dict[str, object]:
    """The dictionary in a pickle file: numpy arrays (chumpy and sparse ones made dense), numbers, strings.

    Raises:
        DrapeError: no such file, no pickle, no dictionary, or one that asks for more than numbers.
    """
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; give the path of a .pkl file")
    try:
        with open(path, "rb") as file:
            found = PlainUnpickler(file, encoding="latin1").load()
    except Exception as error:  # a damaged pickle may fail in any way
        raise DrapeError(
            f"{path}: cannot be read as plain numbers ({type(error).__name__}: {error}); expected a pickle of arrays, "
            "as SMPL and VTO are distributed; it is damaged, or it does something else than hold numbers"
        ) from error
    if not isinstance(found, dict):
        raise DrapeError(f"{path}: found a {type(found).__name__}; expected a dictionary of arrays")
    return {str(key): _plain(value, f"{path}: {key}") for key, value in found.items()}


def _plain(value: object, where: str) -> object:
    """A recorded object as the array that it stands for."""
    if not isinstance(value, Recorded):
        return value
    state, kind = value.state, type(value).__name__
    if {"data", "indices", "indptr"} <= state.keys():
        build = sparse.csr_matrix if kind.startswith("csr") else sparse.csc_matrix
        shape = state.get("_shape", state.get("shape"))
        return build((state["data"], state["indices"], state["indptr"]), shape=shape).toarray()
    if {"data", "row", "col"} <= state.keys():
        shape = state.get("_shape", state.get("shape"))
        return sparse.coo_matrix((state["data"], (state["row"], state["col"])), shape=shape).toarray()
    if "x" in state:
        return np.asarray(_plain(state["x"], where))
    if {"a", "idxs"} <= state.keys():
        chosen = np.asarray(_plain(state["a"], where)).ravel()[np.asarray(state["idxs"])]
        return chosen.reshape(state.get("preferred_shape", chosen.shape))
    if {"a", "newshape"} <= state.keys():
        return np.asarray(_plain(state["a"], where)).reshape(state["newshape"])
    raise DrapeError(
        f"{where}: found an object {kind} of {', '.join(sorted(state)) or 'nothing'}; expected an array, or chumpy's "
        "Ch, Select or Reshape of one; save it as a plain array"
    )
