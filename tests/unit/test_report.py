"""Reports of finished runs: tables, missing runs, figures."""

import dataclasses
import json
import os
import re

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from drape.config import instantiate
from drape.config.resolvers import CONF
from drape.errors import DrapeError
from drape.metrics.record import RunRecord
from drape.report.curves import draw_curves, panels, read_curves
from drape.report.document import document, missing, settings_of, tables
from drape.report.energy_map import POINTS, draw_energy_map, energy_of, sample_map
from drape.report.learned import learned_energies
from drape.report.runs import Configuration, configurations, find_runs
from drape.report.table import Table, number
from drape.report.tables import arranged, energy_error_table, force_table, orderings, paper
from drape.report.training_trade import draw_training_trade
from tests.energies import make_energy

ABLATIONS = ("none", "no_dissipation", "no_contrastive")
MAKERS = list(instantiate(OmegaConf.load(CONF / "tables" / "laws.yaml")).values())
SILK = {"none": 1.0, "no_dissipation": 4.0, "no_contrastive": 1.1}


def record(ablation: str, seed: int, *, loss: str = "paper", width: int = 128, **metrics: float) -> RunRecord:
    silk = SILK[ablation] + 0.1 * (seed - 1)
    return RunRecord(
        model="eunet",
        ablation=ablation,
        seed=seed,
        variant={"potential": "mlp", "dissipation": "zero" if ablation == "no_dissipation" else "speed", "loss": loss},
        setting={"data": "cloth", "material": "all", "scale": "cpu", "width": width, "steps": 100},
        metrics={
            "energy_error_J2/silk": silk,
            "energy_error_J2_std/silk": 2.0 * silk,
            "energy_error_J2/overall": 10.0 * silk,
            "energy_error_J2_std/overall": 30.0 * silk,
            "force_residual_N/silk": 0.5,
            "force_residual_N/overall": 0.7,
            "inertial_force_N/silk": 1.5,
            "inertial_force_N/overall": 5.0,
            "spring_hinge_residual_N/silk": 0.2,
            "spring_hinge_residual_N/overall": 1.2,
            "stretch_stiffness_ratio/silk": 0.9,
        }
        | metrics,
        provenance={
            "command": f"python src/train.py loss={loss} ablation={ablation} seed={seed} scale=cpu",
            "data": "data/cloth.h5",
            "train_sequences": 800,
            "test_sequences": 200,
            "seconds": 60.0 * (seed + 1) * width,
            "versions": {"torch": "2.13"},
        },
    )


RUNS = [record(ablation, seed) for ablation in ABLATIONS for seed in (0, 1, 2)]


def _found(runs: list[RunRecord]) -> list[Configuration]:
    return arranged(configurations(runs), ABLATIONS)


def rows_of(table: Table) -> dict[str, tuple[str, ...]]:
    return {row[0]: row[1:] for row in table.rows}


def test_papers_numbers_stand_beside_ours():
    table = energy_error_table(_found(RUNS))
    assert table.columns == ("configuration", "seeds", "overall", "silk")
    assert [row[0] for row in table.rows[::2]] == ["EUNet", "EUNet w/o Φd", "EUNet w/o L_con"]
    assert table.rows[0][1:] == ("3", "10.00 ± 30.00 (9.00…11.00)", "1.00 ± 2.00 (0.90…1.10)")
    assert table.rows[1] == ("– in the paper", "", "85.74 ± 543.06", "0.94 ± 4.44")


def test_papers_numbers_are_those_of_its_table():
    rows = paper()["rows"]
    assert rows["EUNet"]["denim"] == [201.63, 670.55]
    assert rows["EUNet w/o Φd"]["overall"] == [211.76, 1052.02]
    assert rows["EUNet w/o L_con"]["cotton"] == [2.38, 6.31]
    for row in rows.values():  # overall is the mean of fabrics in nearly equal parts
        assert np.mean([row[fabric][0] for fabric in paper()["fabrics"]]) == pytest.approx(row["overall"][0], rel=0.02)


def test_another_loss_is_another_row_without_the_papers_numbers():
    found = _found([*RUNS, record("none", 0, loss="forces")])
    rows = rows_of(energy_error_table(found))
    assert rows["EUNet (loss=forces)"] == ("1", "9.00 ± 27.00", "0.90 ± 1.80")
    assert [row[0] for row in energy_error_table(found).rows[-2:]] == ["– in the paper", "EUNet (loss=forces)"]


def test_another_model_comes_last_under_its_own_name():
    parts = {"potential": "hinge", "dissipation": "zero", "loss": "forces"}
    hinges = dataclasses.replace(record("no_dissipation", 0), model="eunet_hinge", variant=parts)
    unknown = dataclasses.replace(record("none", 0), model="springs", variant={})
    rows = [row[0] for row in force_table(_found([unknown, hinges, *RUNS])).rows]
    assert rows[2:] == ["EUNet", "EUNet w/o Φd", "EUNet w/o L_con", "EUNet on hinges w/o Φd", "springs"]


