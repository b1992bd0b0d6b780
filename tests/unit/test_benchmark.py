"""What measurements say is what was measured: errors against known motions, meshes anew, sag, tables, pictures."""

from __future__ import annotations

import csv
import importlib.util
import itertools
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from PIL import Image

from drape.benchmark.composed import Composed
from drape.benchmark.energies import medians
from drape.benchmark.held_out import Animated, HeldOut, Variant, animate, combinations, nearest, summary
from drape.benchmark.measured import Measured
from drape.benchmark.resolution import Resolution, held_around_pins, refined, sag
from drape.blender.presets import read_preset
from drape.blender.timed_cloth import TimedCloth, check_comparable
from drape.config import check_config, instantiate
from drape.config.entry_point import CONF
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.metrics.position import distance_travelled, vertex_distance
from drape.report.last_frames import SIZE, LastFrames, draw_last_frames
from drape.report.trade import draw_trade
from drape.scene.material import Material
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.square_resampling import SquareResampling, resampled
from drape.scene.state import State
from drape.simulators.simulator import Outcome, StepResult

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
FALL = np.array([0.0, 0.0, -9.81])


def hanging_scene(count: int = 4, frames: int = 3, **changes: object) -> Scene:
    mesh = square_grid(1.2, count)
    parts = {
        "name": "test",
        "mesh": mesh,
        "initial": State.at_rest(mesh.rest_positions),
        "material": SILK,
        "mass": np.full(mesh.num_vertices, 0.15),
        "gravity": FALL,
        "dt": 1 / 30,
        "frames": frames,
        "pins": Pins.fixed([0, count - 1], mesh.rest_positions),
    }
    return Scene(**parts | changes)


def composed(*overrides: str):
    with initialize_config_dir(str(CONF), version_base=None):
        return compose("benchmark", list(overrides))


class Shift:
    """Moves the whole cloth by 1 m along x in each step; the second step does not converge."""

    def step(self, state: State, frame: int) -> StepResult:
        outcome = Outcome.ITERATIONS if frame == 1 else Outcome.CONVERGED
        return StepResult(State.at_rest(state.x + [1.0, 0.0, 0.0]), outcome, 10 + frame, 0.15 * 9.81 * 0.01)


def test_distances_of_a_known_motion():
    x = np.zeros((3, 5, 3))
    x[1:, :, 0], x[2, :, 1] = 3.0, 4.0
    assert distance_travelled(x) == pytest.approx((3 + 5) / 2)
    assert vertex_distance(x, x + [0.0, 0.0, 2.0]) == pytest.approx(2.0)


def test_an_animation_is_compared_frame_by_frame():
    """Recorded: at rest, then 1 m, 2 m, 4 m along x; simulated: 1, 2, 3 m; so 1 m off in one of three frames."""
    scene = hanging_scene()
    recorded = np.stack([scene.initial.x + [shift, 0.0, 0.0] for shift in (0.0, 1.0, 2.0, 4.0)])
    found = animate(Shift(), scene, recorded)
    assert found.error == pytest.approx(1 / 3)
    assert found.travelled == pytest.approx(7 / 3)
    assert found.evaluations == pytest.approx(11.0)
    assert found.residual == pytest.approx(0.01)
    assert found.converged == pytest.approx(2 / 3)
    assert found.seconds > 0


@pytest.mark.parametrize("count", [2, 4, 7])
def test_another_mesh_is_compared_at_the_recorded_vertices(count):
    scene = hanging_scene()
    recorded = np.stack([scene.initial.x + [shift, 0.0, 0.0] for shift in range(4)])
    found = animate(Shift(), resampled(scene, count), recorded)
    assert found.error == pytest.approx(0.0, abs=1e-6)


def animated(error: float, travelled: float = 1.0, seconds: float = 0.01, last: float = 0.0) -> Animated:
    return Animated(error, travelled, seconds, 5, 0.0, 1.0, np.full((16, 3), last))


def test_an_energy_is_shown_by_its_variant_that_comes_nearest():
    """Over all sequences, at the end of the last one; what is not finite comes nearest to nothing."""
    found = {
        Variant("eunet", "float64", 5, 1, 22): [animated(0.1), animated(0.9, last=1.0)],
        Variant("eunet", "float64", 10, 1, 22): [animated(0.4), animated(0.2, last=2.0)],
        Variant("eunet", "float64", 20, 1, 22): [animated(float("nan")), animated(0.1, last=3.0)],
        Variant("phys", "float64", 5, 1, 22): [animated(float("nan")), animated(0.1, last=4.0)],
    }
    assert {name: x[0, 0] for name, x in nearest(found).items()} == {"eunet": 2.0, "phys": 4.0}


