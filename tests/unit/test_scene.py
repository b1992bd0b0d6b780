"""A scene fits together or is refused with a sentence; what it holds cannot be changed afterwards."""

from __future__ import annotations

import dataclasses
import importlib.util

import numpy as np
import pytest
import yaml

from drape.blender.presets import fabric_settings
from drape.config.entry_point import CONF
from drape.errors import DrapeError
from drape.geometry.disc import disc
from drape.geometry.grid import rectangular_grid, square_grid
from drape.scene.frozen_array import frozen_floats, frozen_indices
from drape.scene.mass import vertex_masses
from drape.scene.material import ATTRIBUTES, Material, attribute_vector
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State

MESH = square_grid(1.0, 3)
SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


def moving_body(frames: int) -> Obstacle:
    return Obstacle(np.array([[0, 1, 2]]), TRIANGLE + np.arange(frames)[:, None, None])


def parts(**changes: object) -> dict:
    values = {
        "name": "test",
        "mesh": MESH,
        "initial": State.at_rest(MESH.rest_positions),
        "material": SILK,
        "mass": np.full(9, 0.15),
        "gravity": np.array([0.0, 0.0, -9.81]),
        "dt": 1 / 30,
        "frames": 4,
        "pins": Pins.fixed([0, 2], MESH.rest_positions),
    }
    return values | changes


def test_a_scene_holds_copies_that_cannot_be_changed():
    mass = np.full(9, 0.15)
    scene = Scene(**parts(mass=mass, obstacle=moving_body(5), friction=0.3, external_force=np.ones((9, 3))))
    mass[:] = 7.0
    assert (scene.mass == 0.15).all()
    for array in (scene.mass, scene.gravity, scene.external_force, scene.pins.targets, scene.obstacle.positions):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.dt = 1.0


BAD_SCENES = {
    "dt zero": ({"dt": 0.0}, r"dt: found 0\.0; expected seconds between frames, more than 0"),
    "dt nan": ({"dt": float("nan")}, "dt: found nan; expected seconds"),
    "no frames": ({"frames": 0}, "frames: found 0; expected at least 1"),
    "another mesh": (
        {"initial": State.at_rest(square_grid(1.0, 4).rest_positions)},
        "initial: found positions of 16 .* expected 9, as the mesh has",
    ),
    "mass zero": ({"mass": np.array([1.0] * 8 + [0.0])}, "mass: vertex 8: found 0 kg; expected more than 0"),
    "mass nan": ({"mass": np.array([1.0] * 8 + [np.nan])}, "mass: entry 8: found nan; expected finite"),
    "gravity nan": ({"gravity": np.array([0.0, 0.0, np.nan])}, "gravity: entry 2: found nan; expected finite"),
    "force nan": ({"external_force": np.full((9, 3), np.nan)}, "external_force: vertex 0: found .* expected finite"),
    "pin beyond": (
        {"pins": Pins(np.array([9]), np.zeros((1, 1, 3)))},
        r"pins: found vertex 9; expected 0\.\.8, as the mesh has 9 vertices",
    ),
    "pins too short": (
        {"pins": Pins(np.array([0]), np.zeros((4, 1, 3)))},
        r"pins: found 4 frames; expected 5 .* set frames to 3 or fewer",
    ),
    "body too short": ({"obstacle": moving_body(3)}, r"body: found 3 frames; expected 5 .* set frames to 2 or fewer"),
    "friction of nothing": ({"friction": 0.3}, r"friction: found 0\.3 in a scene without a body; leave it out, or"),
    "negative friction": ({"friction": -1.0, "obstacle": moving_body(1)}, r"friction: found -1\.0; expected a coeff"),
}


@pytest.mark.parametrize("name", BAD_SCENES)
def test_scenes_that_do_not_fit_together_are_refused_with_a_sentence(name):
    changes, sentence = BAD_SCENES[name]
    with pytest.raises(DrapeError, match=f"^scene test: {sentence}"):
        Scene(**parts(**changes))


BAD_PINS = {
    "none": ([], np.zeros((1, 0, 3)), r"vertices: found shape \(0,\); expected \(any\)"),
    "twice": ([4, 4], np.zeros((1, 2, 3)), "vertices: found 4 twice"),
    "negative": ([-1], np.zeros((1, 1, 3)), "vertices: found -1; expected whole numbers from 0"),
    "nan": ([1], np.array([[[0, 0, np.nan]]]), "targets: frame 0, vertex 0: found .*nan.*; expected finite"),
}