def test_a_record_says_what_it_is_called():
    """Whatever the configuration calls that row by now; no paper has a number for it."""
    named = [dataclasses.replace(run, label="Mine") for run in RUNS[:3]]
    assert [row[0] for row in energy_error_table(_found(named)).rows] == ["Mine"]


def test_a_label_of_the_command_line_says_everything():
    other = dataclasses.replace(record("none", 0, loss="forces"), label="Mine")
    command = {"command": "python src/train.py loss=forces 'label=Mine'"}
    called = dataclasses.replace(other, provenance=dict(other.provenance) | command)
    names = [energy_error_table(_found([run])).rows[0][0] for run in (other, called)]
    assert names == ["Mine (loss=forces)", "Mine"]


def test_force_table_begins_with_nothing_and_the_law():
    table = force_table(_found(RUNS))
    assert [row[0] for row in table.rows[:3]] == ["no internal force", "fitted spring-hinge law", "EUNet"]
    assert table.rows[1][2:] == ("1.20", "0.20")


def test_orderings_say_when_seeds_overlap():
    rows = rows_of(orderings(_found(RUNS)))
    assert rows["EUNet < EUNet w/o Φd"][1] == "yes (1.00 / 4.00)"
    assert rows["EUNet < EUNet w/o L_con"][1] == "open (1.00 / 1.10)"
    single = rows_of(orderings(_found([RUNS[0], RUNS[3]])))
    assert single["EUNet < EUNet w/o Φd"][1] == "open (0.90 / 3.90)"
    worse = [dataclasses.replace(run, metrics=run.metrics | {"energy_error_J2/silk": 9.0}) for run in RUNS[:3]]
    rows = rows_of(orderings(_found([*worse, *RUNS[3:]])))
    assert rows["EUNet < EUNet w/o Φd"][1] == "no (9.00 / 4.00)"


def test_missing_runs_are_named_with_their_command():
    found = _found([run for run in RUNS if (run.ablation, run.seed) != ("no_dissipation", 2)])
    assert missing(found, ABLATIONS, (0, 1, 2)) == [
        "python src/train.py loss=paper scale=cpu ablation=no_dissipation seed=2"
    ]
    other = _found([record("none", 0, loss="forces")])
    assert missing(other, ("none",), (4,)) == ["python src/train.py model=eunet ablation=none seed=4"]


def test_document_puts_the_papers_setting_first():
    narrow = [record("none", 0, width=16)]
    text = document([*narrow, *RUNS], ABLATIONS, (0, 1, 2), MAKERS)
    assert text.index("width=128") < text.index("width=16")
    assert "800 training and 200 test sequences" in text
    assert "Missing runs" not in text
    assert "`python src/train.py loss=paper scale=cpu ablation=none seed=<seed>`" in text
    assert "no_contrastive seed=0" in document(narrow, ABLATIONS, (0,), MAKERS)
    titles = [table.title for table in tables(settings_of(RUNS, ABLATIONS)[0], MAKERS)]
    assert len(titles) == 4
    assert titles[3].startswith("Stiffness")


def test_markdown_of_a_table():
    table = Table("T", ("name", "|x|"), (("a", "1"),), note="n")
    assert table.markdown() == "### T\n\nn\n\n| name | \\|x\\| |\n|---|---:|\n| a | 1 |\n"
    assert table.terminal().row_count == 1


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (85.744, "85.74"), (0.944, "0.94"), (-3.0, "-3.00"), (1052.02, "1052"), (1.234e-3, "0.00123")],
)
def test_numbers(value, text):
    assert number(value) == text


def test_records_are_read_as_they_were_written(tmp_path):
    for run in RUNS:
        folder = tmp_path / run.ablation / f"seed_{run.seed}"
        folder.mkdir(parents=True)
        run.save(folder)
    found = find_runs(tmp_path)
    assert len(found) == 9
    assert found[0] == next(run for run in RUNS if (run.ablation, run.seed) == ("no_contrastive", 0))
    assert found[0].folder == tmp_path / "no_contrastive" / "seed_0"


