"""Rows of tables: what they are called, and what the configuration makes them of."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

from hydra.errors import HydraException

from drape.config import chosen, label
from drape.config.compose import compose
from drape.metrics.record import VARIANT


class Row(NamedTuple):
    """A model with what is taken away from it, as ``conf/`` has it."""

    label: str
    options: Mapping[str, str]
    """Its options, by the names of :data:`~drape.metrics.record.VARIANT`."""


@cache
def row(model: str, ablation: str) -> Row | None:
    """The row of an option of ``model`` and of ``ablation``, several joined by ``+``; None if ``conf/`` lacks it."""
    try:
        config = compose("train", f"model={model}", f"ablation=[{ablation.replace('+', ',')}]", with_hydra=True)
    except HydraException:
        return None
    return Row(label(config), {name: chosen(group, config.hydra) for name, group in VARIANT.items()})


def row_name(said: str, model: str, ablation: str) -> str:
    """The label that a record says; of records that say none, that of the configuration, or else the plain names."""
    found = None if said else row(model, ablation)
    name = model if ablation == "none" else f"{model} {ablation}"
    return said or (found.label if found else "") or name
