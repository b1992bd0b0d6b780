"""The laws that finished runs have learned, ready to be drawn."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from omegaconf import OmegaConf
from torch import Tensor

from drape.data.trajectories import open_trajectories
from drape.energy.law.checkpoint import load_energy
from drape.errors import DrapeError
from drape.report.energy_map import EnergyOf, energy_of
from drape.report.runs import Configuration
from drape.report.tables import label
from drape.scene.material import attribute_vector

CHECKPOINT = "checkpoints/last.ckpt"


def learned_energies(found: Sequence[Configuration]) -> dict[str, EnergyOf]:
    """φp of each configuration that still has its checkpoint, by label; of several seeds the lowest.

    A checkpoint that cannot be loaded is named on stderr and left out.
    """
    energies = {}
    for configuration in found:
        run = min(configuration.runs, key=lambda run: run.seed)
        path = run.folder / CHECKPOINT
        try:
            if path.is_file():
                energies[f"{label(configuration)}, seed {run.seed}"] = energy_of(load_energy(path).potential)
        except DrapeError as error:
            print(f"left out: {error}", file=sys.stderr)
    return energies


def learned_fabrics(found: Sequence[Configuration], names: Sequence[str]) -> dict[str, Float[Tensor, " attributes"]]:
    """The vector **a** of the named fabrics, as the networks of ``found`` saw them.

    Fabrics that the data do not have are left out.

    Raises:
        DrapeError: the data of the runs are gone.
    """
    config = OmegaConf.load(found[0].runs[0].folder / "config.yaml")
    materials = open_trajectories(config.datamodule.path).materials
    scales: Any = OmegaConf.to_container(config.datamodule.attribute_scales)
    known = [name for name in names if name in materials]
    return {name: torch.tensor(attribute_vector(materials[name], scales), dtype=torch.float64) for name in known}
