"""The command line as the user typed it: for records of how a result was made."""

from __future__ import annotations

import shlex
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from drape.config.resolvers import PACKAGED


def typed() -> list[str]:
    """The overrides of the Hydra run at hand; ``${shipped:law.ckpt}`` stays that, and not a path of this machine."""
    words: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
    return list(words)


def command_line(program: str, overrides: list[str]) -> str:
    """``python src/<program>.py overrides``, or ``drape <program> overrides``, to be pasted into a shell."""
    start = ["drape", program] if PACKAGED.is_dir() else ["python", f"src/{program}.py"]
    return shlex.join([*start, *overrides])
