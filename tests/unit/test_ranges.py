"""Every number of the project's own options is in its range, and every kind of nonsense is not."""

from __future__ import annotations

import inspect
import math

import pytest

from drape.config.from_file import targets
from drape.config.ranges import out_of_range, range_of
from drape.config.target import locate


@pytest.mark.parametrize(
    ("path", "good", "bad"),
    [
        ("seed", [0, 2**32 - 1], [-1, 1.0, 2**32]),
        ("scale.width", [1, 64], [0, -1, 1e9, 2.5]),
        ("scale.max_steps", [-1, 1], [0, -2, 1.5]),
        ("schedule.warmup", [0, 0.03, 1], [-0.1, 1.1]),
        ("attribute_scales.mass_per_vertex", [3.0, math.inf], [0, -1, math.nan]),
        ("fabric.mass_per_vertex", [3.0], [0, -1, math.inf]),
        ("data.counts.train", [0, 4], [-1, 0.5]),
        ("data.frames", [1], [0]),
        ("scene.gravity", [-9.81, 0], [math.nan, math.inf]),
        ("simulator.force", [0.0], [-1.0, 1e300]),
    ],
)
def test_a_name_has_one_range(path, good, bad):
    assert [value for value in good if not range_of(path).holds(value)] == []
    assert [value for value in bad if range_of(path).holds(value)] == []


def test_lists_and_nodes_count_as_what_they_stand_in():
    assert list(out_of_range({"data": {"frames": [0, 300]}, "scene": {"gravity": [0.0, 0.0, -9.81]}})) == []
    assert list(out_of_range({"output": {"size": [0, 5]}})) == [
        "output.size.0: found 0; expected a whole number from 1 to 1e+09"
    ]


@pytest.mark.parametrize("name", ["../x", "a/b", "", "..", ".x", " "])
def test_a_name_stays_in_its_folder(name):
    assert len(list(out_of_range({"name": name}))) == 1


def test_no_target_takes_anything():
    """``**anything`` would take misspelt arguments, too."""
    loose = []
    for name in sorted(each for each in targets(".") if each.startswith("drape.")):
        kinds = {parameter.kind for parameter in inspect.signature(locate(name)).parameters.values()}
        loose += [name] if kinds & {inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL} else []
    assert len(targets(".")) > 80
    assert loose == []