@pytest.mark.parametrize("name", BAD_PINS)
def test_pins_that_make_no_sense_are_refused(name):
    vertices, targets, sentence = BAD_PINS[name]
    with pytest.raises(DrapeError, match=f"^pins: {sentence}"):
        Pins(np.array(vertices, np.int64), targets)


@pytest.mark.parametrize(
    ("read", "values", "sentence"),
    [
        (frozen_floats, [1.0, 2.0], r"found shape \(2,\); expected \(3\)"),
        (frozen_floats, [[1.0, 2.0, 3.0]], r"found shape \(1, 3\); expected \(3\)"),
        (frozen_floats, ["up", 1.0, 2.0], r"found \['up', 1\.0, 2\.0\]; expected numbers of shape \(3\)"),
        (frozen_floats, [1.0, np.inf, 2.0], "entry 1: found inf; expected finite numbers"),
        (frozen_indices, [1, 2, 0.5], r"found 0\.5; expected whole numbers from 0 on"),
        (frozen_indices, [1, 2, -1], "found -1; expected whole numbers from 0 on"),
    ],
)
def test_values_that_are_no_array_are_refused(read, values, sentence):
    """Whatever a config or a caller hands over; annotations are checked in tests only."""
    with pytest.raises(DrapeError, match=f"^gravity: {sentence}"):
        read(values, (3,), "gravity")


def test_fixed_pins_hold_at_all_times_and_moving_ones_end():
    fixed = Pins.fixed([2, 0], MESH.rest_positions)
    assert (fixed.at(0) == fixed.at(1000)).all()
    assert (fixed.at(3) == MESH.rest_positions[[2, 0]]).all()
    with pytest.raises(DrapeError, match=r"pins: vertices: found 9; expected 0\.\.8, as the cloth has 9 vertices"):
        Pins.fixed([9], MESH.rest_positions)
    led = Pins(np.array([1]), np.arange(6.0).reshape(2, 1, 3))
    assert led.at(1).tolist() == [[3.0, 4.0, 5.0]]
    for frame in (2, -1):
        with pytest.raises(DrapeError, match=rf"pins: asked for frame {frame}; expected 0\.\.1; simulate fewer"):
            led.at(frame)


def test_the_mass_rules_weigh_as_they_say():
    coarse, fine = square_grid(2.0, 5), square_grid(2.0, 9)
    for mesh in (coarse, fine, disc(0.5, 6, 0.3)):
        assert (vertex_masses(mesh, {"per_vertex": 0.15}) == 0.15).all()
    for mesh in (coarse, fine):
        lumped = vertex_masses(mesh, {"per_vertex": None, "areal_density": 0.2})
        assert lumped.sum() == pytest.approx(0.2 * 4.0)
    inner = vertex_masses(coarse, {"areal_density": 0.2}).reshape(5, 5)[1:-1, 1:-1]
    assert inner == pytest.approx(0.2 * 0.5**2), "an inner vertex owns one square"


@pytest.mark.parametrize(
    ("mass", "sentence"),
    [
        ({}, "mass: found {}; expected exactly one of per_vertex"),
        ({"per_vertex": None, "areal_density": None}, "mass: found .*; expected exactly one"),
        ({"per_vertex": 0.1, "areal_density": 0.2}, "mass: found .*; expected exactly one"),
        ({"density": 0.1}, "mass: found {'density': 0.1}; expected exactly one"),
        ({"per_vertex": 0.0}, r"mass\.per_vertex: found 0\.0; expected a positive number"),
        ({"areal_density": float("nan")}, r"mass\.areal_density: found nan; expected a positive number"),
    ],
)
def test_masses_are_never_guessed(mass, sentence):
    with pytest.raises(DrapeError, match=rf"^scene\.{sentence}"):
        vertex_masses(MESH, mass)


