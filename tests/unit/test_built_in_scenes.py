"""The scenes of conf/scene, built from their configuration: they are what their comments say, with every fabric."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from drape.config import instantiate
from drape.config.entry_point import CONF
from drape.energy.incremental_potential import IncrementalPotential
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.scene.mass import vertex_areas
from drape.scene.scene import Scene
from tests import trajectories

FABRICS = {"silk": 0.15, "leather": 0.4, "denim": 1.0, "cotton": 0.3}
"""Mass of a vertex [kg]."""
AREAL = ("scene.mass.per_vertex=null", "scene.mass.areal_density=0.2")
SELF_CONTAINED = ("hanging", "cantilever", "cusick", "sphere", "flag")


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None):
        yield


def built(scene: str, *overrides: str, fabric: str = "silk") -> Scene:
    return instantiate(compose("animate", [f"fabric={fabric}", f"scene={scene}", *overrides]).scene)


def test_every_scene_is_tried_here():
    others = {"custom", "held_out", "extreme", "garment", "person"}
    assert {path.stem for path in (CONF / "scene").glob("*.yaml")} == {*SELF_CONTAINED, *others}


@pytest.mark.parametrize("fabric", FABRICS)
@pytest.mark.parametrize("name", SELF_CONTAINED)
def test_scenes_can_be_made_of_every_fabric_and_begin_unstretched(name, fabric):
    scene = built(name, fabric=fabric)
    assert (scene.name, scene.material.name, scene.frames, scene.dt) == (name, fabric, 90, 1 / 30)
    if name == "hanging":
        assert (scene.mass == FABRICS[fabric]).all()
    else:
        density = 484 * FABRICS[fabric] / 4.8**2  # of the cloth that the laws are learned from
        np.testing.assert_allclose(scene.mass, density * vertex_areas(scene.mesh), rtol=1e-4)
    ends = scene.initial.x[scene.mesh.edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=-1)
    np.testing.assert_allclose(lengths, scene.mesh.rest_lengths, rtol=0.01)
    assert (scene.initial.v == 0).all()
    assert (scene.obstacle is not None) == (name == "sphere")
    assert (scene.external_force is not None) == (name == "flag")


def test_the_hanging_cloth_is_that_of_the_training_data():
    scene = built("hanging")
    assert (scene.mesh.num_vertices, scene.mesh.num_edges) == (484, 1365)
    assert scene.pins.vertices.tolist() == [0, 21]
    np.testing.assert_allclose(scene.pins.at(5), [[-2.4, 2.4, 0], [2.4, 2.4, 0]], atol=1e-6)
    assert np.ptp(scene.initial.x[:, 2]) == 0.0


def test_a_cloth_that_hangs_already_hangs_from_its_pins():
    scene = built("hanging", "scene.start=vertical", "scene.size=1.0")
    assert np.ptp(scene.initial.x, axis=0) == pytest.approx([1.0, 0.0, 1.0])
    assert scene.pins.at(0)[:, 2] == pytest.approx(scene.initial.x[:, 2].max())
    assert _normal(scene)[1] < 0, "a turn, not a mirror image"


def _normal(scene: Scene) -> np.ndarray:
    a, b, c = scene.initial.x[scene.mesh.faces[0]]
    return np.cross(b - a, c - a)


def test_the_clamp_of_the_cantilever_holds_whole_rows():
    scene = built("cantilever")
    held = scene.initial.x[scene.pins.vertices]
    assert len(held) == 2 * 6
    assert np.unique(held[:, 0]) == pytest.approx([-0.5, -0.5 + 1 / 21], abs=1e-6)
    with pytest.raises(DrapeError, match=r"scene\.clamped_rows: found 22 of 22 rows; expected 1\.\.21"):
        built("cantilever", "scene.clamped_rows=22")


def test_the_pedestal_holds_all_that_lies_on_it():
    scene = built("cusick", *AREAL)
    distance = np.linalg.norm(scene.mesh.rest_positions[:, :2], axis=1)
    held = np.isin(np.arange(len(distance)), scene.pins.vertices)
    assert (held == (distance <= 1.44 + 1e-6)).all()
    assert distance[held].max() == pytest.approx(1.44)
    assert (scene.initial.x[held, 2] == 0).all()
    assert 0 < np.abs(scene.initial.x[:, 2]).max() <= 0.016
    assert scene.mass.sum() == pytest.approx(0.2 * np.pi * 2.4**2, rel=2e-3)


def test_the_sphere_moves_as_told_and_begins_below_the_cloth():
    sizes = ("scene.radius=0.25", "scene.gap=0.02")
    scene = built("sphere", *sizes, "scene.sway=[0.2, 0.0, 0.1]", "scene.period=1.0", "scene.frames=30")
    body = scene.obstacle
    assert body.num_frames == 31
    centres = body.positions.mean(axis=1)
    assert centres[0] == pytest.approx([0, 0, -0.27], abs=1e-9)
    assert centres[15] - centres[0] == pytest.approx([0.2, 0, 0.1], abs=1e-9)
    assert centres[30] == pytest.approx(centres[0], abs=1e-9)
    assert np.linalg.norm(centres[1] - centres[0]) < 0.15 * np.linalg.norm(centres[8] - centres[7]), "it starts at rest"
    for frame in (0, 15, 30):
        assert np.linalg.norm(body.at(frame) - centres[frame], axis=1) == pytest.approx(0.25)
    a, b, c = (body.at(0)[body.faces[:, k]] for k in range(3))
    assert (np.sum(np.cross(b - a, c - a) * (a - centres[0]), axis=1) > 0).all(), "its faces wind outwards"


def test_the_flag_is_held_along_one_edge_and_pushed_by_its_area():
    scene = built("flag", "scene.force_per_area=[3.0, 1.0, 0.0]")
    held = scene.initial.x[scene.pins.vertices]
    assert len(held) == 15
    assert held[:, 0] == pytest.approx(-2.4)
    assert np.ptp(held[:, 2]) == pytest.approx(3.2)
    assert scene.external_force.sum(axis=0) == pytest.approx([3.0 * 4.8 * 3.2, 4.8 * 3.2, 0.0])


@pytest.mark.parametrize(
    ("scene", "override", "sentence"),
    [
        ("hanging", "scene.size=0.0", "square cloth: size 0.0"),
        ("hanging", "scene.fps=0.0", r"scene\.fps: found 0\.0; expected frames per second, more than 0"),
        ("hanging", "scene.frames=0", "frames: found 0; expected at least 1"),
        ("hanging", "scene.gravity=[0.0, 9.81]", r"scene\.gravity: found shape \(2,\); expected \(3\)"),
        ("hanging", "scene.mass.areal_density=1.0", "mass: found .* expected exactly one of"),
        ("cantilever", "scene.size=[1.0]", r"scene\.size: found shape \(1,\); expected \(2\)"),
        ("flag", "scene.resolution=[4]", r"scene\.resolution: found shape \(1,\); expected \(2\)"),
        ("flag", "scene.force_per_area=[nan, 0.0, 0.0]", r"scene\.force_per_area: entry 0: found nan"),
        ("sphere", "scene.radius=-1.0", "scene: radius -1.0, .*; expected radius > 0 m"),
        ("sphere", "scene.subdivisions=9", "subdivisions 9; expected .* 0 to 6 subdivisions"),
        ("cusick", "scene.rings=1", "disc: .* expected 0 < inner radius < radius and 2 rings or more"),
    ],
)
def test_values_that_no_scene_can_have_are_refused(scene, override, sentence):
    with pytest.raises(DrapeError, match=sentence):
        built(scene, override)


# The user's own garment and body


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A flat square at the height of a ball's top, and the ball, which turns about z and rises."""
    cloth, ball = square_grid(1.0, 5), trimesh.creation.icosphere(3, 0.4)
    trimesh.Trimesh(cloth.rest_positions, cloth.faces, process=False).export(tmp_path / "cloth.obj")
    low = np.array(cloth.rest_positions) + [0.0, 0.0, -0.1]
    trimesh.Trimesh(low, cloth.faces, process=False).export(tmp_path / "lower.obj")
    x = ball.vertices - [0.0, 0.0, 0.41]
    turned = x[:, [1, 0, 2]] * [-1.0, 1.0, 1.0] + [0.0, 0.0, 1.0]
    np.savez(tmp_path / "ball.npz", faces=ball.faces, positions=np.stack([x, turned]), fps=1.0)
    return tmp_path


