"""The simulator of a config, for a scene and, where it minimises them, its energies."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Mapping

from jaxtyping import Float
from omegaconf import DictConfig
from torch import Tensor

from drape import config as conf
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.simulators.simulator import Simulator
from drape.simulators.solver.implicit import ImplicitSolver

BUDGET = {name: inspect.signature(ImplicitSolver).parameters[name].default for name in ("iterations", "steps")}
"""Usual budget of a solver for a frame: evaluations in a time step, time steps."""


def chosen_budget(simulator: object) -> dict[str, int]:
    """Those of :data:`BUDGET` that the settings of a ``simulator`` state and that are not the usual ones."""
    stated = simulator if isinstance(simulator, Mapping) else {}
    return {name: stated[name] for name, usual in BUDGET.items() if stated.get(name, usual) != usual}


def asks_for(make: object) -> set[str]:
    """Arguments that the node ``simulator`` of a config, built, still asks for: ``scene``; a solver ``potential`` and
    ``attributes``, a baseline the recorded ``sequence``.

    Raises:
        DrapeError: it has been built already, without a scene.
    """
    if not isinstance(make, functools.partial):
        raise DrapeError("conf: simulator: found no _partial_; expected _partial_: true, as the scene comes later")
    return set(inspect.signature(make.func).parameters) & {"scene", "potential", "attributes", "sequence"}


def simulator_of(
    node: DictConfig,
    potential: IncrementalPotential,
    scene: Scene,
    attributes: Float[Tensor, " attributes"],
    **settings: object,
) -> Simulator:
    """The simulator of ``scene``: a solver that minimises ``potential``, or a network; ``settings`` replace values of
    the ``node``.

    Raises:
        DrapeError: a simulator that follows a recorded garment.
    """
    make = conf.instantiate(node, **settings)
    if "sequence" in asks_for(make):
        raise DrapeError(
            f"conf: simulator: found {make.func.__name__}, which follows a recorded garment; expected a simulator that "
            "animates any scene; choose simulator=implicit, or src/evaluate.py"
        )
    offered = {"scene": scene, "potential": potential, "attributes": attributes}
    return make(**{name: value for name, value in offered.items() if name in asks_for(make)})
