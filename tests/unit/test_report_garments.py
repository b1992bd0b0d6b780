"""Tables of animated garments: the paper's numbers, rows and their seeds, never two data sets in one table."""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from drape.errors import DrapeError
from drape.metrics.record import EvaluationRecord
from drape.report.document import garment_document
from drape.report.garment_curves import apart, draw_garment_comparison, error_by_frame
from drape.report.garment_rows import by_data, duration, garment_rows, published
from drape.report.garment_tables import animation_tables, comparison_table, garment_tables
from drape.report.garment_trade import draw_garment_trade, trade_rows, write_garment_trade
from drape.report.labels import row_label
from drape.report.runs import find_evaluations
from drape.report.table import Table

TWIN = "drape.simulators.baselines.Twin"
KINDS = ("tshirt", "dress")


def record(name: str, error: float, training: dict | None = None, **changes: object) -> EvaluationRecord:
    """Errors of ``error`` (T-shirt) and 3 ``error`` (dress), deviations a tenth of them."""
    values = {"tshirt": error, "dress": 3 * error, "overall": 2 * error}
    metrics = {}
    for kind, value in values.items():
        metrics |= {f"error_mm/{kind}": value, f"error_mm_std/{kind}": 0.1 * value, f"floor_mm/{kind}": 0.5}
        metrics |= {
            f"collision_percent/{kind}": 1.0,
            f"collision_percent_std/{kind}": 0.25,
            f"inside_percent/{kind}": 0,
        }
        metrics |= {f"ms_per_frame/{kind}": 40.0, f"sequences/{kind}": 2.0 if kind == "overall" else 1.0}
    data = {"path": "a.h5", "source": "made up", "split": "test", "sequences": ["0", "1"], "frames": [3, 3]}
    method = {"name": name, "simulator": {"_target_": changes.pop("target", "drape.simulators.baselines.Frozen")}}
    method |= {"training": training} if training else {}
    method |= changes.pop("method", {})
    provenance = {"command": "python src/evaluate.py"} | changes.pop("provenance", {})
    return EvaluationRecord(method, data | changes, metrics, provenance)


def solver(law: str, contact: str = "surface") -> dict:
    name = f"drape.energy.terms.contact.{contact.capitalize()}Contact"
    return {"energy": {"_target_": f"drape.energy.fabric.{law}"}, "contact": {"_target_": name}}


def trained(row: str, seed: int = 0, ablation: str = "none", scale: str = "cpu", **more: object) -> dict:
    return {"row": row, "ablation": ablation, "scale": scale, "seed": seed, "iterations": 2000} | more


def rows_of(table: Table) -> dict[str, dict[str, str]]:
    return {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}


# The paper


NUMBERS = """
MGN & 183.40 149.59 & 150.52 131.04 & 214.07 231.00 & 170.34 170.92 & 17.72 7.23
LayersNet & 114.74 97.54 & 80.96 27.69 & 108.06 69.74 & 92.72 60.93 & 14.61 6.71
MGN-S+PHYS & 68.03 21.86 & 127.07 45.56 & 103.72 62.30 & 106.63 55.48 & 2.82 1.61
MGN-S+PHYS+F & 76.58 19.38 & 130.42 45.76 & 101.47 41.27 & 108.83 45.55 & 2.92 1.48
HOOD w/o EST & 111.27 22.84 & 182.89 66.92 & 163.90 64.87 & 153.78 63.75 & 0.36 0.27
HOOD & 73.75 14.82 & 90.94 20.43 & 92.57 43.26 & 84.85 29.93 & 0.46 0.99
MGN-S+EUNet & 56.57 19.87 & 69.63 15.82 & 156.16 87.03 & 89.71 147.83 & 0.12 0.12
MGN-H+EUNet & 66.70 27.66 & 56.12 22.98 & 92.83 52.29 & 66.39 39.36 & 0.44 0.48
"""


