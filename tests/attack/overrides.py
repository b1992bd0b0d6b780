"""Attack the configuration: wrong overrides of every command, composed and checked as the commands do, and counted.

``python -m tests.attack.overrides`` prints what was refused by a sentence, what ended in a traceback, and what was
accepted, with a list of the last two.
"""

from __future__ import annotations

import collections
import copy
import functools
import shlex
from collections.abc import Iterator
from typing import NamedTuple

from hydra import compose, initialize_config_dir
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from tests.attack.mistyped import mistyped
from tests.composing import kept_configs

from drape.blender.plan import check_data
from drape.config import instantiate
from drape.config.check import check_command
from drape.config.entry_point import CONF, refusal

NUMBERS = ("-1", "0", "nan", "inf", "-inf", "1e300", "true", "[1,2]", "{a: 1}", "word", "''", "1.5")
"""Wrong for a whole number above 0."""
REALS = ("-1", "0", "nan", "inf", "1e300", "true", "[1,2]", "{a: 1}", "word")
"""Wrong for a number above 0."""
FROM_ZERO = ("-1", "nan", "inf", "1e300", "true", "[1,2]", "{a: 1}", "word")
"""Wrong for a number from 0 on."""
SHARES = (*FROM_ZERO, "1.5")
"""Wrong for a share of 1."""
VECTORS = ("[1,2]", "[1,2,nan]", "word", "true", "[a,b,c]", "[[1,2,3]]", "{a: 1}")
"""Wrong for three numbers."""
FLAGS = ("2", "word", "[true]")
"""Wrong for true or false."""
NAMES = ("../x", "a/b", "''", "..", "/x")
"""Wrong for a name that becomes a folder or file."""

