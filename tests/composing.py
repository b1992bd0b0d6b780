"""Hydra in the test's own process, pointed at the project's configuration."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from hydra import initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig

from drape.config.entry_point import CONF

_parsed: dict[tuple[str, str], object] = {}


@contextlib.contextmanager
def composing(folder: Path = CONF) -> Iterator[None]:
    """``hydra.compose`` finds the contents pages of ``folder``; each file is parsed once, which is half of the time."""
    GlobalHydra.instance().clear()
    HydraConfig.instance().cfg = None
    parse = yaml.load

    def load(stream, Loader):
        text = stream if isinstance(stream, str) else stream.read()
        key = text, Loader.__qualname__
        if key not in _parsed:
            _parsed[key] = parse(text, Loader=Loader)
        return copy.deepcopy(_parsed[key])

    with pytest.MonkeyPatch.context() as patched, initialize_config_dir(str(folder), version_base=None):
        patched.setattr(yaml, "load", load)
        yield
