"""Cloths of springs and hinges: known energies, transfer to other resolutions, and laws without hinges."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from drape.energy import fabric
from drape.energy.law.deformation import Stretch, StretchBending
from drape.energy.law.edge_law import NetworkLaw, StretchOnly
from drape.energy.law.hinge_law import HingeLaw, WithoutHinges
from drape.energy.step import Step
from drape.energy.terms.bending import Bending
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from tests.energies import make_energy
from tests.terms import assembled, baked, hinges, make_step

LAWS = {"network": hinges, "baked": baked}
every_law = pytest.mark.parametrize("name", LAWS)


class Quadratic(HingeLaw):
    """½ k Δl² + ½ b Δθ²."""

    def __init__(self, k: float = 200.0, b: float = 0.3):
        super().__init__(0.02, 0.0, 0.0)
        self.k, self.b = k, b

    def potential(self, q: Tensor) -> Tensor:
        return 0.5 * (self.k * q[:, 0].square() + self.b * q[:, 1].square())


def rolled(rest: Tensor, columns: int, curvature: float) -> Tensor:
    """A flat grid bent about its columns to a prism of this curvature [1/m]: nothing else is deformed."""
    width = float(rest[:, 0].max() - rest[:, 0].min()) / (columns - 1)
    angle = curvature * width * torch.arange(columns - 1, dtype=torch.float64)
    x, z = (torch.cat([torch.zeros(1).double(), width * part.cumsum(0)]) for part in (angle.cos(), angle.sin()))
    column = torch.arange(len(rest)) % columns
    return torch.stack([x[column], rest[:, 1], z[column]], 1)


@pytest.mark.parametrize("degrees", [-170.0, -90.0, 20.0, 100.0])
@pytest.mark.parametrize("size", [1.0, 1.1])
def test_two_triangles(degrees, size):
    """Energy and forces of a folded and stretched pair, by hand."""
    theta, law = math.radians(degrees), Quadratic()
    rest = np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0], [0.5, 1, 0.0]])
    step, _ = make_step(ClothMesh.from_faces(rest, np.array([[0, 1, 2], [0, 3, 1]])))
    x = torch.tensor(rest)
    x[3, 1:] = torch.tensor([math.cos(theta), math.sin(theta)], dtype=torch.float64)
    x = size * x
    energy, gradient = HingeElastic(law, transfer=False).energy_and_gradient(x, step)
    lengths = (size - 1.0) * np.array([1.0, *[math.sqrt(1.25)] * 4])
    assert energy.item() == pytest.approx(0.5 * 200.0 * (lengths**2).sum() + 0.5 * 0.3 * theta**2, rel=1e-6)
    # the far corner turns about the edge, at a distance of `size`, by the moment of the hinge
    along = torch.tensor([0.0, -math.sin(theta), math.cos(theta)], dtype=torch.float64)
    assert float(gradient[3] @ along) == pytest.approx(0.3 * theta / size, rel=1e-6)


@pytest.mark.parametrize("name", [*LAWS, "bending"])
def test_a_motion_through_half_a_turn(name):
    """Energies go on where they were, highest at half a turn; forces are finite, and turn over once, behind it."""
    rest = np.array([[0, 0, 0], [1, 0, 0], [0.5, -1, 0], [0.5, 1, 0.0]])
    step, _ = make_step(ClothMesh.from_faces(rest, np.array([[0, 1, 2], [0, 3, 1]])))
    term = Bending() if name == "bending" else HingeElastic(LAWS[name](), transfer=False)
    energies, moments = [], []
    beyond = np.array([-2e-4, -1e-4, -1e-6, -1e-15, 0.0, 1e-15, 1e-6, 1e-4, 2e-4])
    for theta in np.pi + beyond:
        x = torch.tensor(rest)
        x[3, 1:] = torch.tensor([math.cos(theta), math.sin(theta)], dtype=torch.float64)
        energy, gradient = term.energy_and_gradient(x, step)
        energies.append(energy.item())
        moments.append(float(gradient[3] @ torch.tensor([0.0, -math.sin(theta), math.cos(theta)]).double()))
    size = abs(moments[0])
    np.testing.assert_allclose(energies, energies[4] - size * np.abs(beyond), rtol=1e-7)
    np.testing.assert_allclose(moments, size * np.where(beyond < 1e-5, 1.0, -1.0), rtol=1e-3)


def test_springs_and_hinges_at_rest_are_known():
    """The Hessian of the flat square: off the plane hinges alone are felt, in it springs alone."""
    step, _ = make_step(square_grid(1.0, 5))
    rest = step.mesh.rest_positions
    for law, plane, off in ((Quadratic(b=0.0), True, False), (Quadratic(k=0.0), False, True)):
        matrix = assembled(HingeElastic(law, transfer=False).stencils(rest, step), 25).view(25, 3, 25, 3)
        assert (matrix[:, :2, :, :2].abs().max() > 1e-2) == plane
        assert (matrix[:, 2, :, 2].abs().max() > 1e-2) == off
        assert matrix[:, :2, :, 2].abs().max() < 1e-6


@every_law
@pytest.mark.parametrize("strain", [-0.1, 0.001, 0.3])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_strain_costs_the_same_at_every_resolution(name, strain, axis):
    """The whole cloth, its hems included: coarser than what was learned on, like it, twice and four times as fine."""
    law, energies = LAWS[name](), []
    for resolution in (6, 11, 21):
        step, _ = make_step(square_grid(2.0, resolution))
        x = step.mesh.rest_positions.clone()
        x[:, axis] *= 1.0 + strain
        energies.append(HingeElastic(law, transfer=True).energy_and_gradient(x, step)[0])
        same = HingeElastic(law, transfer=False).energy_and_gradient(x, step)[0]
        assert torch.allclose(same, energies[-1], rtol=1e-4) == (resolution == 11)
    for energy in energies:
        torch.testing.assert_close(energy, energies[1], rtol=1e-5, atol=0)


@every_law
@pytest.mark.parametrize("curvature", [0.05, 2.0, -4.0])
def test_a_curvature_costs_the_same_at_every_resolution(name, curvature):
    """Per area, away from the borders across the roll, at which no edge can bend."""
    law, densities = LAWS[name](), []
    for resolution in (11, 21):
        step, _ = make_step(square_grid(1.0, resolution))
        x = rolled(step.mesh.rest_positions, resolution, curvature)
        energy, _ = HingeElastic(law, transfer=True).energy_and_gradient(x, step)
        densities.append(energy.item() / ((resolution - 2) / (resolution - 1)))
    assert densities[0] == pytest.approx(densities[1], rel=1e-5)
    assert densities[0] > 1e-6


@every_law
def test_two_meshes_of_a_batch_have_scales_of_their_own(name):
    """The coarse one in a batch with the fine one stores what it stores alone."""
    meshes, law = [square_grid(1.0, 4), square_grid(1.0, 9)], LAWS[name]()
    step, x_next = make_step(*meshes)
    both = HingeElastic(law, transfer=True).energy_and_gradient(x_next, step)[0]
    for energy, mesh in zip(both, meshes, strict=True):
        alone, x = make_step(mesh)
        torch.testing.assert_close(HingeElastic(law, transfer=True).energy_and_gradient(x, alone)[0], energy[None])


@every_law
@pytest.mark.parametrize("transfer", [False, True])
def test_without_hinges_a_roll_costs_nothing(name, transfer):
    """And a strain what it costs with them."""
    step, _ = make_step(square_grid(1.0, 7))
    rest, full = step.mesh.rest_positions, LAWS[name]()
    alone, whole = (HingeElastic(law, transfer=transfer) for law in (WithoutHinges(full), full))
    x = rolled(rest, 7, 3.0)
    assert alone.energy_and_gradient(x, step)[0] < 1e-9
    assert whole.energy_and_gradient(x, step)[0] > 1e-3
    x = rest * torch.tensor([1.2, 1.0, 1.0], dtype=torch.float64)
    found, expected = (term.energy_and_gradient(x, step) for term in (alone, whole))
    assert found[0] > 1e-3
    for part, other in zip(found, expected, strict=True):
        torch.testing.assert_close(part, other)


def test_a_face_without_area_does_not_bend():
    """Its corner on the edge: nothing of a hinge, whatever its angle at rest; for the compiled law too."""
    rest = np.array([[0, 0, 0], [0.5, 0, 0], [0.2, -0.4, 0.1], [0.3, 0.4, 0.2]])
    step, _ = make_step(ClothMesh.from_faces(rest, np.array([[0, 1, 2], [0, 3, 1]])))
    x = step.mesh.rest_positions.clone()
    x[3] = 0.5 * (x[0] + x[1])
    alone, *whole = (HingeElastic(law, transfer=False) for law in (WithoutHinges(hinges()), hinges()))
    for term in whole:
        for found, expected in zip(term.energy_and_gradient(x, step), alone.energy_and_gradient(x, step), strict=True):
            torch.testing.assert_close(found, expected)
    table = HingeElastic(baked(), transfer=False).energy_and_gradient(x, step)
    expected = HingeElastic(WithoutHinges(baked()), transfer=False).energy_and_gradient(x, step)
    for one, other in zip(table, expected, strict=True):
        torch.testing.assert_close(one, other)


def test_terms_of_a_law():
    """A law of hinges has its own terms; damping where there is some, hinges unless the cloth shall not feel them."""
    law = hinges()
    elastic, damping = fabric._terms(law, True, None)
    assert isinstance(elastic, HingeElastic)
    assert isinstance(damping, Damping)
    assert (elastic.law, damping.law, elastic.transfer, damping.transfer) == (law, law, True, True)
    assert fabric._terms(law, True, StretchBending())[0].law is law
    bare, damping = fabric._terms(law, False, Stretch())
    assert isinstance(bare.law, WithoutHinges)
    assert (damping.law.damper, damping.law.drag) == (law.damper, law.drag)
    law.drag = 0.0
    assert len(fabric._terms(law, False, None)) == 2
    law.damper = 0.0
    assert len(fabric._terms(law, False, None)) == 1
    papers = NetworkLaw(make_energy("mlp", "speed"), 0.02, 0.05)
    assert [term.name for term in fabric._terms(papers, True, None)] == ["elastic", "dissipation"]
    assert isinstance(fabric._terms(papers, True, Stretch())[0].law, StretchOnly)


@pytest.mark.parametrize("transfer", [False, True])
def test_the_drag_of_a_sheet_that_is_carried_along(transfer):
    """``N d/(2 dt) |u|²`` for N vertices; d goes with the area of a face where it is transferred."""
    law, u = Quadratic(), torch.tensor([0.3, -0.4, 1.2], dtype=torch.float64)
    law.drag = 0.2
    step, _ = make_step(square_grid(1.0, 5))
    drag = 0.2 * (1.0 / 32 / law.face_area if transfer else 1.0)
    assert_damps(Damping(law, transfer=transfer), step, step.x + u, 25 * 0.5 * drag / step.dt * 1.69)


def test_the_damper_of_a_triangle_that_grows():
    """``c/(2 dt) Σ (0.1 l)²`` over its edges of 3, 4 and 5 m, each of which grows along itself."""
    law, corners = Quadratic(), np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])
    law.damper = 7.0
    step, _ = make_step(ClothMesh.from_faces(corners, np.array([[0, 1, 2]])))
    step = replace(step, x=step.mesh.rest_positions)
    expected = 0.5 * 7.0 / step.dt * 0.01 * (9 + 16 + 25)
    assert_damps(Damping(law, transfer=False), step, 1.1 * step.x, expected)


def assert_damps(term: Damping, step: Step, x_next: Tensor, energy: float) -> None:
    """All ways to ask for the energy; the forces take twice of it, as of everything that grows with a square."""
    power, gradient = term.energy_and_gradient(x_next, step)
    compiled = term.kernel(step)(x_next.numpy())[0]
    assert [float(term(x_next, step)), float(power), float(compiled)] == pytest.approx([energy] * 3, rel=1e-9)
    assert float((gradient * (x_next - step.x)).sum()) == pytest.approx(2.0 * energy, rel=1e-9)
