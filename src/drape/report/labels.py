"""Labels of rows in tables and figures, from what their records say."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from hydra.errors import HydraException

from drape.config import chosen, label
from drape.config.compose import compose
from drape.errors import DrapeError
from drape.metrics.record import VARIANT, EvaluationRecord
from drape.simulators.choice import BUDGET, chosen_budget

FLOOR = "noise floor (twin)"
TWIN = ".Twin"
"""End of the target of the simulator that returns the perturbed twins, wherever it stood when it was recorded."""
LAWS = {"eunet": "EUNet", "eunet_baked": "baked EUNet", "phys": "PHYS", "spring_hinge": "spring-hinge law"}
"""Spelling of laws; another one is spelled as the function that makes it."""
SPENT = {"iterations": "{} evaluations", "steps": "{} steps a frame"}
"""Words for the budget of a solver."""
OF_SEED = re.compile(r"[\s_/-]*(seed|s)[_=-]?\d+$")
"""The end of a name that says the seed."""
UNTOLD = ("model", "ablation", "material", "scale", "seed", "data", "data.path", "size", "name", "label", "evaluate")
"""Settings of a training that its record tells elsewhere, or that change no number."""
WATCHING = ("logger", "callbacks", "trainer", "hydra")
"""Nodes that change no number."""
OF_LABELS = ("model", "loss", "contact")
"""Groups of settings that a label tells: network, law, losses."""


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


def departing(name: str, departures: Mapping[str, str]) -> str:
    """``MGN-S+EUNet (law=network)``: the label of a row, and the settings that are not those of the row."""
    other = ", ".join(f"{key}={value}" for key, value in departures.items())
    return f"{name} ({other})" if other else name


def row_label(record: EvaluationRecord) -> str:
    """The label of a trained simulator; law, contact and budget of a solver without a name; or else the name.

    Raises:
        DrapeError: a damaged description of the training.
    """
    if is_twin(record):
        return FLOOR
    training = training_of(record)
    if training:
        name = row_name(str(training.get("label", "")), training["row"], str(training.get("ablation", "none")))
        return departing(name, {} if "label" in settings(training) else _departures(training))
    if "energy" in record.method and "name" not in settings(record.provenance):
        budget = chosen_budget(record.method["simulator"])
        return ", ".join([solver_label(record), *(SPENT[key].format(value) for key, value in budget.items())])
    return plain_name(record)


def solver_label(record: EvaluationRecord) -> str:
    """``solver + baked EUNet``, and its contact where that is not the usual one on the surface."""
    law, contact = (_target(record.method.get(node)) for node in ("energy", "contact"))
    kind = contact.removesuffix("Contact").lower()
    said = f", contact={kind}" if kind not in ("", "surface") else ""
    return f"solver + {LAWS.get(law, law.replace('_', ' ')) or 'energies'}{said}"


def budget_of(record: EvaluationRecord) -> tuple[int, ...]:
    """Evaluations in a time step and time steps in a frame of a solver, the usual ones where it states none."""
    return tuple({**BUDGET, **chosen_budget(record.method["simulator"])}[key] for key in ("iterations", "steps"))


def plain_name(record: EvaluationRecord) -> str:
    """The name of an evaluation, without the seed where its record has one."""
    name = str(record.method["name"])
    return name if seed_of(record) is None else OF_SEED.sub("", name)


def is_twin(record: EvaluationRecord) -> bool:
    """Whether an evaluation is that of the perturbed twins."""
    simulator = record.method["simulator"]
    return isinstance(simulator, Mapping) and str(simulator.get("_target_")).endswith(TWIN)


def training_of(record: EvaluationRecord) -> Mapping[str, Any]:
    """``method["training"]``: row, label, ablation, scale, seed, iterations, seconds, parameters, command; or nothing.

    Raises:
        DrapeError: it is no mapping, or does not say which row it is.
    """
    found = record.method.get("training") or {}
    if not isinstance(found, Mapping) or (found and not isinstance(found.get("row"), str)):
        raise DrapeError(
            f"{record.folder}: method/training: found {found!r}; expected a mapping with at least the name of its row; "
            "evaluate again"
        )
    return found


def seed_of(record: EvaluationRecord) -> int | None:
    """The seed of an evaluation: of the training of its simulator, or its own; None where there is none."""
    training = record.method.get("training")
    for said in (training, record.method, record.provenance):
        if isinstance(said, Mapping) and isinstance(said.get("seed"), int):
            return said["seed"]
    return None


def settings(told: Mapping[str, Any]) -> dict[str, str]:
    """Settings of the command line that ``told`` has as its ``command``."""
    try:
        words = shlex.split(str(told.get("command", "")))
    except ValueError:  # an open quotation mark
        return {}
    return {key.lstrip("+"): value for key, is_set, value in (word.partition("=") for word in words) if is_set}


def training_key(training: Mapping[str, Any]) -> tuple:
    """Values that are the same for trainings that differ by their seed only."""
    told = (repr(training.get(key)) for key in ("row", "label", "ablation", "material", "scale", "iterations"))
    return (*told, Path(str(training.get("data", ""))).name, *sorted(_changed(training).items()))


def _changed(training: Mapping[str, Any]) -> dict[str, str]:
    """Settings that make it another training than the row, the scale and the data alone."""
    found = settings(training).items()
    return {key: value for key, value in found if key not in UNTOLD and key.partition(".")[0] not in WATCHING}


def _departures(training: Mapping[str, Any]) -> dict[str, str]:
    """Network, law and losses that are not those of the row; an option by its group, a value by its last name."""
    found = {}
    for key, value in _changed(training).items():
        group = key.partition("@")[0]
        if re.split(r"[./@]", key)[0] in OF_LABELS and "/" not in value:
            found[re.split(r"[./]", group)[-1]] = value
    return found


def _target(node: object) -> str:
    """Name of what a node of a config builds; empty where there is none."""
    return str(node.get("_target_", "")).rpartition(".")[2] if isinstance(node, Mapping) else ""