def test_the_papers_numbers_are_all_there_with_the_labels_of_their_tables():
    columns = ("tshirt", "jumpsuit", "dress", "overall", "collision")
    expected = {}
    for line in NUMBERS.strip().splitlines():
        name, *cells = (part.strip() for part in line.split("&"))
        expected[name] = dict(zip(columns, ([float(x) for x in cell.split()] for cell in cells), strict=True))
    assert published()["rows"] == expected
    main, appendix = published()["tables"]
    assert (main["label"], appendix["label"]) == ("tbl:ani", "tbl:app_quant_cmp")
    assert appendix["rows"] == list(expected)
    assert main["rows"] == ["MGN", "LayersNet", "MGN-S+PHYS", "HOOD", "MGN-S+EUNet", "MGN-H+EUNet"]


def test_both_tables_have_ours_above_the_papers():
    ours = [record("x", 10.0, trained("hood")), record("y", 20.0, trained("hood", ablation="no_estimation"))]
    main, appendix = animation_tables(ours)
    names = [row[0] for row in main.rows]
    assert names.index("HOOD") == names.index("HOOD (paper)") - 1
    assert "HOOD w/o EST" not in names, "only the appendix has it"
    assert [row[0] for row in appendix.rows].count("HOOD w/o EST") == 1
    cells = rows_of(appendix)
    assert (
        cells["HOOD"] | {"overall": "20.00 ± 2.00", "tshirt": "10.00 ± 1.00", "jumpsuit": "", "seeds": "1"}
        == cells["HOOD"]
    )
    assert cells["HOOD w/o EST (paper)"]["jumpsuit"] == "182.89 ± 66.92"
    assert cells["HOOD (paper)"]["collision [%]"] == "0.46 ± 0.99"
    assert "tbl:ani" in main.note
    assert "80 frames of CLOTH3D" in main.note
    assert "2 sequences of a.h5 (made up), split test, 3 frames each" in main.note


def test_without_a_trained_simulator_there_is_no_table_of_the_papers():
    assert animation_tables([record("solver", 10.0, method={"energy": {}})]) == []


def test_solvers_stand_below():
    ours = [record("x", 10.0, trained("mgn")), record("implicit", 5.0, method=solver("phys")), record("frozen", 50.0)]
    assert [row[0] for row in animation_tables(ours)[0].rows][-2:] == ["MGN-H+EUNet (paper)", "solver + PHYS"]


# Rows


@pytest.mark.parametrize(
    ("row", "ablation", "label"),
    [
        ("mgn", "none", "MGN"), ("layersnet", "none", "LayersNet"), ("mgn_s_phys", "none", "MGN-S+PHYS"),
        ("mgn_s_phys_f", "none", "MGN-S+PHYS+F"), ("hood", "none", "HOOD"), ("hood", "no_estimation", "HOOD w/o EST"),
        ("mgn_s_eunet", "none", "MGN-S+EUNet"), ("mgn_h_eunet", "none", "MGN-H+EUNet"),
        ("mgn_s_eunet", "no_bending", "MGN-S+EUNet w/o bending"), ("mine", "no_bending", "mine no_bending"),
        ("mine", "none", "mine"),
    ],
)  # fmt: skip
def test_rows_have_the_papers_names(row: str, ablation: str, label: str):
    assert row_label(record("any", 1.0, trained(row, ablation=ablation))) == label


def test_a_record_says_what_its_row_is_called():
    assert row_label(record("any", 1.0, trained("mgn", label="Mine"))) == "Mine"


def test_solvers_are_named_by_their_energies_unless_the_user_has_named_them():
    """And by their names as well where the same one was evaluated with several tables."""
    named = {"provenance": {"command": "python src/evaluate.py energy=phys name=mine"}}
    found = [record(f"implicit_{law}", 5.0, method=solver(law)) for law in ("phys", "eunet", "my_own")]
    found.append(record("mine", 5.0, method=solver("phys"), **named))
    labels = {"solver + PHYS", "solver + EUNet", "solver + my own", "mine"}
    assert {row.label for row in garment_rows(found)} == labels
    names = ("implicit_eunet_baked", "implicit_eunet_baked_garment")
    found = [record(name, 5.0, method=solver("eunet_baked")) for name in names]
    assert sorted(row.label for row in garment_rows(found)) == [f"solver + baked EUNet [name {name}]" for name in names]