def test_a_fabric_is_what_the_networks_take():
    scales = dict.fromkeys(ATTRIBUTES, 2.0)
    assert attribute_vector(SILK.attributes, scales) == [2.5, 0.25, 0.075, 0.0, 0.0]
    assert Material.from_settings("silk", SILK.attributes | {"quality": 5, "preset": "Silk"}) == SILK


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"tension_stiffness": -1.0}, r"tension_stiffness: found -1\.0; expected a number from 0 on"),
        ({"mass_per_vertex": 0.0}, r"mass_per_vertex: found 0\.0; expected a positive number"),
        ({"bending_damping": float("inf")}, "bending_damping: found inf"),
    ],
)
def test_fabrics_that_are_none_are_refused(change, sentence):
    with pytest.raises(DrapeError, match=f"^fabric silk: {sentence}"):
        dataclasses.replace(SILK, **change)
    with pytest.raises(DrapeError, match="^fabric wool: missing tension_damping, air_damping, mass_per_vertex; "):
        Material.from_settings("wool", {"tension_stiffness": 1.0, "bending_stiffness": 1.0, "bending_damping": 0.0})


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs bpy (Python 3.11)")
@pytest.mark.blender
@pytest.mark.parametrize("path", sorted((CONF / "fabric").glob("[!o]*.yaml")), ids=lambda path: path.stem)
def test_fabrics_of_scenes_are_those_of_the_training_data(path):
    """conf/fabric repeats in numbers what conf/material asks of Blender's presets."""
    values = yaml.safe_load(path.read_text(encoding="utf-8"))
    entry = yaml.safe_load((CONF / "material" / path.name).read_text(encoding="utf-8"))[path.stem]
    settings = fabric_settings(path.stem, entry["preset"], entry["overrides"])
    settings["mass_per_vertex"] = settings.pop("mass")
    assert values.pop("_target_") == f"{Material.__module__}.Material"
    assert Material(**values) == Material.from_settings(path.stem, settings)


def test_there_is_a_fabric_for_every_material():
    fabrics, materials = ({path.stem for path in (CONF / name).glob("*.yaml")} for name in ("fabric", "material"))
    assert fabrics - {"own"} == materials - {"all", "recorded"}


@pytest.mark.parametrize("rings", [2, 5, 16])
def test_a_disc_is_round_even_and_has_a_ring_on_the_rim(rings):
    mesh = disc(0.15, rings, 0.09)
    radii = np.linalg.norm(mesh.rest_positions, axis=1)
    assert mesh.num_vertices == 1 + 3 * rings * (rings + 1)
    assert mesh.num_faces == 6 * rings**2
    assert mesh.boundary.sum() == 6 * rings
    assert np.isclose(radii, 0.09, atol=1e-12).sum() == 6 * round(rings * 0.6)
    a, b, c = (mesh.rest_positions[mesh.faces[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (area > 0).all()
    polygon = 0.5 * 6 * rings * 0.15**2 * np.sin(2 * np.pi / (6 * rings))
    assert area.sum() == pytest.approx(polygon), "no gap and no overlap"
    assert mesh.rest_lengths.max() < 1.6 * mesh.rest_lengths.min()


def test_a_strip_lies_as_documented():
    mesh = rectangular_grid((3.0, 1.0), (7, 3))
    assert mesh.num_vertices == 21
    assert mesh.rest_positions[0].tolist() == [-1.5, 0.5, 0.0]
    assert mesh.rest_positions[6].tolist() == [1.5, 0.5, 0.0]
    assert mesh.rest_positions[7].tolist() == [-1.5, 0.0, 0.0]
    assert mesh.num_faces == 2 * 6 * 2


@pytest.mark.parametrize("arguments", [(0.1, 4, 0.2), (0.1, 4, 0.0), (0.1, 1, 0.05)])
def test_discs_that_make_no_sense_are_refused(arguments):
    with pytest.raises(DrapeError, match="^disc: .*expected 0 < inner radius < radius and 2 rings or more"):
        disc(*arguments)


@pytest.mark.parametrize("arguments", [((1.0, 0.0), (3, 3)), ((1.0, 1.0), (3, 1)), ((1.0, 1.0), (3, 3), "spiral")])
def test_strips_that_make_no_sense_are_refused(arguments):
    with pytest.raises(DrapeError, match="^rectangular cloth: .*expected sizes > 0, resolutions >= 2 and a pattern"):
        rectangular_grid(*arguments)
