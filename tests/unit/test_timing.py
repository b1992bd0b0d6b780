"""At which frames forces act: frames that a known spring explains leave no residual, with its weights alone."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.damping import Damping
from drape.energy.law.deformation import Stretch, StretchHinge
from drape.energy.law.eunet import EUNet
from drape.energy.law.potential_hinge import HingePotential
from drape.energy.law.step_energies import StepEnergies
from drape.energy.law.timing import SHARE, Timing
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh_batch import MeshBatch
from drape.loss.force_residual import ForceResidual
from tests.energies import make_energy, make_window

SHARES = {"stretch": (0.1, 0.3), "stretch_hinge": (0.1, 0.05, 0.3, 0.2)}
"""Of the forces at t-1, then of those at t+1, for each feature."""
STIFFNESS = (30.0, 0.5)
"""Of springs [N/m] and of hinges [N m/rad]."""


def constant(layers: torch.nn.Module, values: tuple[float, ...]) -> None:
    """Make a network say the same of every fabric."""
    with torch.no_grad():
        layers[-1].weight.zero_()
        layers[-1].bias.copy_(torch.tensor(values))


def quadratic(deformation: str, shares: tuple[float, ...], drag: float = 0.0) -> EUNet:
    """½ k Δl² + ½ b Δθ² at three frames, and a drag [kg/s] at the last."""
    seen = Stretch() if deformation == "stretch" else StretchHinge()
    potential = HingePotential(seen, 8, stretch_scale=0.01, angle_scale=0.2, energy_scale=0.1).double()
    scaled = [(0.5 * k * scale**2 / 0.1) ** 0.5 for k, scale in zip(STIFFNESS, potential.scales, strict=False)]
    constant(potential.coefficients.base.layers, tuple(scaled))
    damping = Damping(8, stretch_scale=0.01, speed_scale=2.0, energy_scale=0.1).double()
    constant(damping.coefficients.layers, (0.0, drag * 2.0**2 / 30.0 / (2 * 0.1)))
    timing = Timing(seen, 8).double()
    constant(timing.shares.layers, shares)
    return EUNet(potential, damping, timing)


def pulls(x: Tensor, mesh: MeshBatch) -> list[Tensor]:
    """Forces of springs and of hinges [N], each from its own energy."""
    x = x.detach().requires_grad_()
    geometry = EdgeGeometry(x, mesh)
    stretch = geometry.length - mesh.rest_lengths
    energies = [0.5 * STIFFNESS[0] * stretch.square().sum(), 0.5 * STIFFNESS[1] * geometry.hinge_change.square().sum()]
    return [-torch.autograd.grad(energy, x, retain_graph=True)[0] for energy in energies]


def explained(mesh: MeshBatch, deformation: str, shares: tuple[float, ...], drag: float = 0.0) -> Window:
    """A window whose last frame follows from the others by forces weighted in time, found by substitution."""
    window = make_window(mesh)
    window = replace(window, free=torch.ones_like(window.free))
    features = len(shares) // 2
    before, after = shares[:features], shares[features:]
    known = [
        sum(w * f for w, f in zip(weights, pulls(x, mesh), strict=False))
        for weights, x in ((before, window.x_prev), ([1 - b - a for b, a in zip(before, after, strict=True)], window.x))
    ]
    mass, start, x_next = window.mass[:, None], 2 * window.x - window.x_prev, window.x
    for _ in range(60):
        force = sum(w * f for w, f in zip(after, pulls(x_next, mesh), strict=False)) + sum(known)
        force = force - drag * (x_next - window.x) / window.dt + mass * window.gravity
        found = start + window.dt**2 * force / mass
        change, x_next = (found - x_next).abs().max(), found
    assert change < 1e-13, "the test has found no such frame"
    return replace(window, x_next=x_next)


@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("deformation", SHARES)
def test_frames_that_known_weights_explain_leave_no_residual(deformation, training, small_cloth):
    """To rounding with these weights; with others, with other springs or with another drag there is one."""
    mesh, shares = MeshBatch.from_meshes([small_cloth]), SHARES[deformation]
    window = explained(mesh, deformation, shares, drag=0.4)
    size = window.inertial_force.abs().max()
    energy = quadratic(deformation, shares, drag=0.4)
    assert StepEnergies(energy, window, training=training).force_residual.abs().max() < 1e-6 * size
    for k in range(len(shares)):
        others = tuple(share + 0.05 * (i == k) for i, share in enumerate(shares))
        wrong = StepEnergies(quadratic(deformation, others, drag=0.4), window, training=training)
        assert wrong.force_residual.abs().max() > 1e-4 * size
    energy.timing = None
    assert StepEnergies(energy, window, training=training).force_residual.abs().max() > 1e-2 * size
    without = quadratic(deformation, shares)
    assert StepEnergies(without, window, training=training).force_residual.abs().max() > 1e-2 * size


def test_all_at_the_last_frame_is_as_without(cloth_batch):
    """Weights 0, 0, 1 are backward Euler: what an energy without timing assumes."""
    window, timed = make_window(cloth_batch), make_energy("hinge", "damping", timed=True)
    constant(timed.timing.shares.layers, (0.0, 0.0, 1.0, 1.0))
    without = copy.deepcopy(timed)
    without.timing = None
    found, expected = (StepEnergies(energy, window, training=False).gradient for energy in (timed, without))
    torch.testing.assert_close(found, expected)


def test_weights_add_up_to_one():
    """For every fabric and every feature; before anything is learned they are nearly those of many steps a frame."""
    timing, attributes = Timing(StretchHinge(), 16).double(), torch.rand(50, 5, dtype=torch.float64)
    weights = timing(attributes)
    assert weights.shape == (3, 50, 2)
    torch.testing.assert_close(weights.sum(0), torch.ones(50, 2, dtype=torch.float64))
    assert weights.std(1).min() > 1e-3, "fabrics must differ"
    constant(timing.shares.layers, (SHARE,) * 4)
    assert (timing(attributes)[[0, 2]] - SHARE).abs().max() < 1e-6


def test_the_graph_reaches_all_parameters_in_training(small_cloth):
    """The loss on forces and its slope along a random direction of the parameters of each part, by differences."""
    energy, window = make_energy("hinge", "damping", timed=True), make_window(MeshBatch.from_meshes([small_cloth]))
    loss = ForceResidual(1.0, bend=1.0)

    def value() -> Tensor:
        return loss(StepEnergies(energy, window, training=True))

    parts = {"timing": energy.timing, "potential": energy.potential.coefficients}
    parts["dissipation"] = energy.units["dissipation"].coefficients
    for part in parts.values():
        parameters = list(part.parameters())
        directions = [torch.randn_like(parameter) for parameter in parameters]
        slopes = torch.autograd.grad(value(), parameters, allow_unused=True)
        expected = sum((s * d).sum() for s, d in zip(slopes, directions, strict=True) if s is not None)
        ends = []
        for h in (1e-6, -2e-6, 1e-6):
            with torch.no_grad():
                for parameter, direction in zip(parameters, directions, strict=True):
                    parameter.add_(h * direction)
            ends.append(value())
        assert expected.abs() > 1e-4
        torch.testing.assert_close((ends[0] - ends[1]) / 2e-6, expected, rtol=1e-4, atol=0.0)


def test_outside_training_there_is_no_graph_to_the_parameters(small_cloth):
    energy, window = make_energy("hinge", "damping", timed=True), make_window(MeshBatch.from_meshes([small_cloth]))
    exact = StepEnergies(energy, window, training=True).gradient
    found = StepEnergies(energy, window, training=False).gradient
    torch.testing.assert_close(found, exact)
    slopes = torch.autograd.grad(found.sum(), list(energy.parameters()), allow_unused=True)
    assert [slope for slope in slopes if slope is not None] == []