WRONG: dict[str, dict[str, tuple[str, ...]]] = {
    "train": {
        "seed": ("-1", "1.5", "nan", "true", "word", "[1,2]", "1e300", "null"),
        "name": NAMES,
        "evaluate": FLAGS,
        "scale.width": NUMBERS, "scale.batch_size": NUMBERS, "scale.eval_batch_size": NUMBERS, "scale.blocks": NUMBERS,
        "scale.max_steps": ("0", "-2", "1.5", "nan", "word", "[1]"), "scale.epochs": ("0", "-2", "word", "[1]", "nan"),
        "scale.validation_steps": NUMBERS, "scale.checkpoint_steps": NUMBERS,
        "scale.train_sequences": ("-1", "0", "1.5", "word", "[1]", "true"), "scale.validation_sequences": NUMBERS,
        "optimizer.lr": REALS, "schedule.every": REALS, "observation.noise": FROM_ZERO,
        "observation.stride": NUMBERS, "loss.contrastive.sigma": REALS, "loss.contrastive.weight": FROM_ZERO,
        "loss.contrastive.levels": NUMBERS, "attribute_scales.mass_per_vertex": ("-1", "0", "nan", "word", "[1]"),
        "trainer.devices": ("0", "-2"), "trainer.log_every_n_steps": ("-1", "word"),
        "contact.thickness": REALS, "contact.reach": REALS,
        "model": ("null", "3", "[]", "wordy"), "trainer": ("null", "nonsense"), "data.path": ("null", "3", "''", "[a]"),
        "model._target_": ("os.system", "builtins.exec", "3", "null"),
    },
    "train model=eunet_hinge": {"model.potential.width": NUMBERS, "model.timing.width": ("0", "-1", "nan")},
    "train model=mgn_s_eunet": {
        "scale.simulator.width": NUMBERS, "scale.simulator.batch_size": NUMBERS, "scale.simulator.noise": FROM_ZERO,
        "scale.simulator.contact_ramp": VECTORS, "scale.simulator.iterations": NUMBERS,
        "scale.simulator.rollout_last": NUMBERS, "training.clip": REALS, "scale.simulator.learning_rate": REALS,
        "loss.potential.weight": FROM_ZERO, "training.curriculum.at_rest": SHARES,
    },
    "animate": {
        "scene.frames": NUMBERS, "scene.fps": REALS, "scene.size": REALS, "scene.resolution": NUMBERS,
        "scene.radius": REALS, "scene.friction": FROM_ZERO, "scene.gravity": VECTORS, "scene.period": REALS,
        "scene.pattern": ("word", "3"), "scene.subdivisions": FROM_ZERO, "scene.mass.per_vertex": REALS,
        "scene.mass": ("3", "[1]", "null"), "simulator.iterations": NUMBERS, "simulator.steps": NUMBERS,
        "simulator.tolerance": REALS, "simulator.precision": ("32", "null"), "simulator.device": ("[a]", "3"),
        "fabric.tension_stiffness": FROM_ZERO, "fabric.mass_per_vertex": REALS, "fabric.name": ("3", *NAMES),
        "contact.stiffness": REALS, "contact.thickness": REALS, "contact.per_edge": ("-1", "1.5", "word", "1e300"),
        "contact.per_face": ("2", "-1", "word"), "output.samples": NUMBERS, "output.every": NUMBERS,
        "output.size": ("[0,0]", "word", "[-1,5]"), "output.formats": ("word", "[word]", "[3]"),
        "output.render": ("word", "3"), "explain": FLAGS, "folder": ("null", "3", "[a]", "''"),
    },
    "animate scene=person": {
        "scene.edge": REALS, "scene.body_edge": REALS, "scene.settle": ("-1", "1.5", "word"), "scene.seed": ("-1",),
        "scene.figure.height": REALS, "scene.recording.start": FROM_ZERO, "scene.garments": ("[]", "[word]", "3"),
    },
    "bake": {
        "table.step": REALS, "table.stretch": ("[1]", "[4,-1]", "[nan,1]", "word", "[1,1]"), "bounds.energy": REALS,
        "bounds.force": REALS, "checkpoint": ("null", "3", "[a]"), "path": ("null", "3", "[a]"),
    },
    "evaluate": {
        "split": ("3", "null"), "sequences": NUMBERS[:-1], "frames": NUMBERS[:-1], "kinds": ("word", "3"),
        "areal_density": REALS, "name": NAMES, "runs": ("null", "[a]"), "simulator.iterations": NUMBERS,
    },
    "benchmark": {"measure.repeats": NUMBERS, "seed": ("-1", "1.5", "word"), "scale.width": NUMBERS},
    "benchmark measure=held_out": {"measure.sequences": NUMBERS, "measure.frames": NUMBERS},
    "benchmark measure=friction": {
        "measure.coefficients": ("[-1]", "[nan]", "word"), "measure.halvings": NUMBERS, "measure.radius": REALS,
    },
    "generate": {
        "workers": ("-1", "0", "1.5"), "data.size": REALS, "data.resolution": NUMBERS,
        "data.fps": REALS, "data.frames": NUMBERS, "data.seed": ("-1", "1.5", "word", "nan"),
        "data.counts.train": ("-1", "1.5", "word", "nan"), "data.counts": ("3", "[1,2]"), "data.start.swing": ("[1]",),
        "data.reject.strain": REALS, "data.reject.attempts": NUMBERS, "clips.render": FLAGS, "clips.every": NUMBERS,
        "data.pattern": ("3", "[a]"), "data.path": ("null", "3", "[a]"), "data.start": ("3",), "data.name": NAMES,
    },
    "generate data=garments": {"data.edge.garment": REALS, "data.settle": ("-1", "1.5"), "data.frames": NUMBERS},
    "report": {
        "seeds": ("word", "[-1]", "3", "[1.5]"), "page.sequences": ("-1", "1.5", "word"), "page.height": NUMBERS,
        "ablations": ("3", "word"), "runs": ("null", "[a]"), "folder": ("null", "[a]"), "map_fabrics": ("3",),
    },
    "learn": {"seed": ("-1", "1.5", "word"), "scale.width": NUMBERS, "data.fps": REALS, "data.scale": REALS},
}  # fmt: skip
"""By command line, a key and values that it must refuse."""