def test_last_frames_stand_below_the_recorded_one(tmp_path: Path):
    """Same place, same picture; gone from the recorded camera, nothing; what is not finite is not drawn."""
    still = hanging_scene()
    scene = hanging_scene(reference=np.stack([still.initial.x] * 4))
    ends = {"same": still.initial.x, "gone": still.initial.x + 50.0, "broken": np.full((16, 3), np.nan)}
    path = draw_last_frames([LastFrames(scene, ends)], tmp_path / "ends.png")
    with Image.open(path) as file:
        picture = np.asarray(file.convert("L"), float)
    rows = np.split(picture[: 4 * (len(picture) // 4), -SIZE // 2 :], 4)  # without words and time
    cloth = [float((row < 240).mean()) for row in rows]
    assert cloth[0] > 0.05
    assert cloth[1] == pytest.approx(cloth[0], abs=0.02)
    assert cloth[2:] == [0.0, 0.0]


def test_the_share_of_a_summary_is_that_of_the_means_and_its_time_the_median():
    of = [animated(0.1, 1.0, 0.01), animated(0.5, 2.0, 0.02), animated(0.0, 1.0, 1.0)]
    row = summary("silk", Variant("eunet", "float64", 100, 2, 22), of)
    assert row["error_percent"] == pytest.approx(100 * 0.6 / 4.0)
    assert (row["ms_per_frame"], row["error_mm"]) == pytest.approx((20.0, 200.0))
    assert (row["fabric"], row["energy"], row["iterations"], row["steps"]) == ("silk", "eunet", 100, 2)


def test_a_square_meshed_anew_keeps_shape_weight_and_pins():
    scene = hanging_scene(22)
    x, y, _ = scene.initial.x.T
    bent = np.stack([x, y, 0.1 * np.sin(2 * x) * y**2], axis=1)
    scene = hanging_scene(22, initial=State(bent, bent - 1.0))
    finer = resampled(scene, 43)
    at = finer.initial.x.reshape(43, 43, 3)
    np.testing.assert_allclose(at[::2, ::2].reshape(-1, 3), bent, atol=1e-12)
    np.testing.assert_allclose(at[..., 2], 0.1 * np.sin(2 * at[..., 0]) * at[..., 1] ** 2, atol=1e-6)
    np.testing.assert_allclose(finer.initial.v, finer.initial.x - 1.0, atol=1e-12)
    assert finer.mass.sum() == pytest.approx(scene.mass.sum())
    np.testing.assert_allclose(finer.initial.x[finer.pins.vertices], bent[scene.pins.vertices], atol=1e-12)
    assert finer.mesh.rest_lengths.min() == pytest.approx(scene.mesh.rest_lengths.min() / 2, rel=1e-5)
    assert resampled(scene, 22) is scene
    np.testing.assert_allclose(SquareResampling(43, 22)(finer.initial.x), bent, atol=1e-12)


def test_only_a_square_pinned_at_corners_is_meshed_anew():
    scene = hanging_scene(4, pins=Pins.fixed([1], square_grid(1.2, 4).rest_positions))
    with pytest.raises(DrapeError, match="expected a square grid that is pinned at corners"):
        resampled(scene, 7)


@pytest.mark.parametrize("values", [{"energy": ["eunet"]}, {key: ["eunet"] for key in (*Variant._fields, "masses")}])
def test_sets_of_variants_are_complete(values):
    with pytest.raises(DrapeError, match=r"variants.mine: found .*; expected energy, precision, iterations, steps"):
        HeldOut("data/cloth.h5", 1, 1, {"mine": values}, "x")


def test_variants_are_all_combinations():
    values = {"energy": ["a", "b"], "precision": ["float64"], "iterations": [5, 10]}
    values |= {"steps": [1], "resolution": [22, 43]}
    assert len(combinations("all", values)) == 8
    assert len(HeldOut("x.h5", 1, 1, {"first": values, "again": values}, "x").variants) == 8


def test_trained_laws_are_animated_beside_each_other():
    config = composed("measure=animated_laws", "trained=runs/cloth_paper/eunet", "seed=2")
    check_config(config, contents="benchmark")
    Composed(config).check(variant.energy for variant in instantiate(config.measure).variants)
    found = {energy.checkpoint for energy in config.energies.values() if "checkpoint" in energy}
    runs = "runs/cloth_paper/eunet/{}/all/seed_2/checkpoints/last.ckpt"
    assert found == {runs.format(name) for name in ("none", "no_dissipation", "no_contrastive")}


def test_the_trade_is_a_sweep_of_held_out_sequences():
    with initialize_config_dir(str(CONF.parent / "sweeps"), version_base=None):
        config = compose("trade", [f"hydra.searchpath=[file://{CONF}]"])
    check_config(config, contents="benchmark")
    measure = instantiate(config.measure)
    assert measure.name == "trade"
    Composed(config).check(variant.energy for variant in measure.variants)
    assert {v.resolution for v in measure.variants} == {8, 15, 22, 43}
    assert {v.energy for v in measure.variants} == {"eunet_baked", "eunet", "spring_hinge", "phys"}
    assert {v.steps for v in measure.variants} == {1, 2, 4}


def test_each_fabric_gets_its_own_law_and_solvers_share_nothing():
    """Silk's table is for silk; a solver in float32 leaves those in float64 as they are."""
    found = Composed(composed("measure=held_out"))
    assert found.with_fabric("denim").energies.eunet_baked.table.endswith("denim.npz")
    silk, denim = (found.law("eunet_baked", fabric) for fabric in ("silk", "denim"))
    assert float(silk.attributes[0]) != float(denim.attributes[0])
    scene = hanging_scene()
    single = found.simulator(scene, "eunet_baked", "silk", precision="float32", iterations=30, steps=2)
    double = found.simulator(scene, "eunet_baked", "silk")
    assert (single.iterations, single.steps_per_frame) == (30, 2)
    for solver, dtype in ((single, torch.float32), (double, torch.float64)):
        kinds = {b.dtype for b in solver.potential.buffers() if b.is_floating_point()}
        assert kinds == {dtype}
        assert solver.step(scene.initial, 0).outcome is Outcome.CONVERGED
    with pytest.raises(DrapeError, match=r"no 'eunet_bakd'.*eunet_baked"):
        found.check(["eunet_bakd"])


@pytest.mark.parametrize(("refinement", "counts", "rows"), [(0.5, [7, 3], 2), (1.0, [13, 5], 3), (2.0, [25, 9], 5)])
def test_a_refined_cantilever_is_clamped_over_the_same_length(refinement, counts, rows):
    config = composed("measure=resolution")
    node = refined(config.scenes.cantilever, refinement, "scenes.cantilever")
    assert (list(node.resolution), node.clamped_rows) == (counts, rows)
    config.scenes.cantilever = node
    scene = instantiate(config.scenes.cantilever)
    assert np.ptp(scene.pins.targets[0, :, 0]) == pytest.approx(2 * 4.8 / 21, rel=1e-5)
    assert scene.mass.sum() == pytest.approx(0.15 * 21.007 * 2.742857 * 0.914286, rel=1e-5)
    lowered = State.at_rest(scene.initial.x - [0.0, 0.0, 1.0] * (scene.initial.x[:, :1] > 1.37))
    assert sag(scene, lowered, [1.0, 0.5]) == pytest.approx(1.0)


def test_sag_is_that_of_the_place_asked_for():
    scene = hanging_scene(5)
    x = scene.initial.x.copy()
    x[2, 2] -= 0.25
    x[-1, 2] -= 9.0
    assert sag(scene, State.at_rest(x), [0.5, 1.0]) == pytest.approx(0.25)
    assert sag(scene, State.at_rest(x), [1.0, 0.0]) == pytest.approx(9.0)


@pytest.mark.parametrize("count", [3, 5, 9])
def test_the_same_square_is_held_around_a_pin_in_every_mesh(count):
    """1.2 m; within 0.6 m of the two upper corners is the upper half."""
    scene = held_around_pins(hanging_scene(count), 0.6)
    assert sorted(scene.pins.vertices) == list(range(count * (count // 2 + 1)))
    assert held_around_pins(scene, 0.0) is scene


def test_meshes_that_cannot_be_halved_are_named():
    with pytest.raises(DrapeError, match=r"scenes.hanging.resolution: found 22 vertices"):
        refined(OmegaConf.create({"resolution": 22}), 0.5, "scenes.hanging")
    with pytest.raises(DrapeError, match=r"expected 1.0 among them"):
        Resolution([0.5, 2.0], 0.25, 10, 1e-4, {}, {})


def test_sag_is_measured_at_rest():
    """A coarse hanging cloth settles; the row of the mesh as given has no change, another mesh has some."""
    config = composed(
        "measure=resolution", "~scenes.cantilever", "~scenes.by_points", "~energies.per_edge", "~fabrics.leather",
        "scenes.hanging.resolution=7", "measure.refinements=[1.0,0.5]",
    )  # fmt: skip
    rows = instantiate(config.measure).measure(config).rows
    assert [row["refinement"] for row in rows] == [1.0, 0.5]
    assert [row["vertices"] for row in rows] == [49, 16]
    assert all(row["at_rest"] == "yes" for row in rows)
    assert rows[0]["sag_change_percent"] == 0.0
    assert 0 < abs(rows[1]["sag_change_percent"]) < 100
    assert all(0.02 < row["sag_m"] < 0.1 and 4.58 < row["lowest_m"] < 4.7 for row in rows)


def test_medians_come_from_rounds_in_which_all_have_their_turn():
    calls = []
    found = medians({(name,): lambda name=name: calls.append(name) for name in "ab"}, 3)
    assert calls == list("ab" * 5)
    assert set(found) == {("a",), ("b",)}


def test_energies_of_the_laws_are_timed():
    config = composed("measure=energies", "scene.resolution=6", "repeats=1")
    rows = instantiate(config.measure).measure(config).rows
    expected = itertools.product(("float64", "float32"), ("eunet_baked", "eunet", "phys"))
    assert [(row["precision"], row["energy"]) for row in rows] == list(expected)
    for row in rows:
        assert row[f"{row['energy']}_takes_times"] == pytest.approx(1.0)
    assert rows[0]["eunet_takes_times"] == pytest.approx(1 / rows[1]["eunet_baked_takes_times"])


def test_rows_are_kept_as_numbers_and_shown_without_what_is_the_same(tmp_path: Path):
    rows = [{"energy": name, "precision": "float64", "error_mm": k / 3} for k, name in enumerate(("a", "b"))]
    measured = Measured("held_out", "A title", rows, "a note", {"": lambda path: draw_trade(TRADE, path)})
    paths = measured.save(tmp_path / "deep")
    assert [path.name for path in paths] == ["held_out.csv", "held_out.md", "held_out.png"]
    with open(paths[0], newline="", encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    assert float(read[1]["error_mm"]) == 1 / 3
    assert measured.table().columns == ("energy", "error mm")
    assert "precision float64; a note" in paths[1].read_text(encoding="utf-8")
    assert paths[2].read_bytes()[:4] == b"\x89PNG"


TRADE = [
    {"fabric": fabric, "energy": energy, "precision": precision, "steps": 1, "resolution": 22, "iterations": iterations,
     "ms_per_frame": 2.0 * iterations, "error_mm": 100 / iterations, "travelled_mm": 500.0}
    for fabric in ("silk", "denim", "cotton")
    for energy in ("eunet", "phys") for precision in ("float64", "float32") for iterations in (3, 10, 50)
]  # fmt: skip


def test_only_what_blender_can_do_is_compared_with_it():
    check_comparable(hanging_scene())
    body = Obstacle(np.array([[0, 1, 2]]), np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]]))
    with pytest.raises(DrapeError, match="found a body, vertices of different masses; expected a cloth of equal"):
        check_comparable(hanging_scene(obstacle=body, mass=np.linspace(0.1, 0.2, 16)))


@pytest.mark.blender
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
def test_blender_moves_the_same_cloth():
    """Its pins stay, the rest falls; after the last frame it says so instead of hanging."""
    scene = hanging_scene(6)
    cloth = TimedCloth(scene, read_preset("Silk"))
    try:
        heights = []
        for _ in range(scene.frames):
            x, seconds = cloth.step()
            heights.append(x[:, 2].mean())
            assert seconds > 0
            np.testing.assert_allclose(x[scene.pins.vertices], scene.initial.x[scene.pins.vertices], atol=1e-6)
        assert 0 > heights[0] > heights[1] > heights[2]
        with pytest.raises(DrapeError, match="no more frames"):
            cloth.step()
    finally:
        cloth.close()
