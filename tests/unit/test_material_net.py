"""EST on cloths of known materials: what the forces of their frames say, what the network finds, and its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.data.garment_frames import GarmentFrames, SampledGarmentFrames
from drape.data.hdf5 import GarmentFile
from drape.data.stored_part import Header, StoredBody, StoredGarment, StoredSequence
from drape.energy.force_balance import (
    RINGS,
    ForceBalance,
    best_ratios,
    feels_contact,
    force_balance,
    frames_step,
    material_ratios,
    surrounded,
)
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.phys_material import PhysMaterial
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.nets.material_net import MaterialNet
from drape.scene.mass import vertex_masses
from drape.scene.material import ATTRIBUTES, Material, attribute_vector
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.solver.implicit import ImplicitSolver
from drape.training.material_data import material_loader
from drape.training.material_training import fit
from tests import garments

KNOWN = {"silk": PhysMaterial(0.15, 30000.0, 20000.0, 8e-4), "denim": PhysMaterial(0.4, 50000.0, 70000.0, 3e-4)}
FRAMES = 16
SIDE = 6
EDGE = np.arange(SIDE)
SCALES = dict.fromkeys(ATTRIBUTES, 1.0) | {
    "tension_stiffness": 40.0,
    "bending_stiffness": 10.0,
    "tension_damping": 25.0,
}
GRAVITY = (0.0, 0.0, -9.81)


def fabric(name: str) -> Material:
    return Material.from_settings(name, garments.settings(name))


def flapping(material: PhysMaterial) -> np.ndarray:
    """Frames of a cloth of a known material that is shaken at one edge; implicit Euler, solved exactly."""
    mesh = square_grid(0.5, SIDE)
    rest = mesh.rest_positions.astype(np.float64)
    time = np.arange(FRAMES)[:, None]
    shake = [np.sin(0.9 * time + 0 * EDGE), np.sin(0.5 * time + EDGE / 2), np.cos(0.7 * time + EDGE)]
    pins = Pins(EDGE, rest[EDGE] + 0.03 * np.stack(shake, -1))
    mass = vertex_masses(mesh, {"areal_density": material.areal_density})
    scene = Scene(
        "flag", mesh, State.at_rest(rest), fabric("silk"), mass, np.array(GRAVITY), dt=1 / 30, frames=FRAMES - 1,
        pins=pins,
    )  # fmt: skip
    potential = IncrementalPotential.for_scene(scene, material.terms())
    solver = ImplicitSolver(potential, scene, torch.zeros(5, dtype=torch.float64), tolerance=1e-10, iterations=500)
    state, frames = scene.initial, [scene.initial.x]
    for frame in range(FRAMES - 1):
        state = solver.step(state, frame).state
        frames.append(state.x)
    return np.stack(frames)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> GarmentFile:
    """A flag of each known material; the body is far away from the first frame to the last."""
    path = tmp_path_factory.mktemp("flags") / "flags.h5"
    mesh = square_grid(0.5, SIDE)
    points, faces = garments.tube()
    points = points + [0.0, 0.0, 3.0]
    body = np.tile(points, (FRAMES, 1, 1))
    sequences = [
        StoredSequence(
            str(number), "ball", "shake", "train", garment="flag", fabric=name, mass_per_vertex=0.15, friction=0.0,
            positions=flapping(material), body_positions=body,
        )
        for number, (name, material) in enumerate(KNOWN.items())
    ]  # fmt: skip
    flag = StoredGarment("flag", "ball", mesh.rest_positions.astype(np.float64), mesh.faces, pinned=EDGE)
    header = Header("test", 30.0, GRAVITY, {name: garments.settings(name) for name in KNOWN}, "{}")
    garments.write_groups(path, header, {"ball": StoredBody(points, faces)}, {"flag": flag}, sequences)
    return GarmentFile(path)


def sampled(file: GarmentFile, batch_size: int, count: int = 1000, seed: int = 0) -> SampledGarmentFrames:
    return SampledGarmentFrames(file, "train", count, batch_size, SCALES, seed)


def balance_of(file: GarmentFile, name: str) -> ForceBalance:
    """That of all frames of one fabric, as of one garment."""
    parts = []
    for frames in sampled(file, 8):
        columns, owner = force_balance(frames)
        parts.append(columns[:, frames.window.fabric[owner] == file.fabrics.index(name)])
    columns = torch.cat(parts, 1)
    return ForceBalance(columns, torch.zeros(columns.shape[1], dtype=torch.long))


def ratios_of(material: PhysMaterial) -> torch.Tensor:
    return material_ratios(torch.tensor([material], dtype=torch.float64))


# Frames


def test_frames_of_a_batch_are_those_of_the_file(file):
    (frames,) = sampled(file, 1000)
    assert isinstance(frames, GarmentFrames)
    assert frames.window.mesh.num_meshes == 2 * (FRAMES - 2)
    silk = file.sequence("0")
    found = frames.window.x.reshape(-1, SIDE * SIDE, 3).numpy()[(frames.window.fabric == 0).numpy()]
    starts = [int(np.abs(silk.positions - x).sum((1, 2)).argmin()) for x in found]
    assert sorted(starts) == list(range(1, FRAMES - 1))
    later = frames.window.x_next.reshape(-1, SIDE * SIDE, 3).numpy()[(frames.window.fabric == 0).numpy()]
    np.testing.assert_array_equal(later, silk.positions[np.array(starts) + 1])
    assert frames.window.free.sum() == 2 * (FRAMES - 2) * SIDE * (SIDE - 1)
    assert not frames.window.free.reshape(-1, SIDE * SIDE)[:, EDGE].any()


def test_bodies_are_those_of_t_and_t_plus_1(tmp_path):
    """The ball moves; each garment of a batch has its own, of its own frames."""
    path = garments.write(tmp_path / "tubes.h5")
    recorded = GarmentFile(path)
    for frames in SampledGarmentFrames(recorded, "test", 100, 5, SCALES, seed=1):
        count = len(recorded.sequence("00001").body_rest_positions)
        assert frames.mesh_of_face.unique().tolist() == list(range(frames.window.mesh.num_meshes))
        for number in range(frames.window.mesh.num_meshes):
            faces = frames.body_faces[frames.mesh_of_face == number]
            assert faces.min() == number * count
            assert faces.max() == (number + 1) * count - 1
            x = frames.window.x[frames.window.mesh.mesh_of_vertex == number].numpy()
            start = int(np.abs(recorded.sequence("00001").positions - x).sum((1, 2)).argmin())
            part = slice(number * count, (number + 1) * count)
            positions = recorded.sequence("00001").body_positions
            np.testing.assert_allclose(frames.body[part].numpy(), positions[start], atol=1e-6)
            np.testing.assert_allclose(frames.body_next[part].numpy(), positions[start + 1], atol=1e-6)


def test_the_draw_depends_on_the_seed_only(file):
    first, again, other = ([f.window.x for f in sampled(file, 3, 6, seed)] for seed in (0, 0, 1))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first[0], other[0])
    assert len(sampled(file, 4, 6)) == len(list(sampled(file, 4, 6))) == 2


def test_a_split_without_recorded_garments_is_refused(file):
    with pytest.raises(DrapeError, match="split test: found no recorded garment of three frames"):
        SampledGarmentFrames(file, "test", 10, 4, SCALES, 0)


# Balance of forces


@pytest.mark.parametrize("name", KNOWN)
def test_forces_balance_at_the_known_material_and_at_no_other(file, name):
    balance = balance_of(file, name)
    known = balance.residuals(ratios_of(KNOWN[name])).mean()
    assert known < 1e-3
    for field, value in KNOWN[name]._asdict().items():
        other = KNOWN[name]._replace(**{field: 1.3 * value})
        assert balance.residuals(ratios_of(other)).mean() > 2.0 * known, field


def test_only_ratios_to_the_density_matter(file):
    silk = KNOWN["silk"]
    heavy = PhysMaterial(*(1000.0 * number for number in silk))
    balance = balance_of(file, "silk")
    torch.testing.assert_close(balance.residuals(ratios_of(heavy)), balance.residuals(ratios_of(silk)))


@pytest.mark.parametrize("name", KNOWN)
def test_the_best_ratios_are_the_known_ones(file, name):
    found = best_ratios(balance_of(file, name).columns)
    torch.testing.assert_close(found[None], ratios_of(KNOWN[name]), rtol=0.01, atol=0.0)


def test_a_few_violent_vertices_do_not_outweigh_the_others(file):
    columns = balance_of(file, "silk").columns.clone()
    columns[0, ::10] += 30.0 * torch.randn_like(columns[0, ::10])
    torch.testing.assert_close(best_ratios(columns)[None], ratios_of(KNOWN["silk"]), rtol=0.05, atol=0.0)


def test_no_stiffness_is_negative(file):
    """With all accelerations reversed the best cloth would push where it pulls; then none is best."""
    columns = balance_of(file, "silk").columns.clone()
    columns[0] *= -1.0
    assert (best_ratios(columns) >= 0.0).all()
    assert best_ratios(columns)[1:3].tolist() == [0.0, 0.0]


def test_each_garment_of_a_batch_has_the_balance_that_it_has_alone(file):
    """Whatever its mass in the file."""
    (frames,) = sampled(file, 3, 3)
    together = force_balance(replace(frames, window=replace(frames.window, mass=7.0 * frames.window.mass)))
    for number, one in enumerate(sampled(file, 1, 3)):
        alone = force_balance(one)
        assert alone.columns.shape == (4, SIDE * (SIDE - 1), 3)
        part = together.columns[:, together.mesh_of_vertex == number]
        torch.testing.assert_close(part, alone.columns, rtol=1e-8, atol=1e-8 * float(alone.columns.abs().max()))
    pair = ratios_of(KNOWN["silk"]).repeat(3, 1)
    pair[1] = ratios_of(KNOWN["denim"])
    found = together.residuals(pair)[together.mesh_of_vertex == 1]
    second = list(sampled(file, 1, 3))[1]
    torch.testing.assert_close(found, force_balance(second).residuals(pair[1:2]), rtol=1e-6, atol=1e-9)


def test_free_fall_has_no_residual(file):
    (frames,) = sampled(file, 1, 1)
    window = frames.window
    rest = window.mesh.rest_positions
    fallen = [rest + 0.5 * window.gravity * (k * window.dt) ** 2 for k in range(3)]
    falling = replace(frames, window=replace(window, x_prev=fallen[0], x=fallen[1], x_next=fallen[2]))
    assert force_balance(falling).residuals(ratios_of(KNOWN["silk"])).max() < 1e-5


@pytest.mark.parametrize("near_at", [0, 1], ids=["t", "t + 1"])
def test_vertices_near_the_body_do_not_count(tmp_path, near_at):
    """A ball that comes closer than 2 cm to one side of the tubes, at one of the two times; facets hide 2 mm."""
    recorded = GarmentFile(garments.write(tmp_path / "tubes.h5"))
    (frames,) = SampledGarmentFrames(recorded, "train", 2, 2, SCALES, 0)
    ball = torch.from_numpy(recorded.sequence("00000").body_rest_positions).repeat(2, 1)
    x = (frames.window.x, frames.window.x_next)[near_at]
    centres = x.reshape(2, -1, 3).mean(1) + torch.tensor([0.01, 0.0, 0.0])
    ball = ball + centres.repeat_interleave(len(ball) // 2, 0)
    places = [ball + (0.0 if number == near_at else 5.0) for number in (0, 1)]
    frames = replace(frames, body=places[0], body_next=places[1])
    step = frames_step(frames)
    touched = feels_contact(frames.window.x_next, step)
    gap = (x - centres[step.mesh.mesh_of_vertex]).norm(dim=-1) - garments.RADIUS
    assert gap[touched].max() < 0.02 + 1e-6
    assert gap[~touched].min() > 0.02 - 0.002
    for number in (0, 1):
        assert 0 < touched[step.mesh.mesh_of_vertex == number].sum() < len(touched) / 4
    kept = step.free & ~surrounded(touched, step.mesh)
    assert 0 < kept.sum() < (~touched).sum()
    assert torch.equal(force_balance(frames).mesh_of_vertex, step.mesh.mesh_of_vertex[kept])


def test_what_surrounds_a_vertex():
    """On a grid with one diagonal per quad, from a corner on: no vertex nearer than four edges is missed."""
    mesh = MeshBatch.from_meshes([square_grid(1.0, 9)])
    chosen = torch.zeros(81, dtype=torch.bool)
    chosen[40] = True
    around = surrounded(chosen, mesh)
    within = torch.unique(mesh.pairs_within(RINGS - 1)[1][mesh.pairs_within(RINGS - 1)[0] == 40])
    assert sorted([40, *within.tolist()]) == around.nonzero()[:, 0].tolist()
    assert not surrounded(torch.zeros(81, dtype=torch.bool), mesh).any()


def test_vertices_that_meet_do_not_count(file):
    """The flag folded onto itself: the two edges meet, what was close at rest does not count as met."""
    (frames,) = sampled(file, 1, 1)
    rest = frames.window.mesh.rest_positions
    folded = torch.stack([rest[:, 0].abs(), rest[:, 1], 0.03 * (rest[:, 0] > 0)], -1)
    touched = feels_contact(folded, replace(frames_step(frames), x=rest))
    assert not touched.any()
    folded[:, 2] *= 0.5
    touched = feels_contact(folded, replace(frames_step(frames), x=rest))
    assert touched.all()


def test_frames_without_gravity_are_refused(file):
    (frames,) = sampled(file, 1, 1)
    with pytest.raises(DrapeError, match="have no gravity"):
        force_balance(replace(frames, window=replace(frames.window, gravity=torch.zeros(3, dtype=torch.float64))))


# Network


@pytest.fixture(scope="module")
def net(file) -> MaterialNet:
    return fit(material_loader(sampled(file, 8), batch_size=4, seed=0), epochs=150, learning_rate=1e-2, decay=0.97)


@pytest.mark.parametrize("name", KNOWN)
def test_the_network_comes_close_to_the_best_ratios(file, name, net):
    balance = balance_of(file, name)
    vector = torch.tensor([attribute_vector(fabric(name).attributes, SCALES)], dtype=torch.float64)
    with torch.no_grad():
        found = ratios_of(PhysMaterial.at(net(vector)[0]))
    nothing = torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    best, without = (balance.residuals(r).mean() for r in (best_ratios(balance.columns)[None], nothing))
    assert balance.residuals(found).mean() < best + 0.05 * without
    torch.testing.assert_close(found[0, 1], ratios_of(KNOWN[name])[0, 1], rtol=0.1, atol=0.0)


def test_the_same_seed_trains_the_same_network(file):
    nets = [fit(material_loader(sampled(file, 8), 4, seed=3), epochs=1, seed=2) for _ in range(2)]
    for one, other in zip(nets[0].parameters(), nets[1].parameters(), strict=True):
        assert torch.equal(one, other)


def test_every_estimate_is_within_hoods_ranges():
    net = MaterialNet()
    positions = net(1e3 * torch.randn(50, 5, dtype=torch.float64))
    assert (positions >= 0.0).all()
    assert (positions <= 1.0).all()
    assert positions.std() > 0.1


def test_garments_that_hug_the_body_teach_nothing(file):
    (frames,) = sampled(file, 1, 1)
    pinned = replace(frames, window=replace(frames.window, free=torch.zeros_like(frames.window.free)))
    with pytest.raises(DrapeError, match="found no vertex that is free and away from contact"):
        material_loader([pinned], 4, 0)
