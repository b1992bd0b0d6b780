"""What is read of recordings whose frames say their own number: frames, splits, statistics, shares of processes."""

from __future__ import annotations

from dataclasses import replace

import lightning
import numpy as np
import pytest
import torch

from drape.data.blender_clock import gravity_factor, steps_run
from drape.data.datamodule import TrajectoryDataModule
from drape.data.garment_datamodule import GarmentDataModule
from drape.data.garment_frames import SampledGarmentFrames
from drape.data.hdf5 import GarmentFile
from drape.data.loader import WindowLoader, share_of
from drape.data.motion import external_energy_per_mass
from drape.data.observation import Observation
from drape.data.recorded_scene import held_out, recorded_scene
from drape.data.sequence_loader import SequenceLoader
from drape.data.windows import Window
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import ATTRIBUTES
from tests import garments
from tests.energies import make_window
from tests.trajectories import header, sequences_of, write

SCALES = dict.fromkeys(ATTRIBUTES, 1.0)
FRAMES, SPEED = 7, 0.03
"""Of each sequence; [m/frame]. Sequence s is s times as fast as the first."""


def numbered(sequence: int) -> np.ndarray:
    """A sheet that rises by (s + 1) · 3 cm a frame, stretched by 1 % more in every one.

    Its pinned vertices, 0 and 3, are accelerated to the side.
    """
    rest = square_grid(1.0, 4).rest_positions.astype(float)
    frame = np.arange(FRAMES)[:, None, None]
    x = rest * (1.0 + 0.01 * frame) + (sequence + 1) * SPEED * frame * [0, 0, 1]
    x[:, [0, 3]] += 0.01 * frame**2 * [1, 0, 0]
    return x.astype(np.float32)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Two training sequences of each of two fabrics, then one of each to test on; silk, denim, silk, ..."""
    target = tmp_path_factory.mktemp("data") / "cloth.h5"
    return write(target, header(), sequences_of([numbered(k) for k in range(6)], training=4))


def module(path, **changes) -> TrajectoryDataModule:
    return TrajectoryDataModule(str(path), ["silk", "denim"], 2, 2, SCALES, **({"seed": 0} | changes))


# Windows


def test_splits_are_kept_apart(path):
    """Training, validation and test are the sequences of their splits, also in the loaders; only one is shuffled."""
    data = module(path, validation_sequences=1)
    assert data.train_sequences.tolist() == [0, 1, 2, 3]
    assert data.test_sequences.tolist() == [4, 5]
    assert data.validation_sequences.tolist() == [4]
    speeds = {}
    for name in ("train", "val", "test"):
        windows = list(getattr(data, f"{name}_dataloader")())
        moved = torch.cat([(w.x_next - w.x)[:, 2].view(w.mesh.num_meshes, -1).mean(1) for w in windows])
        speeds[name] = (moved / SPEED).round().long().tolist()
    assert sorted(set(speeds["train"])) == [1, 2, 3, 4]
    assert set(speeds["val"]) == {5}
    assert set(speeds["test"]) == {5, 6}
    assert speeds["test"] == sorted(speeds["test"])
    assert speeds["train"] != sorted(speeds["train"])


@pytest.mark.parametrize(("number", "sequence", "start"), [(0, 0, 0), (4, 0, 4), (5, 1, 0), (9, 1, 4), (10, 2, 0)])
def test_windows_are_counted_through_the_sequences(path, number, sequence, start):
    """Seven frames are five windows; the fabric, the mass and the pins are those of the sequence."""
    window = module(path).windows(np.arange(4), np.array([number]))
    for k, x in enumerate((window.x_prev, window.x, window.x_next)):
        np.testing.assert_array_equal(x.numpy(), numbered(sequence)[start + k])
    assert window.fabric.tolist() == [sequence % 2]
    np.testing.assert_allclose(window.mass.numpy(), [0.15, 1.0][sequence % 2])
    assert window.free.logical_not().nonzero()[:, 0].tolist() == [0, 3]
    assert window.dt == pytest.approx(1 / 30)


def test_of_every_second_frame_there_are_fewer_windows(path):
    data = module(path, observation=Observation(stride=2))
    assert len(data.loader(np.array([0]), 1)) == FRAMES - 4
    assert data.windows(np.array([0]), np.array([0])).dt == pytest.approx(2 / 30)


def test_noise_is_another_one_in_every_frame_and_sequence():
    seen = [Observation(1.0, seed=s).disturbance(n, k, 2) for s, n, k in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
    assert all(not np.array_equal(a, b) for i, a in enumerate(seen) for b in seen[:i])


def two_vertices() -> Window:
    """A face whose first vertex, of 2 kg, moves up by 1 m and then by 3 m in frames of half a second; g = -10 m/s²."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 2)])
    rest, up = mesh.rest_positions, torch.zeros(4, 3, dtype=torch.float64)
    up[0, 2] = 1.0
    given = {"x_prev": rest, "x": rest + up, "x_next": rest + 4.0 * up, "dt": 0.5}
    gravity = torch.tensor([0.0, 0.0, -10.0], dtype=torch.float64)
    return replace(make_window(mesh), **given, mass=torch.full((4,), 2.0).double(), gravity=gravity)