@pytest.mark.parametrize(
    ("settings", "contact", "label"),
    [
        ({"iterations": 300, "steps": 1}, "surface", "solver + PHYS"),
        ({"iterations": 40}, "surface", "solver + PHYS, 40 evaluations"),
        ({"iterations": 10, "steps": 4}, "surface", "solver + PHYS, 10 evaluations, 4 steps a frame"),
        ({"iterations": 300, "steps": 2}, "ipc", "solver + PHYS, contact=ipc, 2 steps a frame"),
        ({"iterations": 300}, "paper", "solver + PHYS, contact=paper"),
    ],
)
def test_labels_say_what_a_solver_might_spend_from_its_settings(settings, contact, label):
    method = solver("phys", contact) | {"simulator": settings}
    assert row_label(record("implicit_phys_5_x7", 5.0, method=method)) == label


def test_rows_stand_in_the_order_of_the_paper_and_of_budgets():
    """Whatever their errors and names are: those without dynamics, networks, solvers, the noise floor."""
    budgets = [(20, 4), (40, 1), (5, 1), (20, 1), (10, 1)]
    found = [record("twin", 0.2, target=TWIN), record("frozen", 5.0), record("skinned", 50.0)]
    for k, (iterations, steps) in enumerate(budgets):
        method = solver("eunet") | {"simulator": {"iterations": iterations, "steps": steps}}
        found.append(record(f"implicit_{k}", 5.0 + k, method=method))
    for name in ("hood", "mine", "mgn_s_eunet", "layersnet", "mgn"):
        found += [record(f"{name}_seed{seed}", 5.0, trained(name, seed=seed)) for seed in (1, 0)]
    found.append(record("free", 1.0, trained("mgn_s_eunet", ablation="no_bending")))
    labels = [row.label for row in garment_rows(found)]
    networks = ["MGN", "LayersNet", "HOOD", "MGN-S+EUNet", "MGN-S+EUNet w/o bending", "mine"]
    solvers = [f"{n} evaluations{end}" for n, end in
               ((5, ""), (10, ""), (20, ""), (20, ", 4 steps a frame"), (40, ""))]  # fmt: skip
    solvers = [f"solver + EUNet, {words}" for words in solvers]
    assert labels == ["skinned", "frozen", *networks, *solvers, "noise floor (twin)"]


def test_a_row_with_other_settings_is_neither_that_row_nor_a_seed_of_it(tmp_path: Path):
    """It says which network, law and losses it has; or what ``label=...`` has called it."""
    told = "python src/train.py model=mgn_s_eunet seed=0 logger=csv"
    other = f"{told} model/law@model.potential=network loss=newton model.potential.checkpoint=a/b.ckpt name=mine"
    commands = [told, told.replace("seed=0", "seed=1"), other, f"{other} 'label=My law'"]
    for k, command in enumerate(commands):
        (tmp_path / str(k)).mkdir()
        label = "My law" if "label" in command else "MGN-S+EUNet"
        training = trained("mgn_s_eunet", seed=k % 2, label=label, command=command)
        record(f"mgn_s_eunet_cpu_seed_{k % 2}", 10.0 + k, training).save(tmp_path / str(k))
    rows = {row.label: row.seeds for row in garment_rows(find_evaluations(tmp_path))}
    assert rows == {"MGN-S+EUNet": [0, 1], "MGN-S+EUNet (law=network, loss=newton)": [0], "My law": [1]}


def test_seeds_are_averaged_and_their_range_is_stated():
    """Means 10, 20, 60 -> 30; deviations 1, 2, 6 -> 3, which is not the deviation of anything pooled."""
    found = [record(f"hood_seed{k}", e, trained("hood", seed=k)) for k, e in ((2, 60.0), (0, 10.0), (1, 20.0))]
    (row,) = garment_rows(found)
    assert (row.label, row.seeds) == ("HOOD", [0, 1, 2])
    assert row.over_seeds("error_mm", "tshirt").mean == pytest.approx(30.0)
    table = comparison_table(found)
    cells = rows_of(table)["HOOD"]
    assert cells["tshirt"] == "30.00 ± 3.00 (10.00…60.00)"
    assert cells["seeds"] == "3"
    assert cells["collision [%]"] == "1.00 ± 0.25", "the same for every seed: no range"
    assert "range over seeds" in table.note
    assert "range over seeds" not in comparison_table(found[:1]).note