def custom(folder: Path, *overrides: str) -> Scene:
    mass = "scene.mass={per_vertex: 0.1, areal_density: null}"
    return built("custom", f"scene.mesh={folder}/cloth.obj", mass, "scene.frames=30", *overrides)


def test_a_mesh_alone_is_a_scene(own):
    scene = custom(own)
    assert (scene.name, scene.pins, scene.obstacle, scene.friction, scene.external_force) == ("cloth", *[None] * 4)
    np.testing.assert_allclose(scene.initial.x, square_grid(1.0, 5).rest_positions)
    assert scene.mass.sum() == pytest.approx(2.5)


@pytest.mark.parametrize("contact", ["surface", "paper", "ipc"])
def test_what_is_enlarged_keeps_longer_distances_and_what_is_made_smaller_does_not_keep_shorter_ones(own, contact):
    """Files in centimetres are no small scene."""
    make = instantiate(compose(None, [f"+contact={contact}"]).contact)
    lengths = {}
    for scale in (0.01, 1.0, 5.0):
        scene = custom(own, f"scene.scale={scale}", f"scene.body={own}/ball.npz", "scene.frames=1")
        potential = IncrementalPotential.for_scene(scene, [], make)
        lengths[scale] = [potential.contact.thickness, potential.contact.reach]
        if contact == "ipc":
            collisions = potential.barrier.collisions
            lengths[scale] += [collisions.cloth.reach, collisions.body.reach]
    assert lengths[0.01] == lengths[1.0]
    assert lengths[5.0] == pytest.approx([5.0 * length for length in lengths[1.0]])
    assert make.thickness == lengths[1.0][0], "the contact itself stays as it is"


