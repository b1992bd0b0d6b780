"""Import of the class or function that a ``_target_`` names."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

from hydra.utils import get_object

from drape.config.sentences import did_you_mean


def locate(target: object) -> Any:
    """The class or function of a dotted name, or None."""
    try:
        return get_object(target) if isinstance(target, str) else None
    except Exception:  # whatever an import may raise; why_not tells
        return None


def why_not(target: object) -> str:
    """Reason for which ``locate`` did not find it."""
    if not isinstance(target, str) or "." not in target:
        return f"found {target!r}; expected the dotted name of a class or function"
    owner, name = None, ""
    try:
        for part in target.split("."):
            name = f"{name}.{part}".lstrip(".")
            owner = getattr(owner, part) if hasattr(owner, part) else importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            return f"cannot import {target!r}: {error}"
        if owner is None:
            return f"cannot import {target!r}: there is no package {name!r}"
        known = {key for key in dir(owner) if not key.startswith("_")}
        known |= {module.name for module in pkgutil.iter_modules(getattr(owner, "__path__", []))}
        return f"cannot import {target!r}: {owner.__name__} has no {part!r}{did_you_mean(part, known)}"
    except Exception as error:
        return f"cannot import {target!r}: {type(error).__name__}: {error}"
    return f"{target!r} is not a class or function"
