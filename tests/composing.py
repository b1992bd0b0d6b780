"""Hydra in the test's own process, pointed at the project's configuration; what composes reads each file once."""

from __future__ import annotations

import contextlib
import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

from hydra import initialize_config_dir
from hydra._internal import defaults_list
from hydra._internal.config_repository import ConfigRepository
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig

from drape.config.entry_point import CONF

_read: dict[tuple[str, str, int], bytes] = {}


@contextlib.contextmanager
def composing(folder: Path = CONF) -> Iterator[None]:
    """``hydra.compose`` finds the contents pages of ``folder``."""
    GlobalHydra.instance().clear()
    HydraConfig.instance().cfg = None
    with initialize_config_dir(str(folder), version_base=None):
        yield


@contextlib.contextmanager
def kept_configs() -> Iterator[None]:
    """Hydra parses each file of a configuration once, until it is written again: that is much of its time.

    And of defaults lists without an interpolation it does not collect what an interpolation could ask for.
    """
    load, choices = ConfigRepository.load_config, defaults_list._create_interpolation_map

    def load_config(repository: ConfigRepository, config_path: str) -> ConfigResult | None:
        source = repository._find_object_source(config_path=config_path, object_type=ObjectType.CONFIG)
        if source is None or source.scheme() == "structured":
            return load(repository, config_path)
        file = os.path.join(source.path, source._normalize_file_name(config_path))
        key = source.scheme(), file, os.stat(file).st_mtime_ns if source.scheme() == "file" else 0
        if key not in _read:
            _read[key] = pickle.dumps(load(repository, config_path))
        return pickle.loads(_read[key])

    def interpolation_map(overrides: defaults_list.Overrides, defaults: list, self_added: bool) -> DictConfig:
        needed = any("${" in str(vars(default)) for default in defaults)
        return choices(overrides, defaults, self_added) if needed else DictConfig({})

    with (
        mock.patch.object(ConfigRepository, "load_config", load_config),
        mock.patch.object(defaults_list, "_create_interpolation_map", interpolation_map),
    ):
        yield