def test_the_balance_is_what_kinetic_and_potential_energy_lose():
    """From 2 to 6 m/s: ½ 2 (36 - 4) = 32 J more; up by 3 m: 60 J more. ΔV = -92 J."""
    window = two_vertices()
    assert window.v[0].tolist() == [0.0, 0.0, 2.0]
    assert window.v_next[0].tolist() == [0.0, 0.0, 6.0]
    assert window.balance.item() == pytest.approx(-92.0)


def test_the_inertial_force_is_mass_times_acceleration_less_weight():
    """2 kg (8 m/s² + 10 m/s²); what does not move has its weight alone."""
    force = two_vertices().inertial_force
    assert force[0].tolist() == pytest.approx([0.0, 0.0, 36.0])
    assert force[1].tolist() == pytest.approx([0.0, 0.0, 20.0])


def test_statistics_are_means_over_windows_in_si(path):
    """Of batches of unlike size: each window counts once."""
    data = module(path)
    found, windows = data.statistics(), [data.windows(data.train_sequences, np.array([k])) for k in range(20)]
    geometry = [EdgeGeometry(w.x_next, w.mesh) for w in windows]
    before = [EdgeGeometry(w.x, w.mesh) for w in windows]
    stretch = [(g.length - w.mesh.rest_lengths).numpy() for g, w in zip(geometry, windows, strict=True)]
    moved = [(g.midpoint - b.midpoint).square().sum(-1).numpy() for g, b in zip(geometry, before, strict=True)]
    force = np.mean([w.inertial_force[w.free].norm(dim=-1).mean() for w in windows])
    edges, area = windows[0].mesh.num_edges, np.mean([g.area.mean() for g in geometry])
    energy = np.sqrt(np.mean([w.balance.item() ** 2 for w in windows]) / edges)
    assert found["stretch"] == pytest.approx(np.sqrt(np.mean(np.square(stretch))), rel=1e-6)
    assert found["speed"] == pytest.approx(30.0 * np.sqrt(np.mean(moved)), rel=1e-6)
    assert found["area"] == pytest.approx(area, rel=1e-6)
    assert found["edge_energy"] == pytest.approx(energy, rel=1e-6)
    assert found["edge_energy_density"] == pytest.approx(energy / area, rel=1e-6)
    assert found["typical_work"] == pytest.approx(force * found["stretch_typical"], rel=1e-6)
    assert found["stretch_typical"] == pytest.approx(np.mean([np.median(np.abs(s)) for s in stretch]), rel=0.3)


