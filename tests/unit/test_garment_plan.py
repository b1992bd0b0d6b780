"""What a data set of garments will contain: disjoint splits, equal parts, and the sentences for mistakes."""

from __future__ import annotations

import copy
import itertools
from collections import Counter

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

from drape.blender.choice import Choice, choose
from drape.blender.garment_attempt import drawn_shape
from drape.blender.plan import make_request
from drape.config.entry_point import CONF
from drape.errors import DrapeError
from drape.figure.phenotype import Phenotype

MATERIAL = {fabric: {"preset": fabric.capitalize()} for fabric in ("silk", "leather", "denim", "cotton")}
SIZES = sorted(path.stem for path in (CONF / "size").glob("*.yaml"))


def data_of(*overrides: str) -> dict:
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None):
        return OmegaConf.to_container(compose("generate", ["data=garments", *overrides]).data, resolve=True)


@pytest.fixture(scope="module")
def data() -> dict:
    return data_of()


def choices(data: dict) -> dict[str, list[Choice]]:
    plan = {"data": data, "material": MATERIAL}
    found = [choose(index, plan) for index in range(sum(data["counts"].values()))]
    return {split: [choice for choice in found if choice.split == split] for split in ("train", "test")}


@pytest.mark.parametrize("size", SIZES)
def test_every_size_is_a_valid_data_set_with_its_own_path(size: str) -> None:
    data = data_of(f"size={size}")
    assert make_request(data, MATERIAL)["data"]["counts"]["train"] > 0
    assert data["path"] == f"data/garments_{'small' if size == 'default' else size}.h5"


@pytest.mark.parametrize("size", SIZES)
def test_the_splits_share_no_body_and_no_motion(size: str) -> None:
    found = choices(data_of(f"size={size}"))
    for what in ("body", "motion"):
        train, test = ({getattr(choice, what) for choice in found[split]} for split in ("train", "test"))
        assert train
        assert test
        assert not train & test


def test_the_default_size_is_what_was_promised(data: dict) -> None:
    found = choices(data)
    assert len(found["train"]) >= 120
    assert len(found["test"]) >= 24
    assert data["frames"] == 80


@pytest.mark.parametrize("split", ["train", "test"])
def test_kinds_and_fabrics_come_in_equal_parts_and_all_things_meet(data: dict, split: str) -> None:
    found = choices(data)[split]
    pairs = Counter((choice.kind, choice.fabric) for choice in found)
    assert len(pairs) == 6 * 4
    assert set(pairs.values()) == {len(found) // 24}
    for one, other in itertools.combinations(("kind", "fabric", "motion"), 2):
        met = Counter((getattr(choice, one), getattr(choice, other)) for choice in found)
        assert len(met) == len({pair[0] for pair in met}) * len({pair[1] for pair in met}), (one, other)
    shown = Counter(choice.body for choice in found)
    assert len(shown) == data["bodies"][split]
    assert max(shown.values()) - min(shown.values()) <= 1
    for body in shown:  # no body is seen in one motion only
        assert len({choice.motion for choice in found if choice.body == body}) >= 2


def test_a_choice_depends_on_its_number_only(data: dict) -> None:
    plan = {"data": data, "material": MATERIAL}
    more = {"data": data | {"counts": {"train": data["counts"]["train"], "test": 200}}, "material": MATERIAL}
    assert [choose(index, plan) for index in range(144)] == [choose(index, more) for index in range(144)]


def test_one_fabric_and_one_kind_are_possible(data: dict) -> None:
    plan = {"data": data | {"kinds": ["dress"]}, "material": {"silk": MATERIAL["silk"]}}
    found = {(choice.kind, choice.fabric) for choice in (choose(index, plan) for index in range(144))}
    assert found == {("dress", "silk")}


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("edge.garmnet", 0.02, r"data.edge.garmnet: no such key; did you mean data.edge.garment\?"),
        ("edge.garment", 0.2, "data.edge.garment: found 0.2; expected a number from 0.005 to 0.1"),
        ("frames", 2, "data.frames: found 2; expected a whole number from 3 on"),
        ("kinds", ["dress", "hat"], r"data.kinds: found \['dress', 'hat'\]; expected a list of .* tshirt, top"),
        ("kinds", [], "data.kinds: found .*; expected a list"),
        ("motions.test", ["fly"], "data.motions.test: found .*; expected a list of .* walk, .*or names of .bvh files"),
        ("motions.test", ["dance", "walk"], "data.motions: found walk in train and in test; expected no motion in"),
        ("counts", {"train": 0, "test": 0}, "data.counts: no sequences"),
        ("solver.repair", 10, "data.solver.repair: found 10; expected more than data.solver.steps, which is 10"),
        ("shape.height", [1.9, 1.5], r"data.shape.height: found \[1.9, 1.5\]; expected the lower number first"),
        ("shape.height", [1.0, 1.5], "data.shape.height: found 1.0; expected a number from 1.45 to 2.05"),
        ("contact.friction", "much", "data.contact.friction: found 'much'; expected a number"),
        ("contact.friction", 2.0, "data.contact.friction: found 2.0; expected a number from 0 to 0.8"),
    ],
)
def test_a_mistake_is_refused_with_a_sentence(data: dict, key: str, value: object, sentence: str) -> None:
    wrong = copy.deepcopy(data)
    *path, last = key.split(".")
    node = wrong
    for name in path:
        node = node[name]
    node[last] = value
    with pytest.raises(DrapeError, match=sentence):
        make_request(wrong, MATERIAL)


def test_a_missing_key_names_the_page(data: dict) -> None:
    wrong = {key: value for key, value in data.items() if key != "settle"}
    with pytest.raises(DrapeError, match="data.settle: missing; see conf/data/garments.yaml"):
        make_request(wrong, MATERIAL)


def test_names_of_files_are_not_part_of_the_request(data: dict) -> None:
    one, other = (make_request(data | {"path": path}, MATERIAL) for path in ("a.h5", "b.h5"))
    assert one == other
    assert yaml.safe_load(yaml.safe_dump(one)) == one


def test_people_of_anny_are_drawn_from_their_own_measures() -> None:
    data = data_of("data/shape=anny")
    assert make_request(data, MATERIAL)["data"]["shape"]["gender"] == [0.0, 1.0]
    first, again, other = drawn_shape(0, data), drawn_shape(0, data), drawn_shape(1, data)
    assert isinstance(first, Phenotype)
    assert first == again != other
    with pytest.raises(DrapeError, match=r"data\.shape\.age: found 0\.1; expected a number from 0\.3 to 1"):
        make_request(data_of("data/shape=anny", "data.shape.age=[0.1,0.5]"), MATERIAL)
    with pytest.raises(DrapeError, match=r"data\.shape\.girth: no such key"):
        make_request(data_of("data/shape=anny", "+data.shape.girth=[1.0,1.1]"), MATERIAL)
