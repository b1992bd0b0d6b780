"""Ranges of the numbers of a config, by their names: one name is one quantity wherever it stands."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from drape.config.accepts import Borrowed


class Range(NamedTuple):
    """From ``low`` to ``high``, both counted unless ``above``; ``also`` are numbers with a meaning of their own."""

    low: int | float
    high: int | float = 1e12
    above: bool = False
    whole: bool = False
    also: tuple[int | float, ...] = ()

    def holds(self, value: int | float) -> bool:
        """Whether the number is in the range."""
        if value in self.also:
            return True
        large_enough = value > self.low if self.above else value >= self.low
        return large_enough and value <= self.high and (not self.whole or isinstance(value, int))

    def text(self) -> str:
        """``a whole number from 1 to 4096, or -1``."""
        kind = "a whole number" if self.whole else "a number"
        low = f"above {self.low:g}" if self.above else f"from {self.low:g}"
        also = "".join(f", or {'inf' if math.isinf(each) else f'{each:g}'}" for each in self.also)
        return f"{kind} {low} to {self.high:g}{also}"


FROM_ZERO, POSITIVE, ANY = Range(0.0), Range(0.0, above=True), Range(-1e12)
SHARE, MOST = Range(0.0, 1.0), Range(0.0, 1.0, above=True)
SOME, COUNT = Range(0, 1e9, whole=True), Range(1, 1e9, whole=True)
SIZE, LAYERS, MESH = Range(1, 16_384, whole=True), Range(1, 1000, whole=True), Range(2, 10_000, whole=True)

NAMES = {
    ANY: "gravity swing sway force_per_area table.stretch at.*",
    POSITIVE: "fps body_fps scale body_scale size radius pedestal_radius period edge body_edge edge.* height thickness "
    "reach stiffness sigma lr learning_rate clip longest stretch_scale angle_scale speed_scale energy_scale "
    "areal_density per_vertex mass_per_vertex mass speed acceleration edge_length patch_size patch_reach body_reach "
    "felt_reach body_distance self_distance residual tolerance still strain girth shoulder hip chest belly limb "
    "bounds.energy bounds.force reject.energy table.step diameters loads refinements val_check_interval shear_modulus",
    Range(0.0, above=True, also=(math.inf,)): "attribute_scales.* attribute_scales.mass_per_vertex",
    SHARE: "warmup final at_rest begin extra share contact_ramp ramp data.test",
    MOST: "every decay",
    COUNT: "batch_size eval_batch_size train_sequences validation_sequences validation_steps checkpoint_steps frames "
    "test_frames sequences repeats iterations rollout_first rollout_every rollout_last attempts every_n_train_steps "
    "log_every_n_steps refresh_rate windows test_windows samples output.size clips.size page.height output.every "
    "clips.every curriculum.first curriculum.every curriculum.last workers length steps halvings rings stride quality "
    "levels rounds clamped_rows cells.*",
    SIZE: "width patch_width size_node sizes_edge.* size_out patch_size_in body_size_in heads",
    LAYERS: "blocks layers_per_block message_steps patch_layers stage_repeats layers",
    MESH: "resolution",
    SOME: "settle preroll per_edge per_face page.sequences stand counts.* bodies.* data.frames.0 devices.0",
    Range(0, 7, whole=True): "subdivisions",
    Range(-1, 1e9, whole=True): "num_sanity_val_steps save_top_k",
    Range(1, 1e9, whole=True, also=(-1,)): "epochs max_epochs max_steps devices",
    Range(0, 2**32 - 1, whole=True): "seed seeds",
}
"""By the end of a path: ``counts.*`` is all below ``counts``, ``data.frames.0`` the first of a list. All else is finite
and not negative."""
RANGES = {name: found for found, names in NAMES.items() for name in names.split()}
FOLDERS = ("name", "data.name", "fabric.name", "scale.name")
"""Texts that become a part of a path."""
EMPTY = ("logger",)
"""Nodes in which an empty text has a meaning: no folder of their own."""


def range_of(path: str) -> Range:
    """The range of a path, declared or not."""
    return declared(path) or FROM_ZERO


def declared(path: str) -> Range | None:
    """The range that is declared for a path, by its longest end that has one."""
    parts = path.split(".")
    named = [part for part in parts if not part.isdigit()]
    for each in (parts, named, [*named[:-1], "*"], [*named[:-2], "*"]):
        for begin in range(len(each)):
            if (found := RANGES.get(".".join(each[begin:]))) is not None:
                return found
    return None


def out_of_range(tree: Any, path: str = "") -> Iterator[str]:
    """Numbers that no run can use, empty texts, and names that leave their folder."""
    if isinstance(tree, Borrowed):
        return
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from out_of_range(value, f"{path}.{key}" if path else str(key))
    elif isinstance(tree, list):
        for key, value in enumerate(tree):
            yield from out_of_range(value, f"{path}.{key}")
    elif isinstance(tree, int | float) and not isinstance(tree, bool):
        wanted = range_of(path)
        if not wanted.holds(tree):
            yield f"{path}: found {tree!r}; expected {wanted.text()}"
    elif isinstance(tree, str) and not tree.strip() and path.split(".")[0] not in EMPTY:
        yield f"{path}: found {tree!r}; expected a text that is not empty"
    elif isinstance(tree, str) and path in FOLDERS and leaves_its_folder(tree):
        yield f"{path}: found {tree!r}; expected a name without slashes that does not begin with a dot"


def leaves_its_folder(name: str) -> bool:
    """Whether a text that becomes a part of a path would lead elsewhere."""
    return name.startswith(".") or "/" in name or "\\" in name
