"""Recordings of anyone's cloth: read as they are, checked against gravity, bad ones refused with a sentence."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from drape.data.datamodule import TrajectoryDataModule
from drape.data.hdf5 import GarmentFile
from drape.data.recorded.conversion import convert_recorded, split_of_sequences
from drape.data.recorded.shown_gravity import shown_gravity
from drape.data.recorded_scene import held_out
from drape.data.trajectories import open_trajectories
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.own_fabric import own_fabric
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.report.contact_sheet import draw_contact_sheet
from drape.report.dataset_card import dataset_card
from drape.report.recorded import shown_motion
from drape.scene.mass import vertex_areas
from drape.scene.material import ATTRIBUTES
from tests.recordings import DENSITY, STIFFNESS, as_version_1, patch, swinging, write_meshes, write_npz

GRID = square_grid(0.4, 4)
SETTINGS = {
    "name": "own",
    "source": "recorded",
    "fabric": "own",
    "fps": None,
    "object": None,
    "scale": None,
    "up_axis": None,
    "gravity": 9.81,
    "mass": {"areal_density": DENSITY, "per_vertex": None},
    "rest": None,
    "rest_object": None,
    "pins": "still",
    "test": 0.25,
    "attributes": None,
}
SCALES = dict.fromkeys(ATTRIBUTES, 1.0)


@cache
def motion(kind: str, pinned: tuple[int, ...], seed: int) -> np.ndarray:
    return swinging(GRID if kind == "grid" else patch(), list(pinned), seed=seed)


SEQUENCES = [("grid", (12, 15)), ("patch", (20,)), ("grid", (12, 15)), ("patch", ()), ("grid", (12,)), ("patch", (20,))]


def mesh_of(kind: str) -> ClothMesh:
    return GRID if kind == "grid" else patch()


def recorded(root: Path, **changes: object) -> GarmentFile:
    """Six sequences of two pieces of cloth, pinned in several ways."""
    for number, (kind, pinned) in enumerate(SEQUENCES):
        write_npz(root / f"{kind}_{number}.npz", mesh_of(kind), motion(kind, pinned, number))
    return convert(root, **changes)


def convert(root: Path, **changes: object) -> GarmentFile:
    return convert_recorded(SETTINGS | {"root": str(root), "path": str(root.parent / "own.h5")} | changes)[0]


def two(root: Path, write: Callable[[Path, int], object] | None = None, **changes: object) -> GarmentFile:
    """Two sequences of the grid; ``write`` makes each in its own way."""
    for number in range(2):
        if write is None:
            write_npz(root / f"{number}.npz", GRID, motion("grid", (12, 15), number))
        else:
            write(root / str(number), number)
    return convert(root, **changes)


def names_of(file: GarmentFile) -> list[str]:
    return [sequence.motion for sequence in file.sequences]


def test_sequences_of_several_meshes_are_read_back(tmp_path: Path) -> None:
    file = recorded(tmp_path / "root")
    assert names_of(file) == [f"grid_{n}.npz" for n in (0, 2, 4)] + [f"patch_{n}.npz" for n in (1, 3, 5)]
    for sequence in file.sequences:
        kind, number = sequence.motion.removesuffix(".npz").split("_")
        pinned = SEQUENCES[int(number)][1]
        np.testing.assert_allclose(sequence.positions, motion(kind, pinned, int(number)), atol=1e-7)
        assert sequence.pinned.tolist() == sorted(pinned)
        np.testing.assert_array_equal(sequence.mesh.faces, mesh_of(kind).faces)
        assert sequence.mass.sum() == pytest.approx(DENSITY * vertex_areas(mesh_of(kind)).sum())
        assert sequence.mass.std() > 0.0
    assert len({id(sequence.mesh) for sequence in file.sequences}) == 2
    assert len({sequence.garment for sequence in file.sequences}) == 4, "two are pinned in two ways each"
    assert sorted([*file.split("train"), *file.split("test")]) == list(file.names)
    assert file.fabrics == ("own",)
    assert own_fabric("own", str(file.path)).mass_per_vertex == pytest.approx(
        np.mean([file.sequence(name).mass.mean() for name in file.split("train")])
    )


def test_a_file_of_version_1_is_read_as_it_was(tmp_path: Path) -> None:
    """What was a piece is a garment; nothing else is another."""
    file = recorded(tmp_path / "root")
    old = as_version_1(file, tmp_path / "old.h5")
    assert old.attribute("source") == "recorded"
    assert (old.fabrics, old.materials, old.names) == (file.fabrics, file.materials, file.names)
    assert (old.split("train"), old.split("test")) == (file.split("train"), file.split("test"))
    for one, other in zip(old.sequences, file.sequences, strict=True):
        assert (one.motion, one.fabric, one.mass_per_vertex) == (other.motion, other.fabric, other.mass_per_vertex)
        for name in ("positions", "pinned", "mass"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        np.testing.assert_array_equal(one.mesh.rest_positions, other.mesh.rest_positions)
    assert dataset_card(old).split("\n")[1:] == dataset_card(file).split("\n")[1:]


def test_the_motion_shows_gravity_and_the_law_that_made_it(tmp_path: Path) -> None:
    """Springs of 40 N/m: from cloth that hangs by two corners, by one, or falls; on a grid and on a patch."""
    file = recorded(tmp_path / "root")
    np.testing.assert_allclose(shown_gravity(file), [0, 0, -9.81], atol=0.1)
    data = TrajectoryDataModule(str(file.path), ["own"], 2, 7, SCALES, seed=None)
    law = SpringHingeLaw.fit(data.windows_apart(200, 7, ()), 1)
    assert law.stiffness[0, 0] == pytest.approx(STIFFNESS, rel=0.1)
    window = data.windows(data.train_sequences, np.arange(3, 60, 10))
    left = law.force_residual(window)[window.free].norm(dim=-1).mean()
    assert left < 0.15 * window.inertial_force[window.free].norm(dim=-1).mean()
    assert "springs" in shown_motion(file)


def test_windows_of_several_meshes_are_those_of_each(tmp_path: Path) -> None:
    file = recorded(tmp_path / "root")
    data = TrajectoryDataModule(str(file.path), ["own"], 2, 7, SCALES, seed=None)
    sequences = data.train_sequences
    count = sum(file.sequences[s].num_frames - 2 for s in sequences)
    indices = np.array([0, 5, 25, 50, count - 1])
    together, first = data.windows(sequences, indices), 0
    for index in indices:
        alone = data.windows(sequences, np.array([index]))
        part = slice(first, first + len(alone.x))
        for name in ("x_prev", "x", "x_next", "mass", "free"):
            torch.testing.assert_close(getattr(together, name)[part], getattr(alone, name), rtol=0, atol=0)
        first += len(alone.x)
    assert first == len(together.x)
    last = data.windows(sequences, indices[-1:])
    np.testing.assert_array_equal(last.x_next, file.sequences[sequences[-1]].positions[-1])
    assert all(np.isfinite(value) and value > 0 for value in data.statistics().values())


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_folders_of_meshes_in_centimetres_with_y_up(tmp_path: Path, kind: str) -> None:
    def write(place: Path, number: int) -> None:
        x = 100.0 * motion("grid", (12, 15), number)
        write_meshes(place, GRID, np.stack([x[..., 0], x[..., 2], -x[..., 1]], -1), kind)

    rest = 100.0 * GRID.rest_positions
    write_meshes(tmp_path / "rest", GRID, np.stack([rest[:, 0], rest[:, 2], -rest[:, 1]], -1)[None], kind)
    place = str(tmp_path / "rest" / f"frame_0.{kind}")
    file = two(tmp_path / "root", write, fps=60.0, scale=0.01, up_axis="y", rest=place)
    for sequence in range(2):
        found = file.sequences[sequence]
        np.testing.assert_allclose(found.positions, motion("grid", (12, 15), sequence), atol=1e-6)
        assert found.pinned.tolist() == [12, 15]
    np.testing.assert_allclose(file.sequences[0].mesh.rest_positions, GRID.rest_positions, atol=1e-6)
    np.testing.assert_allclose(shown_gravity(file), [0, 0, -9.81], atol=0.8)


def test_masses_and_a_motion_may_lie_in_hdf5(tmp_path: Path) -> None:
    mass = np.linspace(0.001, 0.002, 16)

    def write(place: Path, number: int) -> None:
        place.parent.mkdir(exist_ok=True)
        with h5py.File(place.with_suffix(".h5"), "w") as file:
            file.attrs["fps"] = 60.0
            file.update({"faces": GRID.faces, "positions": motion("grid", (12, 15), number), "mass": mass})
            file["rest_positions"] = GRID.rest_positions

    file = two(tmp_path / "root", write, mass={"areal_density": None, "per_vertex": None})
    np.testing.assert_array_equal(file.sequences[1].mass, mass)


def test_a_held_out_sequence_is_a_scene_with_its_own_mesh_and_pins(tmp_path: Path) -> None:
    file = recorded(tmp_path / "root", test=0.5)
    pins = []
    for number, name in enumerate(file.split("test")):
        scene = held_out(str(file.path), "own", number, 10)
        np.testing.assert_array_equal(scene.reference, file.sequence(name).positions[1:12])
        np.testing.assert_array_equal(scene.mass, file.sequence(name).mass)
        pins.append([] if scene.pins is None else scene.pins.vertices.tolist())
    assert pins == [file.sequence(name).pinned.tolist() for name in file.split("test")]
    with pytest.raises(DrapeError, match=r"found 23; expected 1\.\.22, as 24 are recorded"):
        held_out(str(file.path), "own", 0, 23)


def test_card_and_contact_sheet(tmp_path: Path) -> None:
    file = recorded(tmp_path / "root")
    card = dataset_card(file)
    assert "cloth of 0.57 m from corner to corner and 0.2 kg/m2: 16 vertices, 18 faces" in card
    assert "pinned: 1, 2" in card
    assert "pinned: 0, 1" in card
    assert draw_contact_sheet(file, tmp_path / "sheet.png").stat().st_size > 10_000


def test_fabrics_by_pattern_with_what_is_known_of_them(tmp_path: Path) -> None:
    file = recorded(
        tmp_path / "root",
        fabric={"cotton": "grid_*", "denim": "patch_*"},
        mass={"areal_density": {"cotton": 0.2, "denim": 0.4}, "per_vertex": None},
        attributes={"denim": {"bending_stiffness": 3.0}},
    )
    assert file.fabrics == ("cotton", "denim")
    assert [(each.fabric, each.motion[0]) for each in file.sequences] == [("cotton", "g")] * 3 + [("denim", "p")] * 3
    assert file.materials["denim"]["bending_stiffness"] == 3.0
    assert file.materials["cotton"]["bending_stiffness"] == 0.0


def test_the_same_command_reads_nothing_and_another_recording_is_refused(tmp_path: Path) -> None:
    file = two(tmp_path / "root")
    written = file.path.stat().st_mtime_ns
    assert convert(tmp_path / "root").path.stat().st_mtime_ns == written
    write_npz(tmp_path / "root" / "2.npz", GRID, motion("grid", (12, 15), 2))
    with pytest.raises(DrapeError, match=r"own.h5: was made with another configuration \(bytes.2.npz: nothing there"):
        convert(tmp_path / "root")


def test_the_split_is_by_sequence_and_has_every_fabric(tmp_path: Path) -> None:
    names = [f"{k}.npz" for k in range(10)]
    fabrics = {name: "a" if int(name[0]) < 5 else "b" for name in names}
    splits = split_of_sequences(names, fabrics, 0.2)
    assert [name for name in names if splits[name] == "test"] == ["2.npz", "7.npz"]
    (tmp_path / "test.txt").write_text("0\n9.npz\n")
    splits = split_of_sequences(names, fabrics, str(tmp_path / "test.txt"))
    assert [name for name in names if splits[name] == "test"] == ["0.npz", "9.npz"]


X = motion("grid", (12, 15), 0)
NAN = np.where(np.arange(X.size).reshape(X.shape) == 300, np.nan, X)
STILL = np.repeat(X[:1], 8, 0) + 1e-5 * np.sin(np.arange(8))[:, None, None]
LED = X + np.where(np.isin(np.arange(16), [12, 15]), 0.01, 0.0)[None, :, None] * np.arange(24)[:, None, None]
NONE = {"areal_density": None, "per_vertex": None}
MISTAKES = {
    "no rate": ({"fps": None}, {}, "0.npz: found no rate; expected frames per second: set data.fps"),
    "two rates": ({}, {"fps": 30.0}, r"found 60 frames per second in the file and data.fps=30; leave one out"),
    "rate of a word": ({"fps": None}, {"fps": "fast"}, "data.fps: found 'fast'; expected frames per second"),
    "rate of nothing": ({"fps": 0.0}, {}, "fps: found 0.0; expected frames per second, more than 0"),
    "NaN": ({"positions": NAN}, {}, r"0.npz: frame 6, vertex 4: found \[.*nan"),
    "no masses": ({}, {"mass": NONE}, "found no mass; expected exactly one of data.mass.areal_density"),
    "two masses": ({"mass": np.ones(16)}, {}, "found mass in the file, areal_density; expected exactly one"),
    "grams": ({}, {"mass": {"areal_density": 200.0, "per_vertex": None}}, "found 200 kg/m2; expected 0.005 to 50"),
    "no mass of a vertex": ({"mass": np.zeros(16)}, {"mass": NONE}, "mass: found 0.0 at vertex 0; expected"),
    "mass of another mesh": ({"mass": np.ones(9)}, {"mass": NONE}, r"mass: found numbers of shape \(9,\); expected"),
    "no rest shape": ({"rest_positions": None}, {}, "found no rest shape; expected the cloth without any force"),
    "rest shape in centimetres": ({"rest_positions": 100 * GRID.rest_positions}, {"scale": 1.0}, "edges are 99 % or"),
    "centimetres": (
        {"rest_positions": 100 * GRID.rest_positions, "positions": 100 * X},
        {},
        r"found a cloth 40 m long.* in centimetres \(scale 0.01\).*: set data.scale, to 1 if",
    ),
    "micrometres": ({"rest_positions": 1e-6 * GRID.rest_positions}, {}, "have another unit .*: set data.scale"),
    "at rest": ({"positions": STILL}, {}, "no vertex moves further than .* expected cloth that swings or falls"),
    "too short": ({"positions": X[:4]}, {}, "found 4 frames; expected at least 5"),
    "led pins": ({"positions": LED}, {"pins": [12, 15]}, r"data.pins: vertex 1[25] moves by .* expected pins"),
    "pins it has not": ({}, {"pins": [99]}, r"data.pins: found 99..99; expected 0..15"),
    "pins by a word": ({}, {"pins": "corners"}, "data.pins: found 'corners'; expected still, a list of"),
    "all pinned": ({}, {"pins": list(range(16))}, "data.pins: vertex|found all vertices"),
    "faces it has not": ({"faces": GRID.faces + 9}, {}, "faces index"),
    "no such list": ({}, {"test": "absent.txt"}, "data.test: absent.txt: no such file; expected a share"),
    "share of all": ({}, {"test": 1.0}, "data.test: found 1.0; expected a share between 0 and 1"),
    "no such rest": ({}, {"rest": "absent.obj"}, "data.rest: absent.obj: no such file or folder"),
    "fabric of nothing": ({}, {"fabric": {"silk": "s*"}}, "data.fabric: sequence 0: found no fabric for it"),
    "attribute of nobody": ({}, {"attributes": {"silk": {}}}, "data.attributes: found silk; expected of own some of"),
    "attribute unknown": ({}, {"attributes": {"own": {"softness": 1}}}, "data.attributes: found softness; expected"),
    "gravity of a word": ({}, {"gravity": -9.81}, "data.gravity: found -9.81; expected a number from 0 on"),
    "no scale": ({}, {"scale": 0.0}, "scale: found 0.0; expected metres per unit"),
    "no axis": ({}, {"up_axis": "x"}, "up_axis: found 'x'; expected y or z"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_sentences_and_leave_nothing(tmp_path: Path, name: str) -> None:
    arrays, settings, sentence = MISTAKES[name]

    def write(place: Path, number: int) -> None:
        write_npz(place.with_suffix(".npz"), GRID, motion("grid", (12, 15), number), **arrays)

    with pytest.raises(DrapeError, match=sentence):
        two(tmp_path / "root", write, **settings)
    assert [path.name for path in tmp_path.iterdir()] == ["root"]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"fps": 24.0}, r"gravity of \(.*\) m/s2; .* it would fit at (59|60).* frames per second \(data.fps\)"),
        ({"scale": 0.1}, r"it would fit at .* or (9.9|10).* times as large \(data.scale\)"),
        ({"up_axis": "y"}, r"gravity of \(.*\) m/s2; .* it pulls along y: set data.up_axis"),
    ],
)
def test_a_wrong_rate_unit_or_axis_shows_in_the_motion(tmp_path: Path, settings: dict, sentence: str) -> None:
    """Files do not say them, so nothing else can tell: gravity is off by the same factor as everything."""

    def write(place: Path, number: int) -> None:
        write_meshes(place, GRID, motion("grid", ((12, 15), (12,))[number], number), "ply")

    write_meshes(tmp_path / "rest", GRID, GRID.rest_positions[None], "ply")
    changes = {"fps": 60.0, "rest": str(tmp_path / "rest")} | settings
    with pytest.raises(DrapeError, match=sentence):
        shown_gravity(two(tmp_path / "root", write, test=0.5, **changes))


def test_what_is_no_folder_of_sequences_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DrapeError, match=r"absent: no such folder; expected one with a file or a folder"):
        convert(tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    with pytest.raises(DrapeError, match=r"empty: found no sequence; expected files \(.npz"):
        convert(tmp_path / "empty")
    write_meshes(tmp_path / "frames", GRID, X, "obj")
    with pytest.raises(DrapeError, match="found the frames of one sequence; expected a folder"):
        convert(tmp_path / "frames", fps=60.0)
    write_npz(tmp_path / "one" / "0.npz", GRID, X)
    with pytest.raises(DrapeError, match=r"found one sequence \(0.npz\); expected at least two"):
        convert(tmp_path / "one")


def test_a_topology_that_changes_inside_a_sequence_is_refused(tmp_path: Path) -> None:
    for number in range(2):
        write_meshes(tmp_path / "root" / str(number), GRID, motion("grid", (12, 15), number), "obj")
    other = square_grid(0.4, 5)
    write_meshes(tmp_path / "other", other, other.rest_positions[None], "obj")
    (tmp_path / "other" / "frame_0.obj").replace(tmp_path / "root" / "1" / "frame_7.obj")
    with pytest.raises(DrapeError, match="frame_7.obj: found 25 vertices and 32 faces that are not those of"):
        convert(tmp_path / "root", fps=60.0, rest="first")


def test_rates_that_differ_between_sequences_are_refused(tmp_path: Path) -> None:
    def write(place: Path, number: int) -> None:
        write_npz(place.with_suffix(".npz"), GRID, motion("grid", (12, 15), number), fps=60.0 - number)

    with pytest.raises(DrapeError, match="1.npz: found 59 frames per second, and 60 in 0.npz; expected one rate"):
        two(tmp_path / "root", write)


def test_fabrics_that_cannot_be_told_apart_are_refused(tmp_path: Path) -> None:
    for number in range(4):
        write_npz(tmp_path / "root" / f"{'ab'[number % 2]}{number}.npz", GRID, motion("grid", (12, 15), number))
    with pytest.raises(DrapeError, match="first and second have the same"):
        convert(tmp_path / "root", fabric={"first": "a*", "second": "b*"}, test=0.5)
    assert not (tmp_path / "own.h5").exists()


def test_what_the_schema_does_not_allow_is_refused(tmp_path: Path) -> None:
    file = two(tmp_path / "root")
    old, frame = as_version_1(file, tmp_path / "old.h5").path, "sequences/000000/positions"
    for path, change, sentence in (
        (file.path, lambda f: f[frame].__setitem__((2, 0, 0), np.nan), "frame 2: found a number that"),
        (file.path, lambda f: f["garments/0/mass"].__setitem__(0, 0.0), "mass: found 0.0; expected positive numbers"),
        (file.path, lambda f: f["sequences/000001"].attrs.__setitem__("garment", "7"), "garment: found '7'; expected"),
        (file.path, lambda f: f["materials/own"].attrs.__delitem__("air_damping"), "materials/own: missing air_damp"),
        (old, lambda f: f[frame].__setitem__((2, 0, 0), np.nan), "frame 2: found a number that"),
        (old, lambda f: f["pieces/0/mass"].__setitem__(0, 0.0), "mass: found 0.0; expected positive numbers"),
        (old, lambda f: f["pieces/0/faces"].__setitem__((0, 0), 99), "pieces/0/faces: found vertex 99; expected 0..15"),
        (old, lambda f: f["sequences/000001"].attrs.__setitem__("piece", 7), "attribute piece: found 7; expected 0..0"),
        (old, lambda f: f.__delitem__("pieces/0/faces"), "pieces/0/faces: missing"),
        (old, lambda f: f.__delitem__("sequences"), "found 1 pieces and 0 sequences; expected some"),
    ):
        damaged = tmp_path / "damaged.h5"
        damaged.write_bytes(path.read_bytes())
        with h5py.File(damaged, "r+") as file:
            change(file)
        with pytest.raises(DrapeError, match=sentence):
            open_trajectories(damaged)
