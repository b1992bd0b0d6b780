"""Fabric cards: each instrument beside theory, at two resolutions, and the card as a whole."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from drape.benchmark.bending_test import ANGLE, Bent, bend, bending_test
from drape.benchmark.drape_test import PEDESTAL, Draped, crests, drape_test, shadow
from drape.benchmark.elastica import bending_lengths, strip
from drape.benchmark.fabric_card import beside, row
from drape.benchmark.falling_test import falling_speed
from drape.benchmark.sample import GRAVITY, Sample
from drape.benchmark.tensile_test import TensileTest
from drape.benchmark.triangular_sheet import triangular_sheet
from drape.config import instantiate
from drape.config.check import check_config
from drape.config.entry_point import CONF
from drape.energy.fabric import Fabric
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.errors import DrapeError
from drape.geometry.disc import disc
from drape.scene.material import Material
from drape.simulators.solver.balance import mean_weight
from drape.simulators.solver.implicit import ImplicitSolver

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
SPRING, HINGE, DAMPER, DRAG, FACE = 300.0, 1.2e-5, 0.5, 1e-3, 1e-3
"""Of a law without surprises [N/m, J/rad², kg/s, kg/s], learned on faces that no test piece here has [m²]."""
DENSITY = 0.15
"""[kg/m²]"""


def sample(times: float = 1.0) -> Sample:
    """Springs and hinges, all of them and the weight so many times as strong."""
    constants = times * np.array([SPRING, HINGE])[:, None, None]
    law = BakedHinges(
        SplinePlane(constants, (0, 0), (1.0, 1.0)), fabric=SILK, attributes=torch.zeros(5, dtype=torch.float64),
        stretch_scale=1.0, angle_scale=1.0, face_area=FACE, damper=times * DAMPER, drag=times * DRAG,
    )  # fmt: skip
    fabric = Fabric([HingeElastic(law, transfer=True), Damping(law, transfer=True)], law.attributes)

    def solver(scene):
        potential = IncrementalPotential.for_scene(scene, copy.deepcopy(fabric.terms))
        return ImplicitSolver(potential, scene, fabric.attributes, tolerance=1e-5 * mean_weight(scene), iterations=2000)

    return Sample(SILK, times * DENSITY, fabric, solver)


def test_the_elastica():
    """Small angles by hand, L³ w / 8 B; at 41.5 degrees half of the overhang is the bending length (Peirce)."""
    assert bending_lengths(0.1) ** 3 / 8 == pytest.approx(math.radians(0.1), rel=1e-4)
    assert bending_lengths(ANGLE) == pytest.approx(2.0, abs=1e-3)
    overhang, chord = strip(math.radians(20.0))
    assert bending_lengths(math.degrees(chord)) == pytest.approx(overhang, rel=1e-6)
    assert bending_lengths(89.0) == bending_lengths(86.0) > bending_lengths(84.0)


@pytest.mark.parametrize(("cells", "tolerance"), [(7, 0.03), (14, 0.01)])
def test_a_strip_of_known_hinges_has_the_bending_length_of_theory(cells, tolerance):
    """Hinges of stiffness b on equilateral triangles bend as a plate of √3/2 b (Seung, Nelson 1988, PRA 38)."""
    stiffness = 0.5 * math.sqrt(3.0) * HINGE
    expected = (stiffness / (DENSITY * GRAVITY)) ** (1 / 3) * bending_lengths(ANGLE) / 2
    bent = bending_test(sample(), cells)
    assert bent.bending_length == pytest.approx(expected, rel=tolerance)
    assert bent.flexural_rigidity == pytest.approx(stiffness, rel=3 * tolerance)
    assert bent.angle == pytest.approx(ANGLE, abs=0.1)
    assert bent.profile[-1, 1] < bent.profile[1, 1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("cells", [4, 8])
def test_a_sheet_of_known_springs_has_the_stiffness_of_theory(cells):
    """Springs k on equilateral triangles, kept from growing narrow: 3√3/4 k; dampers beside them give the time c/k."""
    pulled = TensileTest(sample(), cells).run([3.0, 1e4])
    stiffness = 0.75 * math.sqrt(3.0) * SPRING
    assert pulled.stiffness == pytest.approx(stiffness, rel=0.015)
    assert pulled.extensions[0] == pytest.approx(3.0 / stiffness, rel=0.015)
    assert pulled.extensions[1] == math.inf, "not within 400 %"
    assert pulled.damping_time == pytest.approx(DAMPER / SPRING, rel=0.02)


def test_a_falling_sheet_ends_where_the_drag_carries_its_weight():
    weight = DENSITY * GRAVITY * 2.0 * FACE
    assert falling_speed(sample()) == pytest.approx(weight / DRAG, rel=2e-3)


def test_a_heavier_fabric_of_the_same_kind_bends_and_falls_alike():
    """A law and its masses multiplied by one number: nothing changes but its loads."""
    light, heavy = sample(), sample(7.0)
    assert bend(heavy, 0.04, 4).angle == pytest.approx(bend(light, 0.04, 4).angle, rel=1e-6)
    assert falling_speed(heavy) == pytest.approx(falling_speed(light), rel=1e-6)
    assert TensileTest(heavy, 2).load(0.02) == pytest.approx(7.0 * TensileTest(light, 2).load(0.02), rel=1e-6)


@pytest.mark.parametrize("cells", [1, 2, 5])
def test_sheets_of_triangles_are_whole(cells):
    mesh, column = triangular_sheet(0.3, 0.2, cells)
    assert mesh.rest_positions.min(axis=0) == pytest.approx([0.0, -0.1, 0.0], abs=1e-7)
    assert mesh.rest_positions.max(axis=0) == pytest.approx([0.3, 0.1, 0.0], abs=1e-7)
    a, b, c = (mesh.rest_positions[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (area > 0).all()
    assert area.sum() == pytest.approx(0.06, rel=1e-5)
    np.testing.assert_allclose(mesh.rest_positions[:, 0], 0.3 / cells * column, atol=1e-7)


def test_the_shadow_of_a_plate_of_cloth_that_hangs_down_and_of_a_cone():
    mesh = disc(0.18, 40, PEDESTAL)
    x = np.array(mesh.rest_positions, np.float64)
    distance = np.hypot(x[:, 0], x[:, 1])
    assert shadow(x, mesh.faces) == pytest.approx(np.pi * 0.18**2, rel=2e-3)
    for slope, coefficient in ((0.0, 1.0), (90.0, 0.0), (60.0, None)):
        angle = math.radians(slope)
        beyond = np.maximum(distance - PEDESTAL, 0.0)
        reach = np.minimum(distance, PEDESTAL) + beyond * math.cos(angle)
        down = np.stack([*(x[:, :2] * (reach / np.maximum(distance, 1e-12))[:, None]).T, -beyond * math.sin(angle)], 1)
        if coefficient is None:
            coefficient = (0.135**2 - PEDESTAL**2) / (0.18**2 - PEDESTAL**2)
        assert Draped(0.18, down, mesh.faces).coefficient == pytest.approx(coefficient, abs=5e-3)
        assert Draped(0.18, down, mesh.faces).folds == 0


@pytest.mark.parametrize("count", [0, 1, 5, 8])
def test_folds_are_counted(count):
    """Also where the curve begins within one; ripples are none."""
    angle = np.linspace(0.0, 2 * np.pi, 240, endpoint=False)
    distance = 0.15 + 0.01 * np.cos(count * angle + 1.0) * (count > 0) + 0.0005 * np.cos(40 * angle)
    assert crests(distance, 0.0036) == count


def test_limp_cloth_drapes_more_than_stiff_cloth():
    limp, stiff = sample(), sample()
    for term in stiff.law.terms[:1]:
        term.law.plane = SplinePlane(np.array([SPRING, 400 * HINGE])[:, None, None], (0, 0), (1.0, 1.0))
    limp, stiff = (drape_test(each, 0.36, 6) for each in (limp, stiff))
    assert 0.1 < limp.coefficient < 0.6
    assert 0.9 < stiff.coefficient <= 1.005
    assert limp.folds >= 3


@pytest.mark.parametrize(
    ("value", "words"),
    [(2.0, "within"), (6.0, "2.00 x the largest"), (0.5, "0.50 x the least"), (math.inf, "never reached")],
)
def test_values_are_judged(value, words):
    assert beside(value, 1.0, 3.0) == words
    assert row("silk", "x", value, [1.0, 3.0, "me"])["judgement"] == words
    assert row("silk", "x", value, None)["judgement"] == row("silk", "x", value, None)["published"] == ""
    assert row("silk", "x", value, None, looked_for=True)["published"] == "none found"
    assert row("silk", "x", value, [1.0, 3.0, "me"], looked_for=True)["published"] == "1 to 3"


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None):
        yield


COARSE = ("measure=fabric_card", "measure.cells={bent: 5, pulled: 2}", "measure.rings=4", "measure.diameters=[0.3]")


def test_a_card_of_a_shipped_law(tmp_path):
    """Coarse, but whole: table, judgement, sources, picture."""
    config = compose("benchmark", [*COARSE, "measure.fabrics=[cotton]"])
    check_config(config, contents="benchmark", supplied={})
    measured = instantiate(config.measure).measure(config)
    found = {each["property"]: each for each in measured.rows}
    assert found["areal density, g/m2"]["law"] == pytest.approx(150.0)
    assert 1.5 < found["bending length, cm"]["law"] < 2.6
    assert 20.0 < found["drape coefficient of 30 cm, %"]["law"] < 90.0
    assert found["bending length, cm"]["source"] == "wang"
    assert "Wang, O'Brien" in measured.note
    assert [path.suffix for path in measured.save(tmp_path)] == [".csv", ".md", ".png"]
    assert (tmp_path / "fabric_cards.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("measure.fabrics=[wool]", r"measure\.fabrics: found 'wool'; expected some of silk, cotton, denim, leather"),
        ("measure.cells.pulled=3", r"measure\.cells\.pulled: found 3; expected an even number"),
        ("~measure.sources.momme", r"measure\.published: found the source 'momme'; expected one of measure\.sources"),
    ],
)
def test_mistakes_are_sentences(override, sentence):
    config = compose("benchmark", [*COARSE, override])
    with pytest.raises(DrapeError, match=sentence):
        instantiate(config.measure).measure(config)


def test_published_properties_are_those_of_the_card():
    """A misspelt one would stand beside nothing."""
    config = compose("benchmark", [*COARSE, "measure.fabrics=[]", "measure.diameters=[0.30,0.36]"])
    card = instantiate(config.measure)
    bent = Bent(0.1, ANGLE, np.zeros((2, 2)), DENSITY)
    known = set(card._values(sample(), bent, [Draped(0.15, np.zeros((7, 3)), np.zeros((1, 3), int))] * 2))
    for fabric, ranges in card.published.items():
        assert fabric in config.fabrics
        assert set(ranges) <= known
        assert all(0 < low <= high for low, high, _ in ranges.values())
