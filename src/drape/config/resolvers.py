"""The resolvers ``${...}`` of configs: statistics of the data, chosen options, products."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import DictConfig, OmegaConf

from drape.config.sentences import did_you_mean
from drape.errors import DrapeError

PACKAGED = Path(__file__).parents[1] / "conf"
CONF = PACKAGED if PACKAGED.is_dir() else Path(__file__).parents[3] / "conf"
"""The folder of the contents pages and their groups: inside the package where that was installed from a wheel."""
SHIPPED = Path(__file__).parents[1] / "checkpoints"
"""Folder of the checkpoints and tables that come with the program."""


class StatisticsUnknown(DrapeError):
    """``${statistics:...}`` was read before the data were."""


def set_statistics(values: Mapping[str, float] | None) -> None:
    """Give ``${statistics:<name>}`` its values, numbers computed on the training split; None takes them back."""

    def statistics(name: str) -> float:
        if values is None:
            raise StatisticsUnknown(f"conf: ${{statistics:{name}}} is read before the training data are")
        if name not in values:
            hint = did_you_mean(name, values)
            raise DrapeError(f"conf: ${{statistics:{name}}}: the data have no such statistic{hint}")
        return float(values[name])

    OmegaConf.register_new_resolver("statistics", statistics, replace=True)


def show_statistics() -> None:
    """Let ``${statistics:<name>}`` say that it comes from the data, where a config is only printed."""
    OmegaConf.register_new_resolver("statistics", lambda name: f"<{name} of the training data>", replace=True)


def choices(group: str, hydra: DictConfig | None = None) -> list[str]:
    """The options of a config group, one or several, in the Hydra run at hand or in the given node ``hydra``.

    Hydra's own ``runtime.choices`` has no entry for a group given as a list, ``ablation=[a,b]``.
    """
    node = HydraConfig.get() if hydra is None else hydra
    for override in reversed(OverridesParser.create().parse_overrides(list(node.overrides.task))):
        value = override.value()
        if override.key_or_group == group and isinstance(value, list):
            return [str(name) for name in value]
    choice = node.runtime.choices.get(group)
    return [] if choice is None else [str(choice)]


def chosen(group: str, hydra: DictConfig | None = None) -> str:
    """The options of a config group joined by ``+`` in alphabetical order, for names of run folders."""
    return "+".join(sorted(choices(group, hydra)))


def _joined(group: str, *, _root_: DictConfig) -> str:
    """``${joined:<group>}``: see ``chosen``; also where Hydra has not begun its run, as for the folder of a sweep."""
    return chosen(group, _root_.get("hydra"))


def _shipped(name: str) -> str:
    """``${shipped:<file>}``: a checkpoint or table that comes with the program."""
    return str(SHIPPED / name)


def _estimates(path: str) -> dict[str, dict[str, float]]:
    """``${estimates:<path>}``: what EST has found, from the ``estimates.json`` of its training."""
    try:
        estimates = json.loads(Path(path).read_text(encoding="utf-8"))["estimates"]
        for fabric, numbers in estimates.items():
            for name, value in numbers.items():
                _check_estimate(fabric, name, value)
        return estimates
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        why = str(error) if isinstance(error, DrapeError) else type(error).__name__
        raise DrapeError(
            f"conf: ${{estimates:{path}}}: {why}: cannot be read; expected the estimates.json of "
            "python src/train.py model=est"
        ) from None


def _check_estimate(fabric: str, name: str, value: Any) -> None:
    """Refuse an estimate that could be read as a config: no instruction, no interpolation, only numbers."""
    if any(word.startswith("_") or "${" in word for word in (fabric, name)):
        raise DrapeError(f"{fabric}.{name}: found what is no name")
    if type(value) not in (int, float) or not 0 < value < float("inf"):
        raise DrapeError(f"{fabric}.{name}: found {value!r}; expected a finite number above 0")


def _fabric_names(fabric: str | Mapping[str, str]) -> DictConfig:
    """``${fabric_names:${data.fabric}}``: the fabrics of recordings, as the node ``material`` has them."""
    return OmegaConf.create({name: {} for name in ([fabric] if isinstance(fabric, str) else fabric)})


OmegaConf.register_new_resolver("fabric_names", _fabric_names, replace=True)
OmegaConf.register_new_resolver("estimates", _estimates, replace=True)
OmegaConf.register_new_resolver("times", lambda a, b: float(a) * float(b), replace=True)
OmegaConf.register_new_resolver("shipped", _shipped, replace=True)
OmegaConf.register_new_resolver("joined", _joined, replace=True)
set_statistics(None)