def test_of_two_equal_runs_the_newest_counts(tmp_path):
    for k, name in enumerate(("z", "a")):
        (tmp_path / name).mkdir()
        path = record("none", 0, **{"energy_error_J2/silk": float(k)}).save(tmp_path / name)
        os.utime(path, (1000 + k, 1000 + k))
    assert [run.metrics["energy_error_J2/silk"] for run in find_runs(tmp_path)] == [1.0]


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda path: path.unlink(), "^$"),
        (lambda path: path.write_text(path.read_text()[:100]), "not JSON"),
        (lambda path: path.write_text("[1]"), "holds a list"),
        (lambda path: path.write_text("{}"), r"format and version are \(None, None\)"),
        (lambda path: _edit(path, seed="0"), "seed is '0'; expected int"),
        (lambda path: _edit(path, setting={"data": "cloth"}), "setting has no scale; it has data"),
    ],
)
def test_broken_records_are_left_out_with_a_sentence(tmp_path, spoil, sentence, capsys):
    for name, run in zip("ab", RUNS, strict=False):
        (tmp_path / name).mkdir()
        run.save(tmp_path / name)
    spoil(tmp_path / "a" / "metrics.json")
    assert [run.folder.name for run in find_runs(tmp_path)] == ["b"]
    assert re.search(sentence, capsys.readouterr().err)
    (tmp_path / "b" / "metrics.json").unlink()
    with pytest.raises(DrapeError, match="no finished run below it"):
        find_runs(tmp_path)


def _edit(path, **values) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def spring(stretch, alpha, beta, attributes):
    """3 J at rest, softer in bending."""
    return 3.0 + 0.5 * attributes[:, 0] * stretch**2 + 1e-3 * (1 - alpha.cos()) + 1e-3 * (1 - beta.cos())


def test_energy_map_is_relative_to_rest():
    energies = sample_map(spring, torch.tensor([1000.0]))
    middle = POINTS // 2
    assert energies.shape == (POINTS, POINTS)
    assert energies[middle, middle] == 0.0
    assert energies[middle, -1] == pytest.approx(0.5 * 1000 * 5e-3**2)
    assert energies[0, middle] == pytest.approx(1e-3)
    np.testing.assert_allclose(energies, energies[::-1, ::-1], atol=1e-12)


@pytest.mark.parametrize("potential", ["mlp", "hinge"])
def test_the_map_of_learned_units_is_of_what_they_see(potential):
    """Change of length and twist of the paper's units, dihedral angle of hinges: in radians, zero at rest."""
    units = make_energy(potential, "none").potential
    stretch, angle = (size * torch.randn(7, dtype=torch.float64) for size in (0.01, 1.0))
    attributes = torch.rand(7, 5, dtype=torch.float64)
    sees = [stretch, angle] if potential == "hinge" else [stretch, angle.cos(), angle.sin(), angle**0, 0 * angle]
    found = energy_of(units)(stretch, angle, 0 * angle, attributes)
    torch.testing.assert_close(found, units.energies(torch.stack(sees, -1), attributes), rtol=1e-9, atol=1e-12)
    rest = energy_of(units)(*torch.zeros(3, 7, dtype=torch.float64), attributes)
    assert potential == "mlp" or not rest.any()


def test_figures_are_drawn(tmp_path):
    fabrics = {"silk": torch.tensor([100.0]), "leather": torch.tensor([9000.0])}
    assert _size(draw_energy_map({"spring": spring, "w/o Φd": spring}, fabrics, tmp_path / "map.png")) > 20_000
    narrow = [record("none", 0, width=width, **{"force_residual_N/overall": 9.0 / width}) for width in (16, 32, 64)]
    assert _size(draw_training_trade([*RUNS, *narrow], tmp_path / "deep" / "trade.png")) > 20_000


def _size(path) -> int:
    assert path.read_bytes()[:4] == b"\x89PNG"
    return path.stat().st_size


CSV = """epoch,lr-Adam,step,train/loss/energy_balance,train/loss/contrastive,val/energy_error_J2/silk,val/total
0,0.1,0,3.0,,,
0,0.1,10,2.0,nan,,
0,,10,,,5.0,7.0
1,0.05,20,1.0,4.0,,
"""


def test_curves_skip_gaps(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text(CSV)
    curves = read_curves(path)
    assert curves["train/loss/energy_balance"] == ([0, 10, 20], [3.0, 2.0, 1.0])
    assert curves["train/loss/contrastive"] == ([20], [4.0])
    assert set(panels(curves)) == {"lr-Adam", "train/loss", "val/energy_error_J2", "val/total"}
    assert set(panels(curves)["train/loss"]) == {"energy_balance", "contrastive"}
    assert _size(draw_curves(path, tmp_path / "figures" / "curves.png")) > 20_000


def test_curves_of_something_else_are_refused(tmp_path):
    with pytest.raises(DrapeError, match="no such file"):
        read_curves(tmp_path / "metrics.csv")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DrapeError, match="expected one called step"):
        read_curves(tmp_path / "other.csv")


def test_a_checkpoint_that_cannot_be_loaded_is_named_and_left_out(tmp_path, capsys):
    """Of another version of the program, or cut short: the other laws are drawn all the same."""
    path = tmp_path / "checkpoints" / "last.ckpt"
    path.parent.mkdir()
    path.write_bytes(b"no checkpoint")
    run = dataclasses.replace(record("none", 0), folder=tmp_path)
    assert learned_energies(configurations([run])) == {}
    assert f"left out: {path}" in capsys.readouterr().err
