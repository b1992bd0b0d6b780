"""Between the command line and the library: entry points, checks and resolvers of a config, building its objects."""

from drape.config.ablation import check_ablation
from drape.config.check import check_config
from drape.config.entry_point import instantiate, main
from drape.config.from_file import build_from_file
from drape.config.label import label
from drape.config.resolvers import chosen, set_statistics
from drape.config.typed import command_line, typed

__all__ = [
    "build_from_file", "check_ablation", "check_config", "chosen", "command_line", "instantiate", "label",
    "main", "set_statistics", "typed",
]  # fmt: skip