RIGHT = (
    "train scale.width='${scale.batch_size}'", "train attribute_scales.mass_per_vertex=inf", "train trainer.devices=1",
    "train scale.train_sequences=4", "train seed=4294967295", "train scale.validation_sequences='${scale.blocks}'",
    "train training.loss='${loss}'", "animate scene.fps='${scene.frames}'", "animate scene.friction=0",
    "animate scene.material='${fabric}'", "animate contact.per_edge=0", "animate scene.gravity=[0,0,0]",
    "bake table.step=1", "evaluate sequences=3", "generate workers=2", "generate data.counts.test=0",
    "learn data.name=a data.root=b data.fps=59.94 data.rest=first data.mass.areal_density=0.2",
    "animate simulator.tolerance=1e-6", "train name=a_b", "generate data.reject.strain='${data.size}'", "evaluate",
    "report", "report seeds=[4]", "train model=layersnet", "train model=est", "benchmark measure=trained_laws",
)  # fmt: skip
"""What they must accept."""


BUILT = {"animate": ("contact", "output", "scene"), "bake": ("table", "bounds"), "evaluate": ("selection",)}
"""What is built before anything is read or written; its constructors know more than their annotations say."""


class Score(NamedTuple):
    """What became of each override."""

    sentences: list[str]
    tracebacks: list[str]
    accepted: list[str]


def overrides() -> Iterator[str]:
    """Every wrong command line."""
    for command, keys in WRONG.items():
        for key, values in keys.items():
            yield from (f"{command} {shlex.quote(f'{key}={value}')}" for value in values)
    yield from mistyped()


def attack(lines: list[str]) -> Score:
    """Compose and check each command line, up to where building would begin."""
    GlobalHydra.instance().clear()
    score = Score([], [], [])
    with kept_configs(), initialize_config_dir(str(CONF), version_base=None):
        for line in lines:
            try:
                checked(line)
                score.accepted.append(line)
            except Exception as error:
                if "TypeCheckError" in str(error):  # only tests check annotations of calls
                    continue
                sentence = refusal(error)
                told = score.tracebacks if sentence is None else score.sentences
                told.append(f"{line}: {sentence or f'{type(error).__name__}: {error}'}")
    HydraConfig.instance().cfg = None
    return score


def checked(line: str) -> None:
    """Compose and check one command line."""
    page, *typed = shlex.split(line)
    config = composed(page, typed)
    with open_dict(config):
        config.hydra.runtime.output_dir = "runs"
        HydraConfig.instance().set_config(config)
        config.pop("hydra")
    check_command(config, page)
    for name in BUILT.get(page, ()):
        instantiate(config[name])
    if page == "generate" and config.data.get("source") in (None, "garments"):  # what generating checks first
        check_data(OmegaConf.to_container(config.data, resolve=True))


def composed(page: str, typed: list[str]) -> DictConfig:
    """As Hydra composes it, which takes the options of groups first, then the values; the former once."""
    options = [word for word in typed if (CONF / word.partition("=")[0].partition("@")[0].lstrip("+~")).is_dir()]
    values = OverridesParser.create().parse_overrides([word for word in typed if word not in options])
    ConfigLoaderImpl.validate_sweep_overrides_legal(values, RunMode.RUN, from_shell=True)
    config = copy.deepcopy(_chosen(page, *options))
    ConfigLoaderImpl._apply_overrides_to_config(values, config)
    return config


@functools.cache
def _chosen(page: str, *options: str) -> DictConfig:
    return compose(page, list(options), return_hydra_config=True)


def main() -> None:
    """Print the score."""
    score = attack(list(overrides()))
    for name in ("tracebacks", "accepted"):
        print(f"--- {name}", *getattr(score, name), sep="\n")
    print("--- commands", *collections.Counter(line.split()[0] for line in score.sentences).items())
    print(f"{len(score.sentences)} sentences, {len(score.tracebacks)} tracebacks, {len(score.accepted)} accepted")


if __name__ == "__main__":
    main()
