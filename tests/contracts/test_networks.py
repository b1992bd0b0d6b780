"""What every network of a simulator promises: those of conf/model/network/, at their smallest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hydra import compose
from torch import Tensor, nn

from drape.config import instantiate, set_statistics
from drape.config.resolvers import CONF
from drape.energy.step import Step
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from tests.composing import composing
from tests.terms import make_step, moved

STATISTICS = {"vertex_speed": 1.0, "vertex_acceleration": 10.0, "edge_length": 0.14, "vertex_mass": 0.2}
GRAVITY = torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64)


@pytest.fixture(scope="module", params=sorted(path.stem for path in (CONF / "model" / "network").glob("*.yaml")))
def network(request) -> nn.Module:
    """With random numbers in every parameter, so that no part of it is silent."""
    choice = f"model/network@model.network.network={request.param}"
    with composing():
        config = compose("train", ["model=mgn", choice, "scale=smoke"])
    set_statistics(STATISTICS)
    torch.manual_seed(0)
    made = instantiate(config.model.network.network)
    set_statistics(None)
    with torch.no_grad():
        for parameter in made.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return made


def uneven(resolution: int) -> ClothMesh:
    """A square without ties between neighbours."""
    mesh = square_grid(1.0, resolution)
    x = mesh.rest_positions + 0.02 * np.random.default_rng(resolution).uniform(-1, 1, mesh.rest_positions.shape)
    return ClothMesh.from_faces(x, mesh.faces)


def step_of(*resolutions: int) -> Step:
    return replace(make_step(*map(uneven, resolutions))[0], gravity=GRAVITY)


def assert_same(found: Tensor, expected: Tensor) -> None:
    assert expected.norm(dim=-1).max() > 1e-3, "a prediction of zeros would pass any test"
    assert (found - expected).norm(dim=-1).max() < 1e-3 * expected.norm(dim=-1).max()


def test_its_acceleration_turns_about_the_vertical_and_moves_with_the_scene(network):
    step, (c, s) = step_of(8), (math.cos(2.0), math.sin(2.0))
    turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    found = network(moved(step, turn, torch.tensor([5.0, -3.0, 2.0], dtype=torch.float64)))
    expected = network(step)
    assert_same(found, expected @ turn.T.to(expected))


def test_a_cloth_moves_alone_as_in_a_batch(network):
    both = network(step_of(6, 8))
    assert_same(both[:36], network(step_of(6)))
    assert_same(both[36:], network(step_of(8)))


def test_it_feels_the_body_and_does_without(network):
    step = step_of(8)
    alone = network(replace(step, obstacle=None))
    assert torch.isfinite(alone).all()
    assert (alone - network(step)).norm(dim=-1).max() > 1e-3


def test_it_reads_what_the_cloth_is_made_of(network):
    step = step_of(8)
    other = replace(step, attributes=step.attributes.flip(-1))
    assert (network(other) - network(step)).norm(dim=-1).max() > 1e-3


def test_it_can_learn(network):
    network(step_of(6)).square().sum().backward()
    slopes = [parameter.grad for parameter in network.parameters() if parameter.grad is not None]
    network.zero_grad()
    assert all(torch.isfinite(slope).all() for slope in slopes)
    assert sum(float(slope.norm()) > 0 for slope in slopes) > len(slopes) / 2