def test_hinges_are_those_of_inner_edges(tmp_path):
    """A crumpled sheet; its boundary edges have no angle and are not counted."""
    rest = square_grid(1.0, 4).rest_positions.astype(float)
    x = np.repeat((rest + 0.1 * np.random.default_rng(0).normal(size=rest.shape))[None], 3, axis=0).astype(np.float32)
    data = module(write(tmp_path / "roof.h5", header(), sequences_of([x] * 4, training=2)))
    window = data.windows(data.train_sequences, np.array([0]))
    inner = EdgeGeometry(window.x, window.mesh).hinge_change[~window.mesh.boundary].abs()
    assert data.statistics()["hinge_typical"] == pytest.approx(float(inner.median()))


def test_a_held_out_scene_is_of_the_test_split_from_frame_1_on(path):
    """Sequence 5 is the denim to test on; it rises by 6 · 3 cm a frame."""
    scene = held_out(str(path), "denim", 0, 3)
    assert scene.initial.x == pytest.approx(numbered(5)[1])
    assert scene.initial.v == pytest.approx(30.0 * (numbered(5)[1] - numbered(5)[0]), abs=1e-5)
    assert scene.reference == pytest.approx(numbered(5)[1:5])


# Processes


class Third(lightning.Trainer):
    """The last but one of five processes, the second of its machine."""

    global_rank, local_rank, world_size = 3, 1, 5

    def __init__(self):
        pass


def test_processes_have_shares_by_their_rank_among_all():
    assert share_of(Third()) == {"rank": 3, "world_size": 5}


def test_batches_and_epochs_of_a_share():
    """Three processes: of batches 0, 1, 2 each one; another order in the next epoch."""
    loaders = [WindowLoader(list, 9, 1, seed=4, rank=rank, world_size=3) for rank in range(3)]
    epochs = [[list(each) for each in loaders] for _ in range(2)]
    for epoch in epochs:
        assert sorted(x for share in epoch for batch in share for x in batch) == list(range(9))
    assert epochs[0] != epochs[1]


# Garments


@pytest.fixture(scope="module")
def dressed(tmp_path_factory) -> GarmentFile:
    return GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=8))


def rollouts(file: GarmentFile, **changes) -> GarmentDataModule:
    settings = {"fabrics": ["silk", "denim"], "start": "recorded", "length": 2, "batch_size": 2, "seed": 0}
    return GarmentDataModule(str(file.path), **(settings | changes))


def test_garments_are_watched_that_are_not_trained_on(dressed):
    data = rollouts(dressed, validation_sequences=2)
    assert data.train_sequences == ["00000"]
    assert data.validation_sequences == ["00001", "00003"]
    assert [each.sequence.name for each in data.val_dataloader()] == ["00001", "00003"]


def test_there_are_as_many_rollouts_as_fit(dressed):
    """Of eight frames two to start from and two steps: five, and the last one ends with the last frame."""
    data, x = rollouts(dressed), dressed.sequence("00000").positions
    assert int(data._first[-1]) == 5
    last = data.rollout(np.array([4]))
    assert last.length == 2
    np.testing.assert_allclose(last.x[-1].numpy(), x[-1] - x[5].mean(axis=0), atol=1e-12)
    assert last.names == ("00000 frame 5",)


def test_pinned_vertices_are_led_in_every_garment_of_a_batch(tmp_path):
    data = rollouts(GarmentFile(garments.write(tmp_path / "skirts.h5", garment="skirt")))
    led = (~data.rollout(np.array([0, 1])).free).nonzero()[:, 0]
    assert led.tolist() == [*garments.TOP, *(len(garments.tube()[0]) + garments.TOP)]


def test_carried_rollouts_are_where_the_body_is(dressed):
    data, whole = rollouts(dressed, start="carried"), garments.carried(garments.tube()[0], 8)
    found = data.rollout(np.array([3]))
    np.testing.assert_allclose(found.x.numpy(), whole[3:7] - whole[4].mean(axis=0), atol=1e-6)


