"""A way to animate recorded garments: a simulator, and the energies of each fabric where it minimises them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from drape import config as conf
from drape.config.ranges import leaves_its_folder
from drape.data.hdf5 import GarmentFile
from drape.data.sequence import GarmentSequence
from drape.energy.fabric import Fabric
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.scene.material import Material
from drape.scene.scene import Scene
from drape.simulators.choice import asks_for, chosen_budget
from drape.simulators.device import check_device
from drape.simulators.neural.checkpoint import load_simulator, training_name
from drape.simulators.simulator import Simulator

OF_ENERGIES = ("energy", "contact")
"""Groups that mean something only where energies are minimised."""
USUAL = "surface"
"""Contact that no name says."""


class Method:
    """The nodes ``simulator``, ``energy`` and ``contact`` of a config, applied to the sequences of a data set.

    The node ``fabric`` that the energies refer to is that of each sequence in turn, with the settings that the data
    state; energies are built once for each fabric.

    Args:
        config: composed from ``conf/evaluate.yaml``.
        file: where the sequences are.
        overrides: what the user has set on the command line.

    Raises:
        DrapeError: a setting that would have no effect, a device that is not there.
    """

    def __init__(self, config: DictConfig, file: GarmentFile, overrides: Sequence[str] = ()):
        self.config = config
        self.file = file
        self._make = conf.instantiate(config.simulator)
        self.areal_density = None if config.areal_density is None else float(config.areal_density)
        self._fabrics: dict[str, Fabric] = {}
        self._asks = asks_for(self._make)
        self.minimises = "potential" in self._asks
        _refuse(overrides, ["fabric"], f"the fabric of each sequence is the one that {file.path} states for it")
        if not self.minimises:
            nodes = [*OF_ENERGIES, "areal_density"]
            _refuse(overrides, nodes, f"simulator {self._make.func.__name__} minimises no energy")
        if "device" in config.simulator:
            check_device(config.simulator.device)

    def named(self, simulator: str, energy: str = "", contact: str = USUAL) -> str:
        """Simulator, energy, contact and budget (``_40``, ``_x2``: two steps a frame) as one name; what a network is.

        Only what is not usual is said of contact and budget.

        Raises:
            DrapeError: a checkpoint whose name would lead out of the folder of evaluations.
        """
        if (told := self.training) is not None:
            row = training_name(told)
            name = row if told["ablation"] == "none" else f"{row}_{told['ablation']}"
            name = f"{name}_{told['scale']}_seed_{told['seed']}"
            if leaves_its_folder(name):
                raise DrapeError(
                    f"{self.config.simulator.checkpoint}: training: found the name {name!r}; expected one without "
                    "slashes that does not begin with a dot"
                )
            return name
        signs = {"iterations": "_", "steps": "_x"}
        budget = "".join(f"{signs[key]}{value}" for key, value in chosen_budget(self.config.simulator).items())
        touching = "" if contact == USUAL else f"_{contact}"
        return f"{simulator}_{energy}{touching}{budget}" if self.minimises else simulator

    @cached_property
    def training(self) -> dict[str, Any] | None:
        """Description of the training of the simulator's network; None where there is none."""
        checkpoint = self.config.simulator.get("checkpoint")
        return None if checkpoint is None else load_simulator(checkpoint).training

    def prepare(self, sequences: Sequence[GarmentSequence]) -> None:
        """Build what the sequences need, so that mistakes come before the work.

        Raises:
            DrapeError: the energies do not know a fabric.
        """
        for fabric in dict.fromkeys(sequence.fabric for sequence in sequences if self.minimises):
            self._fabric(fabric)

    def simulator(self, sequence: GarmentSequence, scene: Scene) -> Simulator:
        """The simulator of ``scene``, which is made of ``sequence``."""
        if not self.minimises:
            offered = {"scene": scene, "sequence": sequence}
            return self._make(**{name: offered[name] for name in self._asks})
        fabric = copy.deepcopy(self._fabric(sequence.fabric))
        potential = IncrementalPotential.for_scene(scene, fabric.terms, conf.instantiate(self.config.contact))
        return self._make(potential=potential, scene=scene, attributes=fabric.attributes)

    def settings(self, sequence: GarmentSequence) -> dict[str, Any]:
        """Settings that determine the frames of ``sequence``, as plain values."""
        names = ("simulator", *OF_ENERGIES, "fabric") if self.minimises else ("simulator",)
        config = self._with_fabric(sequence.fabric)
        nodes = {name: OmegaConf.to_container(config[name], resolve=True) for name in names}
        if self.areal_density is not None:
            nodes["areal_density"] = self.areal_density
        if self.training is not None:
            nodes["training"] = self.training
        return {"data": {"path": str(self.file.path), "sequence": sequence.name}, **nodes}

    def _fabric(self, name: str) -> Fabric:
        if name not in self._fabrics:
            self._fabrics[name] = conf.instantiate(self._with_fabric(name).energy)
        return self._fabrics[name]

    def _with_fabric(self, name: str) -> DictConfig:
        config = copy.deepcopy(self.config)
        material = Material.from_settings(name, self.file.materials[name])
        with open_dict(config):
            config.fabric = {"_target_": "drape.scene.material.Material", **asdict(material)}
        return config


def _refuse(overrides: Sequence[str], nodes: Sequence[str], reason: str) -> None:
    """Refuse overrides of ``nodes``, which would change nothing, with the reason."""
    for override in overrides:
        key = override.lstrip("+~").partition("=")[0].replace("/", ".").partition("@")[0]
        if key.partition(".")[0] in nodes:
            raise DrapeError(f"{key}: found {override}; expected nothing, as {reason}; leave it out")