def test_rest_shape_and_start_may_differ(own):
    scene = custom(own, f"scene.start={own}/lower.obj")
    assert scene.initial.x[:, 2] == pytest.approx(-0.1)
    assert scene.mesh.rest_positions[:, 2] == pytest.approx(0.0)
    (own / "other.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(DrapeError, match=r"other\.obj: found 3 vertices and 1 faces that are not those .*\(25 vert"):
        custom(own, f"scene.start={own}/other.obj")


def test_pins_are_listed_or_found_by_a_rule(own):
    assert custom(own, "scene.pins=[0, 4]").pins.vertices.tolist() == [0, 4]
    assert custom(own, "scene.pins=[]").pins is None
    upright = "scene.gravity=[0.0, -9.81, 0.0]"
    assert custom(own, "scene.pins={top: 0.02}", upright).pins.vertices.tolist() == [0, 1, 2, 3, 4]
    assert len(custom(own, "scene.pins={top: 0.26}", upright).pins.vertices) == 10
    with pytest.raises(DrapeError, match="scene cloth: pins: found all 25 vertices; expected some that are free"):
        custom(own, "scene.pins={top: 0.0}", "scene.gravity=[0.0, 0.0, 0.0]")


def test_pins_stay_or_follow_the_body(own):
    body = f"scene.body={own}/ball.npz"
    stay = custom(own, "scene.pins=[12, 13]", body)
    assert stay.friction == 0.3
    assert stay.pins.is_static
    follow = custom(own, "scene.pins=[12, 13]", body, "scene.pins_follow_body=true")
    assert follow.pins.num_frames == 31
    np.testing.assert_allclose(follow.pins.at(0), [[0, 0, 0], [0.25, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(follow.pins.at(30), [[0, 0, 1.0], [0, 0.25, 1.0]], atol=1e-9)


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("scene.pins=[25]", r"scene\.pins: found vertex 25; expected 0\.\.24, as the cloth has 25 vertices"),
        ("scene.pins=[1, 1]", "pins: vertices: found 1 twice"),
        ("scene.pins=[-1]", r"scene\.pins: found -1; expected whole numbers from 0 on"),
        ("scene.pins={bottom: 0.1}", r"scene\.pins: found {'bottom': 0.1}; expected a list of vertex indices, or {top"),
        ("scene.pins={top: -0.1}", r"scene\.pins: found {'top': -0.1}; expected a list"),
        ("scene.pins_follow_body=true", r"scene\.pins_follow_body: found true without a body: set scene\.body"),
        ("scene.scale=1000.0", r"cloth\.obj: found a cloth of 1\.41e\+03 m; .* set scene\.scale"),
        ("scene.scale=0.0", r"cloth\.obj: scale: found 0\.0; expected metres per unit"),
        ("scene.body={0}/nobody", "nobody: no such file or folder"),
        ("scene.body={0}/ball.npz,scene.body_scale=0.01", r"ball\.npz: found sizes of 1\.41 m and 0\.01.* m; .*units"),
        ("scene.body={0}/ball.npz,scene.frames=31", r"ball\.npz: found 2 frames at 1 .* set scene\.frames to 30 or"),
        ("scene.body={0}/ball.npz,scene.friction=-1.0", r"friction: found -1\.0; expected a coefficient from 0 on"),
        ("scene.body={0}/ball.npz,scene.pins_follow_body=true", "found true without a pinned vertex: set scene.pins"),
        ("scene.mass.per_vertex=null", r"scene\.mass: found .*; expected exactly one of per_vertex"),
    ],
)
def test_mistakes_with_own_files_are_refused_with_a_sentence(own, override, sentence):
    parts = override.replace("{0}", str(own))
    overrides = parts.split(",scene") if "body=" in parts else [parts]
    with pytest.raises(DrapeError, match=sentence):
        custom(own, overrides[0], *(f"scene{rest}" for rest in overrides[1:]))


# Recorded sequences


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Five frames of four sequences, two fabrics, the last two sequences for testing."""
    rng = np.random.default_rng(0)
    rows = [rng.normal(size=(5, 16, 3)).astype(np.float32) for _ in range(4)]
    return trajectories.write(tmp_path / "data.h5", trajectories.header(), trajectories.sequences_of(rows, training=2))


def test_a_recorded_sequence_is_a_scene(data):
    scene = built("held_out", f"scene.path={data}", "scene.frames=3", fabric="denim")
    truth = scene.reference
    assert truth.shape == (4, 16, 3)
    np.testing.assert_array_equal(scene.initial.x, truth[0])
    x = np.random.default_rng(0).normal(size=(4, 5, 16, 3)).astype(np.float32)[3].astype(np.float64)
    np.testing.assert_array_equal(truth, x[1:])
    np.testing.assert_allclose(scene.initial.v, 30 * (x[1] - x[0]), rtol=1e-12)
    assert (scene.material.name, scene.material.mass_per_vertex, scene.dt) == ("denim", 1.0, 1 / 30)
    assert (scene.mass == 1.0).all()
    assert scene.pins.vertices.tolist() == [0, 3]
    np.testing.assert_array_equal(scene.pins.at(2), x[1][[0, 3]])


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("scene.frames=4", r"frames: found 4; expected 1\.\.3, as 5 are recorded"),
        ("scene.sequence=1", r"scene\.sequence: found 1; expected 0\.\.0, as the test split has 1 sequences of silk"),
        ("scene.fabric=wool", "found no fabric 'wool'; expected one of silk, denim"),
        ("scene.path=nowhere.h5", "nowhere.h5: no such file; make it with"),
    ],
)
def test_recorded_sequences_that_are_not_there_are_refused(data, override, sentence):
    with pytest.raises(DrapeError, match=sentence):
        built("held_out", f"scene.path={data}", "scene.frames=3", override)


# Units, axes and places of own files


PERSON = trimesh.creation.box((0.5, 0.3, 1.7), trimesh.transformations.translation_matrix([0, 0, 0.85]))
SHIRT = trimesh.creation.cylinder(0.35, 0.6, sections=12).vertices + [0.0, 0.0, 1.1]
SIDES = trimesh.creation.cylinder(0.35, 0.6, sections=12).faces


def dressed(folder: Path, *overrides: str, shirt: float = 1.0, person: float = 1.0, up: str = "zz", beside: float = 0):
    """A shirt and a person, each in a unit (metres per unit) and with an up axis of its own."""
    for name, axis, unit, x, faces in (
        ("shirt", up[0], shirt, SHIRT + [0.0, beside, 0.0], SIDES),
        ("person", up[1], person, PERSON.vertices, PERSON.faces),
    ):
        x = np.array(x) / unit
        x = np.stack([x[:, 0], x[:, 2], -x[:, 1]], axis=1) if axis == "y" else x
        trimesh.Trimesh(x, faces, process=False).export(folder / f"{name}.obj")
    own = (f"scene.mesh={folder}/shirt.obj", f"scene.body={folder}/person.obj", "scene.mass.areal_density=0.2")
    return built("custom", *own, *overrides)


@pytest.mark.parametrize(
    ("case", "sentence", "remedy"),
    [
        ({"shirt": 0.01, "person": 0.01}, r"0\.7 m in centimetres \(scale 0\.01\)", ["scene.scale=0.01"]),
        ({"shirt": 0.001, "person": 0.001}, r"0\.7 m in millimetres \(scale 0\.001\)", ["scene.scale=0.001"]),
        ({"shirt": 0.0254, "person": 0.0254}, r"0\.7 m in inches \(scale 0\.0254\)", ["scene.scale=0.0254"]),
        ({"person": 0.01}, r"person\.obj: .* 1\.7 m in centimetres .*scene\.body_scale", ["scene.body_scale=0.01"]),
        ({"shirt": 0.01}, r"shirt\.obj: found a cloth .*0\.7 m in centi", ["scene.scale=0.01", "scene.body_scale=1.0"]),
        ({"up": "yy"}, r"person\.obj: found a body 1\.7 m long along y .* set scene\.up_axis=y", ["scene.up_axis=y"]),
        ({"up": "yz"}, r"they fit if y is up in one.*scene\.up_axis=y", ["scene.up_axis=y", "scene.body_up_axis=z"]),
        ({"up": "zy"}, r"person\.obj: found a body 1\.7 m long along y", ["scene.body_up_axis=y"]),
    ],
)  # fmt: skip
def test_units_and_axes_are_asked_for_and_what_is_named_mends_it(tmp_path, case, sentence, remedy):
    with pytest.raises(DrapeError, match=sentence):
        dressed(tmp_path, **case)
    scene = dressed(tmp_path, *remedy, **case)
    np.testing.assert_allclose(scene.initial.x.mean(axis=0), SHIRT.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(np.ptp(scene.obstacle.at(0), axis=0), [0.5, 0.3, 1.7], atol=1e-6)


def test_what_was_read_is_said_in_a_line_each(tmp_path):
    garment, body = dressed(tmp_path).said
    assert garment == "garment: shirt.obj, 0.7 x 0.7 x 0.6 m, 26 vertices, 48 faces, 1 part"
    assert body == "body: person.obj, 0.5 x 0.3 x 1.7 m, 8 vertices, 12 faces, 1 part"
    assert "the garment is 1.5 m beside the body and falls past it" in dressed(tmp_path, beside=2.0).said[2]


def test_frames_are_those_of_the_body_where_its_rate_is_usual(own):
    ball = np.load(own / "ball.npz")
    for rate, fps in ((24.0, 24.0), (60.0, 60.0), (120.0, 30.0), (1.0, 30.0)):
        positions = ball["positions"][np.zeros(int(31 * max(rate / fps, 1)) + 1, int)]
        positions = positions + 1e-3 * np.arange(len(positions))[:, None, None]
        np.savez(own / "still.npz", faces=ball["faces"], positions=positions, fps=rate)
        assert custom(own, f"scene.body={own}/still.npz", "scene.frames=10").dt == pytest.approx(1 / fps)
    assert custom(own, f"scene.body={own}/still.npz", "scene.frames=10", "scene.fps=50.0").dt == pytest.approx(1 / 50)


def test_pins_are_counted_as_in_the_file(tmp_path):
    """Vertex 0 is loose; in the seam 6 has become 1, and 7 is 6 now."""
    where = Path(__file__).parents[1] / "fixtures/by_hand"
    mass = "scene.mass.areal_density=0.2"
    assert built("custom", f"scene.mesh={where}/loose.obj", mass, "scene.pins=[1, 4]").pins.vertices.tolist() == [0, 3]
    with pytest.raises(DrapeError, match=r"scene\.pins: found vertex 0, which belongs to no face; leave it out"):
        built("custom", f"scene.mesh={where}/loose.obj", mass, "scene.pins=[0, 1]")
    seam = built("custom", f"scene.mesh={where}/seam.obj", mass, "scene.scale=0.01", "scene.pins=[1, 6, 7]")
    assert seam.pins.vertices.tolist() == [1, 6]