def test_statistics_of_garments_are_per_second(dressed):
    """Speeds are displacements · 30, accelerations second differences · 900."""
    data, x = rollouts(dressed), dressed.sequence("00000").positions
    starts = np.arange(5)
    speed = np.sqrt(np.mean([((x[k + 1] - x[k]) ** 2).sum(-1).mean() for k in starts]))
    bend = np.sqrt(np.mean([((x[k + 2] - 2 * x[k + 1] + x[k]) ** 2).sum(-1).mean() for k in starts]))
    assert data.statistics()["vertex_speed"] == pytest.approx(30.0 * speed)
    assert data.statistics()["vertex_acceleration"] == pytest.approx(900.0 * bend)


def test_frames_of_garments_have_the_bodies_of_t_and_of_t_plus_1(dressed):
    """Two skirts and a dress of the test split; pinned are the tops of the skirts, each in its own place."""
    (batch,) = SampledGarmentFrames(dressed, "test", 18, 18, SCALES, seed=0)
    count = len(garments.tube()[0])
    assert batch.window.mesh.num_meshes == 18, "three sequences of six windows"
    whole = {name: dressed.sequence(name) for name in dressed.split("test")}
    for k in range(18):
        own = slice(k * count, (k + 1) * count)
        x = batch.window.x[own].numpy()
        names = [(n, t) for n, s in whole.items() for t in range(1, 7) if np.array_equal(s.positions[t], x)]
        name, t = names[0]
        np.testing.assert_array_equal(batch.window.x_next[own].numpy(), whole[name].positions[t + 1])
        faces = batch.body_faces[batch.mesh_of_face == k].numpy()
        for body, at in ((batch.body, t), (batch.body_next, t + 1)):
            corners = whole[name].body_positions[at][whole[name].body_faces]
            np.testing.assert_allclose(body.numpy()[faces], corners, atol=1e-6)
    pinned = [(~batch.window.free[k * count : (k + 1) * count]).sum().item() for k in range(18)]
    assert set(pinned) == {0, garments.AROUND}


def test_a_recorded_scene_has_all_of_it_at_the_same_time(dressed):
    """The skirt: frame k of scene, body, pins and reference is the recorded frame k + 1."""
    sequence = dressed.sequence("00002")
    scene = recorded_scene(sequence, 4)
    np.testing.assert_allclose(scene.initial.v, 30.0 * (sequence.positions[1] - sequence.positions[0]))
    for k in range(5):
        np.testing.assert_array_equal(scene.reference[k], sequence.positions[k + 1])
        np.testing.assert_array_equal(scene.pins.at(k), sequence.positions[k + 1, garments.TOP])
        np.testing.assert_array_equal(scene.obstacle.at(k), sequence.body_positions[k + 1])


def test_sequences_are_shared(dressed):
    """Alone all; of five processes the number 3 has the fourth sequence of five."""
    sequences = [dressed.sequence(name) for name in ("00000", "00001", "00002", "00003", "00001")]
    assert [each.sequence for each in SequenceLoader(sequences)] == sequences
    assert [each.sequence for each in SequenceLoader(sequences, Third())] == sequences[3:4]


# Motion


def test_energy_per_mass_is_that_after_the_step_and_heavy_vertices_count_more():
    """Up by 1 m in ½ s at g = -10: ½ 2² + 10 = 12 J/kg of one vertex, 0 of the other, which weighs three times."""
    x = np.zeros((2, 2, 3))
    x[1, 0, 2] = 1.0
    gravity = np.array([0.0, 0.0, -10.0])
    assert external_energy_per_mass(x, 0.5, gravity)[0] == pytest.approx(6.0)
    assert external_energy_per_mass(x, 0.5, gravity, np.array([1.0, 3.0]))[0] == pytest.approx(3.0)


def test_blenders_clock_runs_fast_at_12():
    """13 steps instead of 12: gravity times (13/12)²; 10 are 10."""
    assert [steps_run(q) for q in (8, 10, 12)] == [8, 10, 13], "eighths add up to 1 exactly"
    assert gravity_factor(12) == pytest.approx((13 / 12) ** 2)
    assert gravity_factor(10) == 1.0
