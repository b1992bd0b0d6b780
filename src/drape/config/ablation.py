"""An ablation must take something away: one that changes nothing, or misspells it, is refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from drape.config.resolvers import choices
from drape.config.sentences import did_you_mean
from drape.errors import DrapeError

NONE = "none"
"""The option that ablates nothing."""

Compose = Callable[[list[str]], DictConfig]
"""From overrides to a config that includes the node ``hydra``."""


def check_ablation(group: str = "ablation") -> None:
    """Refuse an ablation of the Hydra run at hand that leaves the config as it is or adds a key to it.

    The config is composed again without each ablation, everything else being equal.

    Raises:
        DrapeError: the ablation has no effect here, or sets a value that the un-ablated config does not have.
    """
    job = HydraConfig.get()
    compare_ablations(
        lambda overrides: hydra.compose(job.job.config_name, overrides, return_hydra_config=True),
        [override for override in job.overrides.task if override.split("=")[0] != group],
        choices(group),
        group,
    )


def compare_ablations(compose: Compose, overrides: list[str], names: list[str], group: str = "ablation") -> None:
    """As :func:`check_ablation`, for the ``names`` of ``group`` on top of the other ``overrides``."""
    names = [name for name in names if name != NONE]
    for name in names:
        others = [other for other in names if other != name] or [NONE]
        base = compose([*overrides, f"{group}=[{','.join(others)}]"])
        ablated = compose([*overrides, f"{group}=[{','.join(names)}]"])
        if _plain(base, group) == _plain(ablated, group):
            options = ", ".join(f"{key}={value}" for key, value in _choices(base).items() if key in ("model", "loss"))
            raise DrapeError(
                f"conf/{group}/{name}.yaml: it changes nothing here ({options}); "
                f"choose another {group}, or {group}={NONE}"
            )
        changed = {key for key in _choices(ablated) if _choices(base).get(key) != _choices(ablated)[key]}
        nodes = {key.rpartition("@")[2].removeprefix("_global_.").replace("/", ".") for key in changed}
        for path, siblings in _added(_plain(base, group), _plain(ablated, group)):
            if not any(path == node or path.startswith(f"{node}.") for node in nodes):
                hint = did_you_mean(path.rpartition(".")[2], siblings)
                raise DrapeError(f"conf/{group}/{name}.yaml: {path} does not exist without it{hint}")


def _plain(config: DictConfig, group: str) -> dict[str, Any]:
    plain: Any = OmegaConf.to_container(config, resolve=False)
    return {name: node for name, node in plain.items() if name not in ("hydra", "label", group)}


def _choices(config: DictConfig) -> dict[str, str]:
    found: Any = OmegaConf.to_container(config.hydra.runtime.choices)
    return found


def _added(base: Mapping[str, Any], ablated: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, list[str]]]:
    """Paths in ``ablated`` that ``base`` lacks, each with its would-be siblings."""
    for key, value in ablated.items():
        where = f"{path}.{key}" if path else str(key)
        if key not in base:
            yield where, [str(k) for k in base]
        elif isinstance(value, dict) and isinstance(base[key], dict):
            yield from _added(base[key], value, where)
