"""Every contents page, every option of every group and every ablation composes, says what it means, and bites."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from hydra import compose
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf, open_dict

from drape.config import check_config, instantiate, label
from drape.config.ablation import NONE, compare_ablations
from drape.config.entry_point import CONF
from drape.config.pages import page as parsed
from drape.errors import DrapeError
from tests.composing import composing

SUPPLIED = {"datamodule": ["fabrics"], "training": ["known", "data"]}
"""What src/train.py adds to the arguments itself."""

NEEDED = {("scene", "custom"): ["scene.mesh=shirt.obj"], ("simulator", "neural"): ["simulator.checkpoint=last.ckpt"]}
"""Values that an option leaves to the user (``???``)."""

SIMULATOR = ["model=mgn_s_eunet"]
ROUTES = {
    "train": [[], ["model=eunet_hinge"], SIMULATOR, ["model=layersnet"], ["model=hood"], ["model=est"]],
    "benchmark": [[], ["model=eunet_hinge"], SIMULATOR, ["model=hood"], ["model=est"]],
    "animate": [[], ["scene=person"]],
    "generate": [[], ["data=garments"]],
}
"""What else a contents page may be told so that an option makes sense."""

OF_MODEL = {"no_estimation": "model=hood"}
"""Ablations of another model than the default."""

PAGES = sorted(path.stem for path in CONF.glob("*.yaml"))
GROUPS = sorted({path.parent.relative_to(CONF).as_posix() for path in CONF.rglob("*/*.yaml")} - {"hydra"})
OPTIONS = [(group, path.stem) for group in GROUPS for path in sorted((CONF / group).glob("*.yaml"))]
ABLATIONS = sorted({path.stem for path in (CONF / "ablation").glob("*.yaml")} - {NONE})


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    with composing():
        yield


def composed(page: str, overrides: list[str]) -> DictConfig:
    return compose(page, overrides, return_hydra_config=True)


def checked(page: str, overrides: list[str]) -> DictConfig:
    config = composed(page, overrides)
    with open_dict(config):
        config.pop("hydra")
    check_config(config, contents=page, supplied=SUPPLIED)
    return config


@functools.cache
def groups_of(page: str, route: tuple[str, ...]) -> set[str]:
    return set(composed(page, list(route)).hydra.runtime.choices)


@pytest.mark.parametrize("page", PAGES)
def test_contents_pages_have_no_mistakes(page):
    checked(page, [])


NOT_OF = {("data", "recorded"): {"evaluate"}}
"""Pages on which an option of a group means nothing: pieces of cloth are no garments."""


@pytest.mark.parametrize(("group", "option"), OPTIONS)
def test_every_option_can_be_chosen(group, option):
    """On every contents page that has the group, wherever it puts it (``group@node``), by one route at least."""
    needed = NEEDED.get((group, option), [])
    pages = {page: list(_places(page, group)) for page in PAGES if page not in NOT_OF.get((group, option), ())}
    assert any(pages.values()), f"no contents page uses conf/{group}/"
    for page, places in pages.items():
        refusals = (_refused(page, place, option, needed) for place in places)
        assert not places or None in refusals, f"{page}: refused by every route: {places}"


def _places(page: str, group: str) -> Iterator[tuple[list[str], str]]:
    for route in ROUTES.get(page, [[]]):
        yield from ((route, key) for key in groups_of(page, tuple(route)) if key.partition("@")[0] == group)


def _refused(page: str, place: tuple[list[str], str], option: str, needed: list[str]) -> DrapeError | None:
    route, key = place
    try:
        checked(page, [*route, f"{key}={option}", *needed])
    except (DrapeError, HydraException) as error:
        return error
    return None


def test_the_contents_page_of_training_is_in_the_order_of_overriding():
    """An ablation comes after all that it may change, and debugging has the last word."""
    entries = yaml.safe_load((CONF / "train.yaml").read_text(encoding="utf-8"))["defaults"]
    groups = [next(iter(entry)) for entry in entries if isinstance(entry, dict)]
    assert groups[-2:] == ["ablation", "debug"]


@pytest.mark.parametrize("cloths", [path.stem for path in sorted((CONF / "model" / "cloths").glob("*.yaml"))])
@pytest.mark.parametrize("network", [path.stem for path in sorted((CONF / "model" / "network").glob("*.yaml"))])
def test_every_network_takes_every_cloth(network, cloths):
    """The cloths bring their law along, and tell the network as many numbers as it expects."""
    choice = [f"model/network@model.network.network={network}", f"model/cloths={cloths}"]
    model = checked("train", ["model=mgn", *choice]).model
    assert model.network.network.attributes == (4 if cloths.startswith("phys") else 5)
    assert ("potential" in model) == (cloths == "eunet")


def test_every_row_and_every_ablation_has_a_label():
    """Its own one, in the file that defines it."""
    labels = {file.stem: parsed(file).tree.get("label") for file in (CONF / "model").glob("*.yaml")}
    assert all(labels.values())
    assert len(set(labels.values())) == len(labels) > 10
    taken = {name: parsed(CONF / "ablation" / f"{name}.yaml").tree["ablation"] for name in ABLATIONS}
    assert [name for name, told in taken.items() if list(told) != [name]] == []


def test_the_label_of_a_row_is_followed_by_what_is_taken_away():
    ablated = composed("train", ["model=mgn_s_eunet", "ablation=no_bending"])
    assert label(ablated) == "MGN-S+EUNet w/o bending"
    assert label(composed("train", ["ablation=[no_dissipation,no_contrastive]"])) == "EUNet w/o L_con w/o Φd"


@pytest.mark.parametrize("name", ABLATIONS)
def test_an_ablation_takes_something_away(name):
    model = [OF_MODEL[name]] if name in OF_MODEL else []
    compare_ablations(lambda overrides: composed("train", overrides), model, [name])
    checked("train", [*model, f"ablation={name}"])


@pytest.mark.parametrize("name", ABLATIONS)
def test_an_ablation_is_short_and_says_what_it_reproduces(name):
    lines = (CONF / "ablation" / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 10
    assert any(line.startswith("#") and "@package" not in line for line in lines[:2])


def test_no_ablation_changes_nothing():
    """`none` is a real option, so that a sweep can list it; it leaves no trace."""
    none = checked("train", [f"ablation={NONE}"])
    assert OmegaConf.to_container(none).get("ablation") in (None, {})


def test_all_ablations_together():
    checked("train", [f"ablation=[{','.join(name for name in ABLATIONS if name not in OF_MODEL)}]"])


@pytest.mark.parametrize(
    ("choice", "names"),
    [
        ("default", {"csv", "tensorboard"}),
        ("csv", {"csv"}),
        ("wandb", {"csv", "wandb"}),
        ("all", {"csv", "tensorboard", "wandb"}),
        ("[tensorboard,wandb]", {"csv", "tensorboard", "wandb"}),
    ],
)
def test_loggers_come_one_or_several_at_once(choice, names):
    assert set(composed("train", [f"logger={choice}"]).logger) == names


@pytest.mark.parametrize("trainer", [path.stem for path in sorted((CONF / "trainer").glob("*.yaml"))])
def test_forces_are_possible_in_validation_under_every_trainer(trainer):
    config = composed("train", [f"trainer={trainer}"])
    assert config.trainer.inference_mode is False
    assert config.trainer.deterministic in (True, "warn")


@pytest.mark.parametrize("debug", [path.stem for path in sorted((CONF / "debug").glob("*.yaml"))])
def test_trainer_loggers_and_callbacks_are_built(debug, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "disabled")
    config = composed("train", ["logger=all", f"debug={debug}"])
    with open_dict(config):
        config.hydra.runtime.output_dir = str(tmp_path)
    HydraConfig.instance().set_config(config)
    try:
        loggers = [instantiate(node) for node in config.logger.values()]
        callbacks = [instantiate(node) for node in config.callbacks.values()]
        trainer = instantiate(config.trainer, logger=loggers, callbacks=callbacks)
    finally:
        HydraConfig.instance().cfg = None
    assert {type(logger).__name__ for logger in loggers} == {"CSVLogger", "TensorBoardLogger", "WandbLogger"}
    assert set(callbacks) <= set(trainer.callbacks)
    assert trainer.checkpoint_callback.dirpath == str(tmp_path / "checkpoints")
