"""The trade of the same garments in several resolutions: exponents, frontier, what is recommended."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from drape.metrics.record import EvaluationRecord
from drape.report.garment_sizes import (
    BLENDER,
    MARKERS,
    blender_costs,
    draw_sizes,
    exponent,
    recommended,
    size_tables,
    sizes,
)
from drape.report.trade_points import Point, name_points

SOLVER = {"simulator": {"_target_": "drape.simulators.solver.implicit.ImplicitSolver"}, "energy": {"_target_": "x"}}
ROWS = {
    "skinned": ({"simulator": {"_target_": "drape.simulators.baselines.Skinned"}}, 0.01, 0.5, 40.0),
    "quick": (SOLVER, 0.02, 1.0, 12.0),
    "slow": (SOLVER, 0.1, 1.5, 9.0),
    "ipc": (SOLVER | {"contact": {"_target_": "drape.energy.terms.ipc.IpcContact"}}, 1.0, 1.0, 8.5),
    "net": ({"simulator": {"_target_": "x"}, "training": {"row": "net", "scale": "cpu", "seed": 0}}, 0.015, 1.0, 30.0),
}
"""By name: method, time [ms] and exponent of ``time · vertices^exponent / 10``, error [mm]."""


def evaluations(folder: Path, *, names: tuple[str, ...] = tuple(ROWS), vertices=(500, 2000)) -> list[EvaluationRecord]:
    found = []
    for size in vertices:
        for name in names:
            method, time, power, error = ROWS[name]
            path = folder / str(size) / name
            path.mkdir(parents=True)
            costs = [(number, time * number**power) for number in (0.8 * size, 1.2 * size)]
            with (path / "sequences.csv").open("w", newline="") as file:
                csv.writer(file).writerows([("vertices", "ms_per_frame"), *costs])
            metrics = {"error_mm/overall": error, "ms_per_frame/overall": sum(cost for _, cost in costs) / 2}
            metrics |= {"floor_mm/overall": 3.0, "sequences/overall": 2}
            data = {"path": f"{size}.h5", "source": "x", "split": "test", "sequences": ["0", "1"], "frames": [3, 3]}
            found.append(EvaluationRecord({"name": name} | method, data, metrics, {"command": ""}, path))
    return found


def test_exponents_of_time_are_those_that_were_put_in(tmp_path):
    found = sizes(evaluations(tmp_path, vertices=(8000, 500, 2000)))
    assert [size.vertices for size in found] == [500, 2000, 8000]
    labels = {str(row.records[0].method["name"]): label for label, row in found[0].rows.items()}
    for name, (_, _, power, _) in ROWS.items():
        assert exponent(labels[name], found) == pytest.approx(power)


def test_one_data_set_or_lists_of_other_lengths_are_no_sizes(tmp_path):
    assert sizes(evaluations(tmp_path, vertices=(500,))) == []
    alone = evaluations(tmp_path / "more", vertices=(500,))
    assert (draw_sizes(sizes(alone), tmp_path / "none.png"), size_tables(sizes(alone))) == (None, [])


def test_needs_are_met_by_error_within_the_time_and_time_within_the_error(tmp_path):
    """500 vertices: skinned 0.2 ms, net 7.5, quick 10, ipc 500, slow 1100; errors 40, 30, 12, 8.5, 9 mm."""
    coarse, fine = sizes(evaluations(tmp_path))
    assert {need: coarse.rows[label].records[0].method["name"] for need, label in recommended(coarse).items()} == {
        "real time": "quick",
        "preview": "quick",
        "final": "ipc",
    }
    assert fine.rows[recommended(fine)["real time"]].records[0].method["name"] == "net"


def test_the_table_has_both_numbers_of_each_size_and_the_exponent(tmp_path):
    given = evaluations(tmp_path, names=("skinned", "slow"))
    found = sizes(given)
    (table,) = size_tables(found)
    assert table.columns == ("method", "500 vertices", "2000 vertices", "time ~ vertices^p")
    assert [found[0].rows[row[0]].family for row in table.rows] == ["without dynamics", "solver"]
    assert table.rows[1][3] == "1.50"
    assert table.rows[1][1].endswith(" / 9")
    assert "For real time (30 frames per second): skinned (500 vertices); skinned (2000 vertices)." in table.note


def test_blender_stands_at_the_noise_floor_and_is_never_recommended(tmp_path, capsys):
    """In the sizes that it was timed in; a broken table is named and left out."""
    times = tmp_path / "benchmark" / "blender_time.csv"
    times.parent.mkdir()
    rows = [(f"{size}.h5", share * size, 2.0 * share * size) for size in (500, 2000) for share in (0.8, 1.2)]
    with times.open("w", newline="") as file:
        csv.writer(file).writerows([("file", "vertices", "ms_per_frame"), *rows])
    (tmp_path / "blender_time.csv").write_text("file,vertices\na.h5,many\n")
    found = sizes(evaluations(tmp_path, vertices=(500, 2000, 8000)), blender_costs(tmp_path))
    assert f"left out: {tmp_path / 'blender_time.csv'}: damaged" in capsys.readouterr().err
    points = [size.points.get(BLENDER) for size in found]
    assert points == [Point(1000.0, 3.0, BLENDER), Point(4000.0, 3.0, BLENDER), None]
    assert exponent(BLENDER, found) == pytest.approx(1.0)
    assert BLENDER not in recommended(found[0]).values()
    (table,) = size_tables(found)
    assert table.rows[-1] == (BLENDER, "1000 / 3", "4000 / 3", "", "1.00")
    assert BLENDER in draw_sizes(found, tmp_path / "sizes.svg").read_text()


def test_the_figure_has_a_marker_for_each_of_any_number_of_sizes(tmp_path):
    """More sizes than there are markers: in the legend are all of them."""
    vertices = range(500, 500 + 20 * (len(MARKERS) + 2), 20)
    found = sizes(evaluations(tmp_path, names=("slow",), vertices=vertices))
    text = draw_sizes(found, tmp_path / "sizes.svg").read_text()
    assert [text.count(f"<!-- {size.vertices:.0f} vertices -->") for size in found] == [1] * len(found)


def test_points_that_hide_each_other_have_one_text():
    """The nearest first; not with points of another family, nor with those that are only as slow or only as near."""
    named = [
        ("MGN", Point(20.0, 31.0, "networks")), ("HOOD", Point(22.0, 30.0, "networks")),
        ("solver, 5 evaluations", Point(20.0, 31.0, "solver")), ("LayersNet", Point(20.0, 60.0, "networks")),
        ("skinned", Point(0.1, 31.0, "without dynamics")), ("solver, 9 evaluations", Point(40.0, 9.0, "solver")),
        ("solver + PHYS, 9 evaluations", Point(40.0, 38.0, "solver")),
    ]  # fmt: skip
    texts = [text.replace("\N{NO-BREAK SPACE}", " ") for text, _ in name_points(named)]
    solvers = ["5 evaluations", "9 evaluations", "solver + PHYS, 9 evaluations"]
    assert sorted(texts) == sorted(["HOOD; MGN", "LayersNet", "skinned", *solvers])
    assert not name_points([])
