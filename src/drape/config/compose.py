"""A config from Python: what an entry point would see of a command line."""

from __future__ import annotations

import hydra
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from drape.config.resolvers import CONF


def compose(program: str, *overrides: str, with_hydra: bool = False) -> DictConfig:
    """The config of ``python src/<program>.py overrides``, as in ``compose("animate", "fabric=cotton")``.

    Its nodes become objects by :func:`drape.config.entry_point.instantiate`. ``with_hydra`` keeps the node ``hydra``,
    which says what was chosen.

    Raises:
        HydraException: overrides that Hydra cannot compose.
    """
    before = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    try:
        with hydra.initialize_config_dir(str(CONF), version_base=None):
            return hydra.compose(program, list(overrides), return_hydra_config=with_hydra)
    finally:
        GlobalHydra.instance().hydra = before
