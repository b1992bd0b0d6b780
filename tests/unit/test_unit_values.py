"""Units of energies on edges that can be worked out by hand: what a force costs, what a step loses, when it acts."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.damping import Damping
from drape.energy.law.deformation import StretchHinge
from drape.energy.law.dissipation_speed import SpeedDissipation
from drape.energy.law.eunet import EUNet
from drape.energy.law.hinge_law import FELT, fabrics_damper
from drape.energy.law.potential_hinge import HingePotential
from drape.energy.law.spring_hinge import SpringHingeLaw, force_basis
from drape.energy.law.step_energies import StepEnergies
from drape.energy.law.timing import Timing
from drape.energy.law.units import DissipationUnits
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.unit.test_metric_values import Springs

DT = 0.5
REST = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]], dtype=torch.float64)
TRIANGLE = MeshBatch.from_meshes([ClothMesh.from_faces(REST.float().numpy(), np.array([[0, 1, 2]]))])
"""One face of 2 m²: edges of 2, 2 and √8 m, two at each vertex."""
ONE_EDGE = torch.tensor([[1.0, 1.0, 1.0, 1.0, 1.0]], dtype=torch.float64)


def constant(layers: torch.nn.Module, values: tuple[float, ...]) -> None:
    """Make a network say the same of every fabric."""
    with torch.no_grad():
        layers[-1].weight.zero_()
        layers[-1].bias.copy_(torch.tensor(values))


def damping(coefficients: tuple[float, float], lost: tuple[float, float]) -> Damping:
    """Scales of ¼ m and 2 m/s, an energy of 10 J."""
    made = Damping(8, stretch_scale=0.25, speed_scale=2.0, energy_scale=10.0).double()
    constant(made.coefficients.layers, coefficients)
    constant(made.lost.layers, lost)
    return made


def seen(units: DissipationUnits, x_next: Tensor, x: Tensor = REST) -> Tensor:
    return units.inputs(EdgeGeometry(x_next, TRIANGLE), EdgeGeometry(x, TRIANGLE), DT)


def window(x_prev: Tensor, x: Tensor, x_next: Tensor) -> Window:
    """Of the triangle: vertices of 3 kg, the first one pinned, no gravity."""
    free = torch.tensor([False, True, True])
    attributes = torch.full((1, 5), 4.0, dtype=torch.float64)
    nothing = torch.zeros(3, dtype=torch.float64)
    return Window(TRIANGLE, x_prev, x, x_next, nothing + 3.0, free, attributes, torch.zeros(1).long(), nothing, DT)


# Damping


def test_forces_and_losses_have_coefficients_of_their_own():
    """q = (2, 3): forces 10 (5 · 2² + 7 · 3), losses 10 (11 · 2² + 13 · 3)."""
    potential, lost = damping((5.0, 7.0), (11.0, 13.0)).energies(torch.tensor([[2.0, 3.0]]).double(), ONE_EDGE)
    assert potential.item() == pytest.approx(410.0)
    assert lost.item() == pytest.approx(830.0)


def test_an_axial_rate_is_along_the_edge_as_it_was():
    """Vertex 1 moves by (0.3, 0.4, 0): the edge from 0 grows by 0.3 m along itself, 0.3/0.25 = 1.2."""
    x = REST.clone()
    x[1] += torch.tensor([0.3, 0.4, 0.0])
    edge = [sorted(ends) for ends in TRIANGLE.edges.tolist()].index([0, 1])
    rate, moved = seen(damping((1.0, 1.0), (1.0, 1.0)), x)[edge].tolist()
    assert abs(rate) == pytest.approx(1.2)
    assert moved == pytest.approx(0.25 / (2.0 * 0.5) ** 2 / 2), "half of |Δx|², as two edges share the vertex"


def test_constants_are_those_of_the_forces_in_kilograms_a_second():
    """φd = 10 · 5 (Δl/0.25)² = c/(2 dt) Δl²: c = 2 · 50 · 0.5/0.25²; 10 · 7 |Δx|²/(2 dt)² = d/(2 dt) |Δx|²: d = 70."""
    axial, air = damping((5.0, 7.0), (11.0, 13.0)).constants(ONE_EDGE[0], DT)
    assert axial == pytest.approx(2.0 * 50.0 * 0.5 / 0.25**2)
    assert air == pytest.approx(2.0 * 70.0 / (2.0**2 * 0.5))


def test_dampers_of_the_sampling_are_left_out():
    """Of k dt, 200 N/m in half a second, a tenth."""
    assert fabrics_damper(1.01 * FELT * 100.0, 200.0, DT) == pytest.approx(1.01 * FELT * 100.0)
    assert fabrics_damper(0.99 * FELT * 100.0, 200.0, DT) == 0.0


def test_drag_of_the_paper_goes_with_area_and_a_square():
    """A face of 2 m² at every edge, 0.5 m within half a second: 2 m² · 10 J/m² · net(1 m/s / 4 m/s)²."""
    units = SpeedDissipation(lambda *_, **__: Passes(), speed_scale=4.0, energy_scale=10.0)
    inputs = seen(units, REST + torch.tensor([0.0, 0.0, 0.5]))
    assert inputs.flatten().tolist() == pytest.approx(3 * [1.0, 2.0])
    for part in units.energies(inputs, ONE_EDGE.expand(3, -1)):
        assert part.tolist() == pytest.approx([2.0 * 10.0 * 0.25**2] * 3)


class Passes(torch.nn.Module):
    """A network that says its first input."""

    def forward(self, inputs):
        return inputs[:, :1]


# Potential and timing


def test_a_hinge_potential_stores_a_spring_and_a_hinge():
    """c = (3, 5), scales 0.1 m and 0.5 rad, 10 J: 10 (3² (0.2/0.1)² + 5² (1/0.5)²); its stiffness is twice 10 c²."""
    made = HingePotential(StretchHinge(), 8, stretch_scale=0.1, angle_scale=0.5, energy_scale=10.0).double()
    constant(made.coefficients.base.layers, (3.0, 5.0))
    assert made.energies(torch.tensor([[0.2, 1.0]]).double(), ONE_EDGE).item() == pytest.approx(360.0 + 1000.0)
    assert made.stiffness(torch.zeros(1, 2).double(), ONE_EDGE)[0].tolist() == pytest.approx([180.0, 500.0])


def test_coefficients_see_lengths_and_angles_as_they_grow():
    """asinh of a stretch, the logarithm of one and the square of an angle."""
    made = HingePotential(StretchHinge(), 8, stretch_scale=0.1, angle_scale=0.5, energy_scale=10.0).double()
    asked = []
    made.coefficients.forward = lambda z, attributes: asked.append(z) or torch.ones_like(z)
    made.energies(torch.tensor([[0.2, 1.5]]).double(), ONE_EDGE)
    assert asked[0][0].tolist() == pytest.approx([np.arcsinh(2.0), np.log(10.0)])


def test_weights_of_three_frames_are_in_the_order_of_time():
    made = Timing(StretchHinge(), 8).double()
    constant(made.shares.layers, (0.1, 0.2, 0.3, 0.5))
    assert made(ONE_EDGE)[:, 0].flatten().tolist() == pytest.approx([0.1, 0.2, 0.6, 0.3, 0.3, 0.5])


class Takes(DissipationUnits):
    """1 J of potential and 7 J of loss at each edge, whatever moves."""

    def inputs(self, geometry, previous, dt):
        return torch.stack([geometry.length, previous.length], -1)

    def energies(self, inputs, attributes):
        return 1.0 + 0.0 * inputs[:, 0], 7.0 + 0.0 * inputs[:, 0]


def test_balances_count_what_is_lost_and_forces_what_is_not():
    """Springs of 4 N/m whose edges grow by 10 %: ½ 4 Σ (0.1 l)² = 0.32 J, and 7 J lost at each of three edges."""
    still = window(REST, REST, 1.1 * REST)
    step = StepEnergies(EUNet(Springs(), Takes()), still, training=False)
    assert step.change.item() == pytest.approx(0.5 * 4.0 * 0.01 * (4 + 4 + 8) + 21.0)
    assert step.next.total.sum().item() == pytest.approx(0.32 + 3.0)


def test_with_a_timing_the_potential_is_that_at_t():
    """As without one: frames before, at and after t are stretched by 0, 10 and 20 %."""
    frames, energy = window(REST, 1.1 * REST, 1.2 * REST), EUNet(Springs())
    energy.timing = Timing(StretchHinge(), 8).double()
    step = StepEnergies(energy, frames, training=False)
    assert step.potential.sum().item() == pytest.approx(0.32)
    assert step.change.item() == pytest.approx(3.0 * 0.32)


def test_the_force_residual_is_motion_plus_slope():
    """Edge 0-1 pulls vertex 1 back by 4 N/m · 0.2 m, while it is accelerated by 1 m/s²: 3 - (-0.8); 0 at the pin."""
    x = REST.clone()
    x[1, 0] = 2.2
    moving = window(x + DT**2 * torch.tensor([1.0, 0.0, 0.0]).double(), x, x)
    step = StepEnergies(EUNet(Springs()), moving, training=False)
    lengths = EdgeGeometry(x, TRIANGLE)
    pull = torch.zeros(3, dtype=torch.float64)
    for number, ends in enumerate(TRIANGLE.edges.tolist()):
        if 1 in ends:
            other = x[sum(ends) - 1]
            growth = lengths.length[number] - TRIANGLE.rest_lengths[number]
            pull += 4.0 * growth * (x[1] - other) / lengths.length[number]
    expected = 3.0 * torch.tensor([1.0, 0.0, 0.0]).double() + pull
    torch.testing.assert_close(step.force_residual[1], expected)
    assert step.force_residual[0].tolist() == [0.0, 0.0, 0.0]


# The analytic law


def test_the_basis_of_the_spring_hinge_law_is_in_the_order_of_its_coefficients():
    """Frames stretched by 10, 20 and 30 %: springs in that ratio; v = 0.1 x/dt by the last two frames."""
    basis = force_basis(window(1.1 * REST, 1.2 * REST, 1.3 * REST))[1]
    springs = basis[:3].norm(dim=-1)
    assert (springs / springs[0]).tolist() == pytest.approx([1.0, 2.0, 3.0])
    assert basis[0, 0] < 0, "what is stretched pulls back"
    v = 0.1 * REST[1] / DT
    torch.testing.assert_close(basis[7], -v)
    diagonal = torch.tensor([1.0, -1.0, 0.0], dtype=torch.float64) / 2**0.5
    rates = -0.2 / DT * torch.tensor([1.0, 0.0, 0.0]).double() - 0.1 * 8**0.5 / DT * diagonal
    torch.testing.assert_close(basis[6], rates)


def test_dampers_act_along_edges_as_they_are_at_t():
    """Vertex 1 swings up from (2, 0, 0) to (2, 0, 1): across edges at t, so nothing is damped."""
    x = REST.clone()
    x[1, 2] = 1.0
    assert force_basis(window(REST, REST, x))[1, 6].abs().max() < 1e-12


def test_stiffness_is_the_sum_over_three_frames_and_the_residual_what_is_left():
    law = SpringHingeLaw(torch.tensor([[1.0, 2, 4, 8, 16, 32, 0, 5]], dtype=torch.float64))
    assert law.stiffness.tolist() == [[7.0, 56.0]]
    falling = window(REST, REST, REST + torch.tensor([0.0, 0.0, 0.5]))
    drag = torch.tensor([0.0, 0.0, -5.0 * 0.5 / DT], dtype=torch.float64)
    accelerated = torch.tensor([0.0, 0.0, 3.0 * 0.5 / DT**2], dtype=torch.float64)
    torch.testing.assert_close(law.force_residual(falling)[1], accelerated - drag)
    assert law.force_residual(falling)[0].abs().max() == 0.0
