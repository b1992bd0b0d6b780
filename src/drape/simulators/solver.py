"""The solver of a config, for a scene and its energies."""

from __future__ import annotations

import functools
import inspect

from jaxtyping import Float
from omegaconf import DictConfig
from torch import Tensor

from drape import config as conf
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.simulators.baseline import Baseline
from drape.simulators.simulator import Simulator


def is_baseline(make: object) -> bool:
    """Whether the node ``simulator`` of a config is a :class:`Baseline`, which minimises no energy.

    Raises:
        DrapeError: it has been built already, without a scene.
    """
    if not isinstance(make, functools.partial):
        raise DrapeError("conf: simulator: found no _partial_; expected _partial_: true, as the scene comes later")
    return inspect.isclass(make.func) and issubclass(make.func, Baseline)


def solver(
    node: DictConfig,
    potential: IncrementalPotential,
    scene: Scene,
    attributes: Float[Tensor, " attributes"],
    **settings: object,
) -> Simulator:
    """What minimises ``potential``; ``settings`` replace single values of the ``node``.

    Raises:
        DrapeError: a simulator that minimises nothing.
    """
    make = conf.instantiate(node, **settings)
    if is_baseline(make):
        raise DrapeError(
            f"conf: simulator: found {make.func.__name__}, which follows a recorded garment; expected a solver that "
            "animates any scene; choose simulator=implicit, or src/evaluate.py"
        )
    return make(potential, scene, attributes)