def test_a_seed_may_stand_in_the_method_or_in_the_provenance():
    one, other = record("solver", 10.0, method={"seed": 0}), record("solver", 20.0, provenance={"seed": 1})
    (row,) = garment_rows([one, other])
    assert (row.label, row.seeds) == ("solver", [0, 1])
    assert garment_rows([record("solver_s2", 1.0)])[0].label == "solver_s2", "no seed: the name as it is"


def test_names_that_differ_by_more_than_the_seed_are_two_rows():
    found = [record(f"{name}_seed{k}", 10.0, trained("hood", seed=k)) for name in ("a", "b") for k in (0, 1)]
    assert sorted((row.label, row.seeds) for row in garment_rows(found)) == [
        ("HOOD [name a]", [0, 1]), ("HOOD [name b]", [0, 1]),
    ]  # fmt: skip


def test_scales_are_never_averaged_and_said():
    found = [record("a", 10.0, trained("hood")), record("a", 20.0, trained("hood", seed=1, scale="paper"))]
    table = comparison_table([*found, record("frozen", 30.0)])
    assert {"HOOD [scale cpu]", "HOOD [scale paper]", "frozen"} <= set(rows_of(table))
    assert "different scales (cpu, paper)" in table.note
    assert "different scales" not in comparison_table(found[:1]).note


def test_shorter_trainings_are_rows_of_their_own():
    found = [record("a", 10.0, trained("hood")), record("b", 20.0, trained("hood", seed=1, iterations=9))]
    assert {row.label for row in garment_rows(found)} == {
        "HOOD [iterations 2000, name a]",
        "HOOD [iterations 9, name b]",
    }


def test_a_footnote_says_how_a_row_was_trained():
    more = {"seconds": 3600.0, "parameters": 5, "command": "python src/train.py simulator=hood"}
    found = [record(f"h_seed{k}", 10.0, trained("hood", seed=k, **more)) for k in (0, 1)]
    table = comparison_table([*found, record("frozen", 30.0)])
    assert table.footnotes == (
        "HOOD: scale cpu, seeds 0, 1, 2000 training steps, 60 min of training each, 5 parameters, "
        "by python src/train.py simulator=hood",
    )
    assert f"\n* {table.footnotes[0]}\n" in table.markdown()
    assert comparison_table([record("a", 1.0, {"row": "hood"})]).footnotes == ()
    assert [duration(s) for s in (59.6, 600.0, 9000.0)] == ["60 s", "10 min", "2.5 h"]


@pytest.mark.parametrize("training", [["hood"], {"seed": 1}, {"row": 3}])
def test_a_damaged_training_is_refused_with_a_sentence(training):
    with pytest.raises(DrapeError, match="method/training: found .* expected a mapping"):
        garment_rows([record("a", 1.0, training)])


def test_a_row_without_any_finite_error_comes_first():
    broken = record("broken", 1.0)
    kept = {key: value for key, value in broken.metrics.items() if not key.startswith("error_mm")}
    rows = garment_rows([record("fine", 10.0), dataclasses.replace(broken, metrics=kept)])
    assert [row.label for row in rows] == ["broken", "fine"]
    assert rows_of(comparison_table([record("fine", 10.0), dataclasses.replace(broken, metrics=kept)]))["broken"]


# Data


