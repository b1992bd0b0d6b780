"""Evaluations of garments: what is chosen, what is kept when interrupted, how sequences are summed up."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from drape.config.entry_point import CONF
from drape.data.hdf5 import GarmentFile
from drape.errors import DrapeError
from drape.evaluation.garments import evaluate
from drape.evaluation.method import Method
from drape.evaluation.output import summarised
from drape.evaluation.scored_sequence import ScoredSequence, mean_by_frame, read_by_frame, write_rows
from drape.evaluation.selection import Selection
from drape.metrics.garment_scores import SCORES
from drape.metrics.record import EvaluationRecord
from drape.report.garment_tables import comparison_tables, kinds_table
from drape.report.runs import find_evaluations, find_runs, has_runs
from drape.simulators.baselines import Frozen
from tests import garments


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> GarmentFile:
    return GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5"))


class Counted(Method):
    """A method whose simulator counts its steps, and is interrupted after some."""

    def __init__(self, file: GarmentFile, stop: int | None = None):
        self.file, self.stop, self.steps, self.areal_density = file, stop, 0, None

    def prepare(self, sequences):
        self.fabrics = {sequence.fabric for sequence in sequences}

    def settings(self, sequence):
        return {"simulator": "counted", "sequence": sequence.name}

    def simulator(self, sequence, scene):
        frozen, method = Frozen(scene, sequence), self

        class Simulator:
            def step(self, state, frame):
                if method.steps == method.stop:
                    raise KeyboardInterrupt
                method.steps += 1
                return frozen.step(state, frame)

        return Simulator()


def scored(kind: str, error: float, floor: float, frames: int = 3) -> ScoredSequence:
    by_frame = {name: np.zeros(frames) for name in SCORES}
    by_frame |= {"error_mm": error * np.arange(1, frames + 1), "floor_mm": np.full(frames, floor)}
    return ScoredSequence("00000", kind, "silk", "walk", 70, by_frame, ms_per_frame=5.0, converged_percent=100.0)


def record(name: str, error: float, target: str = "drape.simulators.baselines.Frozen", **data) -> EvaluationRecord:
    found = summarised([scored("dress", error, 0.5), scored("jumpsuit", 2 * error, 1.0)])
    about = {"path": "a.h5", "source": "test", "split": "test", "sequences": ["0", "1"], "frames": [3, 3]} | data
    return EvaluationRecord({"name": name, "simulator": {"_target_": target}}, about, found, {"command": "c"})


# Choice


def test_sequences_are_chosen_by_split_kind_and_number(file):
    assert Selection("test").of(file) == {"00001": 4, "00002": 4, "00003": 4}
    assert Selection("test", kinds=["skirt"], frames=2).of(file) == {"00002": 2, "00003": 2}
    assert Selection("test", sequences=1).of(file) == {"00001": 4}
    assert Selection("train", sequences=9).of(file) == {"00000": 4}
    with pytest.raises(DrapeError, match=r"sequences/00001: frames: found 5; expected 1\.\.4"):
        Selection("test", frames=5).of(file)


# Interruptions


@pytest.mark.parametrize(
    ("overrides", "name"),
    [
        ([], "implicit_phys"),
        (["simulator.iterations=300"], "implicit_phys"),
        (["simulator.iterations=10"], "implicit_phys_10"),
        (["simulator.steps=2"], "implicit_phys_x2"),
        (["simulator.steps=4", "simulator.iterations=20"], "implicit_phys_20_x4"),
    ],
)
def test_a_solver_is_named_by_what_it_may_spend(file, overrides, name):
    """However that was said: the settings count, and those that are usual say nothing."""
    with initialize_config_dir(str(CONF), version_base=None):
        config = compose("evaluate", ["energy=phys", *overrides])
    assert Method(config, file).named("implicit", "phys") == name


@pytest.mark.parametrize(("contact", "name"), [("surface", "implicit_phys_10"), ("ipc", "implicit_phys_ipc_10")])
def test_a_solver_is_named_by_its_contact(file, contact, name):
    """So that ``evaluate.py -m contact=surface,ipc`` is two evaluations."""
    with initialize_config_dir(str(CONF), version_base=None):
        config = compose("evaluate", ["energy=phys", "simulator.iterations=10", f"contact={contact}"])
    assert Method(config, file).named("implicit", "phys", contact) == name


class Trained(Counted):
    """A method with a network that says this of its training."""

    def __init__(self, file: GarmentFile, **told):
        super().__init__(file)
        self.training = {"row": "mgn", "ablation": "none", "scale": "cpu", "seed": 0} | told
        self.config = OmegaConf.create({"simulator": {"checkpoint": "some.ckpt"}})


@pytest.mark.parametrize(
    ("told", "name"),
    [
        ({}, "mgn_cpu_seed_0"),
        ({"name": "mgn"}, "mgn_cpu_seed_0"),
        ({"name": "mgn_5_steps", "ablation": "no_bending"}, "mgn_5_steps_no_bending_cpu_seed_0"),
    ],
)
def test_a_network_is_named_by_its_run(file, told, name):
    """By the name that the user gave it, so that two with other settings are two evaluations."""
    assert Trained(file, **told).named("neural") == name


@pytest.mark.parametrize("told", [{"name": "../mgn"}, {"row": "elsewhere/mgn"}, {"scale": "a/../.."}])
def test_a_file_does_not_say_where_its_evaluation_goes(file, told):
    with pytest.raises(DrapeError, match=r"some\.ckpt: training: found the name"):
        Trained(file, **told).named("neural")


def test_an_interrupted_sequence_goes_on_at_its_frame(file, tmp_path):
    """Stopped in the middle of the second of two sequences of 4 frames: 6 frames are there, 2 are missing."""
    chosen = Selection("test", sequences=2).of(file)
    with pytest.raises(KeyboardInterrupt):
        evaluate(Counted(file, stop=6), chosen, tmp_path / "a")
    rest = Counted(file)
    resumed = evaluate(rest, chosen, tmp_path / "a")
    assert (rest.steps, rest.fabrics) == (2, {"silk", "denim"})
    whole = evaluate(Counted(file), chosen, tmp_path / "b")
    for one, other in zip(resumed, whole, strict=True):
        assert one.by_frame.keys() == other.by_frame.keys()
        for name in SCORES:
            np.testing.assert_array_equal(one.by_frame[name], other.by_frame[name])


def test_scores_of_an_older_sequence_are_not_kept_for_a_new_one(file, tmp_path):
    chosen = Selection("test", sequences=1).of(file)
    evaluate(Counted(file), chosen, tmp_path)
    (tmp_path / "sequences" / "00001.h5").unlink()
    kept = tmp_path / "sequences" / "00001.csv"
    kept.write_text(kept.read_text().replace("dress", "older"))
    evaluate(Counted(file), chosen, tmp_path)
    assert "older" not in kept.read_text()


def test_kept_scores_come_back_exactly_and_damaged_ones_do_not(tmp_path):
    path = tmp_path / "a.csv"
    each = scored("dress", 1 / 3, np.nan)
    write_rows(path, list(each.frame_rows()))
    for name, values in read_by_frame(path, 3).items():
        np.testing.assert_array_equal(values, each.by_frame[name])
    assert read_by_frame(path, 4) is None, "frames are missing"
    path.write_text(path.read_text()[:-30])
    assert read_by_frame(path, 3) is None, "cut off"
    assert read_by_frame(tmp_path / "none.csv", 3) is None


# Sums


def test_means_are_over_frames_then_over_sequences():
    found = summarised([scored("dress", 1.0, 0.5), scored("dress", 3.0, 1.5), scored("skirt", 2.0, 1.0, frames=1)])
    assert found["error_mm/dress"] == pytest.approx((2.0 + 6.0) / 2)
    assert found["error_mm_std/dress"] == pytest.approx(2.0)
    assert found["error_mm/overall"] == pytest.approx((2.0 + 6.0 + 2.0) / 3), "a short sequence counts as a long one"
    assert found["error_in_floors/dress"] == pytest.approx(4.0)
    assert (found["sequences/dress"], found["sequences/overall"], found["ms_per_frame/skirt"]) == (2, 3, 5)


def test_the_mean_by_frame_is_over_the_sequences_that_are_that_long():
    mean = mean_by_frame([scored("dress", 1.0, np.nan, frames=3), scored("dress", 3.0, np.nan, frames=2)], "error_mm")
    np.testing.assert_allclose(mean, [2.0, 4.0, 3.0])
    assert np.isnan(mean_by_frame([scored("dress", 1.0, np.nan)], "floor_mm")).all()


# Tables


def test_the_table_of_one_evaluation_has_a_row_for_each_kind():
    table = kinds_table(record("mine", 10.0))
    assert [row[0] for row in table.rows] == ["jumpsuit (1)", "dress (1)", "overall (2)"]
    cells = dict(zip(table.columns, table.rows[1], strict=True))
    assert (cells["error [mm]"], cells["floors"], cells["ms/frame"]) == ("20.00 ± 0.00", "40.00", "5.00")


def test_evaluations_of_the_same_sequences_stand_in_one_table_with_the_paper():
    other = record("few", 10.0, sequences=["0"], frames=[3])
    first, second = comparison_tables([record("good", 10.0), record("bad", 20.0), other])
    assert [row[0] for row in first.rows][:3] == ["bad", "good", "noise floor (twin)"]
    assert dict((row[0], row[1]) for row in first.rows)["HOOD (paper)"] == "90.94 ± 20.43", "jumpsuits first"
    assert [row[0] for row in second.rows] == ["few", "noise floor (twin)"]
    twin = comparison_tables([record("good", 10.0), record("twin", 1.0, target="drape.simulators.baselines.Twin")])[0]
    assert [row[0] for row in twin.rows][:2] == ["good", "noise floor (twin)"]
    assert not twin.rows[2][0].startswith("noise floor"), "once is enough"


def test_reports_tell_evaluations_from_trainings(tmp_path: Path, capsys):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        record("mine", 10.0).save(tmp_path / name)
    assert len(find_evaluations(tmp_path)) == 1, "the same name on the same data: the newest counts"
    assert not has_runs(tmp_path)
    with pytest.raises(DrapeError, match="no finished run below it"):
        find_runs(tmp_path)
    (tmp_path / "b" / "metrics.json").write_text(json.dumps({"format": "drape evaluation", "version": 0}))
    assert [each.folder.name for each in find_evaluations(tmp_path)] == ["a"]
    assert "evaluate again" in capsys.readouterr().err
