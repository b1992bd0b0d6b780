"""A law at another weight: forces grow as masses do, so the cloth moves as the one learned from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra

from drape.config import instantiate
from drape.config.entry_point import CONF
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.law.baked.baking import Resolution, bake
from drape.energy.law.edge_law import NetworkLaw
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.law.scaled_law import at_density, learned_density
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.solver.implicit import ImplicitSolver
from tests.energies import make_energy

SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)
SIZE = 0.78 * 7 / 21


@pytest.fixture(scope="module", autouse=True)
def _hydra():
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF), version_base=None):
        yield


def swinging(fabric, density: float) -> np.ndarray:
    """The last of five frames of a sheet that swings down from two corners, its faces those learned on [m]."""
    mesh = square_grid(SIZE, 8)
    x = np.asarray(mesh.rest_positions, np.float64)
    mass = np.full(mesh.num_vertices, density * (SIZE / 7) ** 2)
    gravity = np.array([0.0, 0.0, -9.81])
    scene = Scene("swinging", mesh, State.at_rest(x), SILK, mass, gravity, 1 / 30, 5, pins=Pins.fixed([0, 7], x))
    potential = IncrementalPotential.for_scene(scene, fabric.terms)
    solver, state = ImplicitSolver(potential, scene, fabric.attributes, iterations=400), scene.initial
    for frame in range(5):
        state = solver.step(state, frame).state
    return state.x


@pytest.mark.parametrize("energy", ["eunet_baked_garment", "eunet"])
def test_cloth_of_any_weight_moves_as_the_one_learned_from(energy):
    """Also what damps it; a law that is not scaled moves otherwise."""
    source = ["energy.checkpoint=${shipped:eunet_garment.ckpt}"] if energy == "eunet" else []
    node = compose("animate", ["scene=hanging", f"energy={energy}", *source]).energy
    heavy = learned_density(SILK, 0.5 * (0.78 / 21) ** 2)
    assert heavy == pytest.approx(0.15 / (0.78 / 21) ** 2)
    learned = swinging(instantiate(node), heavy)
    light = instantiate(node, areal_density=0.08)
    assert len(light.terms) == 2, "springs and hinges, and what damps them"
    fallen = np.abs(learned - square_grid(SIZE, 8).rest_positions).max()
    assert np.abs(swinging(light, 0.08) - learned).max() < 2e-3 * fallen
    assert np.abs(swinging(instantiate(node), 0.08) - learned).max() > 0.05 * fallen


def test_scenes_say_what_the_cloth_weighs():
    """Of areal densities the law hears; masses of vertices, as Blender has them, leave it as it was learned."""
    for overrides, density in (
        (["scene=person", "fabric=denim"], 0.4),
        (["scene=person", "scene.mass.areal_density=0.2"], 0.2),
        (["scene=hanging"], None),
        (["scene=held_out"], None),
        (["scene=custom", "energy=eunet", "fabric=leather"], 0.8),
    ):
        assert compose("animate", overrides).energy.areal_density == density
    for scene in ("person", "custom"):
        assert "eunet_garment_silk" in compose("animate", [f"scene={scene}"]).energy.table
        assert "table" not in compose("animate", [f"scene={scene}", "energy=phys"]).energy, "the user's word is last"


def doubled(law):
    return at_density(law, SILK, 2.0 * learned_density(SILK, law.face_area))


def test_laws_are_scaled_in_all_that_they_say():
    """Energy, slopes and curvatures, dampers and drags; of networks and of tables."""
    torch.manual_seed(3)
    vector = torch.full((5,), 0.02, dtype=torch.float64)
    q = torch.randn(9, 3, dtype=torch.float64) * 0.1
    hinges = NetworkHinges(make_energy("hinge", "damping").requires_grad_(False), vector, 0.01, 1 / 30)
    hinges.damper, hinges.drag = 2.0, 0.3
    for law in (hinges, bake(hinges, Resolution((-1.0, 4.0), 0.25), fabric=SILK)):
        for one, two in zip(law.slopes(q[:, :2]), doubled(law).slopes(q[:, :2]), strict=True):
            torch.testing.assert_close(2.0 * one, two)
        assert (doubled(law).damper, doubled(law).drag) == (4.0, 0.6)
        assert (law.damper, law.drag) == (2.0, 0.3), "the law itself stays as it was"
    edges, vectors = NetworkLaw(make_energy("mlp", "speed").requires_grad_(False), 0.01, 1 / 30), vector.expand(9, -1)
    before = edges.potential_slopes(q, vectors, hessian=True), edges.drag_slopes(q[:, 0].abs(), vectors)
    edges = doubled(edges)
    after = edges.potential_slopes(q, vectors, hessian=True), edges.drag_slopes(q[:, 0].abs(), vectors)
    for one, two in zip((*before[0], *before[1]), (*after[0], *after[1]), strict=True):
        torch.testing.assert_close(2.0 * one, two)


def test_a_weight_that_is_none_is_refused():
    node = compose("animate", ["scene=person"]).energy
    with pytest.raises(DrapeError, match=r"energy\.areal_density: found -0\.1; expected kg/m2, more than 0"):
        instantiate(node, areal_density=-0.1)
    with pytest.raises(DrapeError, match=r"fabric silk: areal_density: found 0\.0; expected kg/m2"):
        replace(SILK, areal_density=0.0)
