"""Energies and solvers in many combinations, from one config that names them all."""

from __future__ import annotations

import copy
from collections.abc import Iterable

from omegaconf import DictConfig, open_dict

from drape import config as conf
from drape.config.sentences import did_you_mean
from drape.energy.fabric import Fabric
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.simulators.choice import simulator_of
from drape.simulators.simulator import Simulator


class Composed:
    """The nodes ``energies`` (and ``fabrics``) of a config, each combination built once; solvers for scenes, with
    the ``contact`` of the config if it has one.

    ``fabric`` is the node that the energies refer to; one of ``fabrics`` takes its place in turn.
    """

    def __init__(self, config: DictConfig):
        self.config = config
        self._fabrics: dict[tuple[str, str | None], Fabric] = {}

    def check(self, energies: Iterable[str]) -> None:
        """Refuse an energy that the config does not name.

        Raises:
            DrapeError: it, and those that there are.
        """
        for name in energies:
            if name not in self.config.energies:
                known = list(self.config.energies)
                hint = did_you_mean(name, known)
                raise DrapeError(f"conf: energies: found no {name!r}; expected one of {', '.join(known)}{hint}")

    def with_fabric(self, fabric: str) -> DictConfig:
        """The config with one of its ``fabrics`` as the ``fabric``."""
        config = copy.deepcopy(self.config)
        with open_dict(config):
            config.fabric = config.fabrics[fabric]
        return config

    def law(self, energy: str, fabric: str | None = None) -> Fabric:
        """The energies of one fabric, or of the only one; in float64."""
        if (energy, fabric) not in self._fabrics:
            config = self.config if fabric is None else self.with_fabric(fabric)
            self._fabrics[energy, fabric] = conf.instantiate(config.energies[energy])
        return copy.deepcopy(self._fabrics[energy, fabric])

    def simulator(self, scene: Scene, energy: str, fabric: str | None = None, **settings: object) -> Simulator:
        """A solver for ``scene``, with single settings of the node ``simulator`` replaced."""
        law = self.law(energy, fabric)
        contact = conf.instantiate(self.config.contact) if "contact" in self.config else None
        potential = IncrementalPotential.for_scene(scene, law.terms, contact)
        return simulator_of(self.config.simulator, potential, scene, law.attributes, **settings)