@pytest.mark.parametrize(
    "other", [{"path": "b.h5"}, {"split": "train"}, {"sequences": ["0", "2"]}, {"frames": [3, 2]}, {"source": "else"}]
)
def test_different_data_are_never_in_one_table(other: dict):
    found = [record("a", 10.0, trained("hood")), record("b", 20.0, trained("hood", seed=1), **other)]
    assert len(by_data(found)) == 2
    for table in garment_tables(found):
        assert len([row for row in table.rows if row[0] == "HOOD"]) == 1
        assert rows_of(table)["HOOD"]["overall"] in ("20.00 ± 2.00", "40.00 ± 4.00")


def test_seeds_of_one_name_are_all_found(tmp_path: Path):
    for k in range(3):
        (tmp_path / str(k)).mkdir()
        record("hood", 10.0, trained("hood", seed=k % 2)).save(tmp_path / str(k))
    assert sorted(each.method["training"]["seed"] for each in find_evaluations(tmp_path)) == [0, 1]
    found = find_evaluations(tmp_path)
    text = garment_document(garment_tables(found), found)
    assert re.search(r"\| HOOD \| 2 \|", text)
    assert "last table of the appendix" in text


# Trade and curves


def test_the_trade_has_every_row_but_the_twin(tmp_path: Path):
    found = [record("twin", 0.2, target=TWIN), record("implicit", 5.0, method=solver("phys"))]
    found += [record(f"h_seed{k}", 10.0 + k, trained("hood", seed=k)) for k in (0, 1)]
    rows = garment_rows(found)
    assert {(each["method"], each["seeds"]) for each in trade_rows(rows)} == {("solver + PHYS", 1), ("HOOD", 2)}
    with open(write_garment_trade(rows, tmp_path / "trade.png"), newline="") as file:
        lines = {line["method"]: line for line in csv.DictReader(file)}
    assert (float(lines["HOOD"]["error_mm"]), float(lines["HOOD"]["ms_per_frame"])) == (21.0, 40.0)
    assert (lines["HOOD"]["scale"], lines["solver + PHYS"]["scale"]) == ("cpu", "")
    assert lines["solver + PHYS"]["floor_mm"] == "0.5"
    assert draw_garment_trade(rows, tmp_path / "trade.png").stat().st_size > 10_000
    assert draw_garment_trade(rows[-1:], tmp_path / "none.png") is None, "the twin alone is no trade"


def test_names_keep_apart_as_near_to_their_curves_as_they_can():
    heights = np.array([2.0, 2.0, 4.0, 2.0])
    assert apart(np.array([0.0, 5.0, 9.0, 20.0]), heights) == pytest.approx([0.0, 5.0, 9.0, 20.0]), "there is room"
    assert apart(np.array([0.0, 5.0, 5.0, 20.0]), heights) == pytest.approx([0.0, 3.5, 6.5, 20.0])
    assert apart(np.array([1.0, 1.0, 1.0, 1.0]), heights) == pytest.approx([-2.75, -0.75, 2.25, 5.25])


def test_curves_are_means_over_sequences_and_seeds(tmp_path: Path):
    found = []
    for k in (0, 1):
        folder = tmp_path / str(k)
        folder.mkdir()
        lines = [f"{s},dress,{f},{10 * k + s + f},nan" for s in (0, 1) for f in (1, 2, 3) if (s, f) != (1, 3)]
        (folder / "by_frame.csv").write_text("\n".join(["sequence,kind,frame,error_mm,floor_mm", *lines]) + "\n")
        found.append(dataclasses.replace(record("h", 10.0, trained("hood", seed=k)), folder=folder))
    (row,) = garment_rows(found)
    np.testing.assert_allclose(error_by_frame(row), [6.5, 7.5, 8.0])
    assert np.isnan(error_by_frame(row, "floor_mm")).all()
    twice = [row, dataclasses.replace(row, label="HOOD, longer")]
    drawn = draw_garment_comparison(twice, tmp_path / "curves.svg", dark=True).read_text()
    assert drawn.count("<path") > 10
    assert "<!-- HOOD; HOOD,\N{NO-BREAK SPACE}longer -->" in drawn, "curves that end together have one text"
    (tmp_path / "1" / "by_frame.csv").unlink()
    assert error_by_frame(row) is None
    assert draw_garment_comparison([row], tmp_path / "none.png") is None
