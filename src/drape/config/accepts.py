"""Whether a plain value of a config fits the annotation of the argument that it is for."""

from __future__ import annotations

import functools
import inspect
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal, Union

UNKNOWN = object()
"""A value that is only known later, as a statistic of the data; it fits everything."""


class Borrowed(dict):
    """A node that stands elsewhere, ``${model}``, and is checked there."""


SCALARS = (bool, int, float, str)
FITS = {bool: (bool,), int: (int, float, complex), float: (float, complex), str: (str, os.PathLike)}


def accepts(annotation: Any, value: object, locate: Callable[[str], object]) -> bool:
    """Whether ``value`` fits; True in doubt. ``locate`` finds what a nested ``_target_`` names, or None."""
    if value is UNKNOWN or annotation in (Any, object, inspect.Parameter.empty):
        return True
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin in (Union, types.UnionType):
        return any(accepts(choice, value, locate) for choice in arguments)
    if origin is Literal:
        return any(value == choice and type(value) is type(choice) for choice in arguments)
    kind = origin or annotation
    if value is None:
        return kind in (None, type(None))
    if not inspect.isclass(kind):
        return True
    if isinstance(value, Mapping):
        return _mapping(kind, arguments, value, locate)
    if isinstance(value, list):
        return _list(kind, arguments, value, locate)
    if type(value) in SCALARS and kind in (*SCALARS, complex, os.PathLike):
        return kind in FITS[type(value)]
    if isinstance(value, str) and _true_in_doubt(lambda: issubclass(kind, Iterable)):
        return False  # a word is a sequence to Python, never to a user
    return _true_in_doubt(lambda: isinstance(value, kind) or (isinstance(value, str) and issubclass(kind, os.PathLike)))


def _mapping(kind: type, arguments: tuple, value: Mapping, locate: Callable[[str], object]) -> bool:
    if "_target_" not in value:
        fits = _true_in_doubt(lambda: issubclass(dict, kind))
        inner = arguments[1] if len(arguments) == 2 else Any
        return fits and all(accepts(inner, member, locate) for member in value.values())
    target = functools.partial if value.get("_partial_") else locate(value["_target_"])
    return not inspect.isclass(target) or _true_in_doubt(lambda: issubclass(target, kind))


def _list(kind: type, arguments: tuple, value: list, locate: Callable[[str], object]) -> bool:
    if not _true_in_doubt(lambda: any(issubclass(sequence, kind) for sequence in (list, tuple, set))):
        return False
    if kind is tuple and arguments and arguments[-1] is not ...:
        each = list(arguments)
    else:
        each = [arguments[0] if arguments else Any] * len(value)
    return len(each) == len(value) and all(accepts(a, v, locate) for a, v in zip(each, value, strict=True))


def _true_in_doubt(question: Callable[[], bool]) -> bool:
    try:
        return question()
    except TypeError:  # a protocol, a typed dict: cannot be asked
        return True
