"""Energy terms where the answer is known (docs/sources.md, Known values)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.phys_material import THICKNESS, PhysMaterial
from drape.energy.terms.bending import Bending
from drape.energy.terms.free_motion import ExternalForce, Gravity, Inertia
from drape.energy.terms.stvk import StVK
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from tests.terms import assembled, converted, make_step

HEIGHT = math.sqrt(3.0) / 2.0
TRIANGLE = ClothMesh.from_faces(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
HINGE = ClothMesh.from_faces(
    np.array([[0.0, 0, 0], [0, 1, 0], [-HEIGHT, 0.5, 0], [HEIGHT, 0.5, 0]]), np.array([[0, 1, 2], [1, 0, 3]])
)
"""Two unit equilateral triangles, normals along +z."""


def opened(angle: float) -> torch.Tensor:
    """The hinge with its fourth vertex turned down, away from the normals."""
    x = torch.from_numpy(HINGE.rest_positions.copy())
    x[3] = torch.tensor([HEIGHT * math.cos(angle), 0.5, -HEIGHT * math.sin(angle)])
    return x


def test_stretched_triangle():
    """A h (μ + λ/2) ((s² - 1)/2)² at 10 % stretch."""
    step, x = make_step(TRIANGLE)
    x = step.mesh.rest_positions * torch.tensor([1.1, 1.0, 1.0])
    energy = StVK(shear_modulus=2.36e4, first_lame=4.44e4, thickness=4.7e-4)(x, step)
    assert energy.item() == pytest.approx(0.118662, abs=5e-7)


@pytest.mark.parametrize("angle", [0.3, -0.3, 3.1, -3.1])
def test_bent_hinge(angle):
    """k θ²/(4 √3) of two unit equilateral triangles, up to nearly complete folds on both sides."""
    step, _ = make_step(HINGE)
    energy = Bending(3.96e-5)(opened(angle), step)
    assert energy.item() == pytest.approx(3.96e-5 * angle**2 / (4.0 * math.sqrt(3.0)), rel=1e-8)
    if abs(angle) == 0.3:
        assert energy.item() == pytest.approx(5.14419e-7, rel=1e-5)


def test_curved_rest_state_is_kept():
    """A hinge made with an angle has no energy there, and that of the difference elsewhere, across the fold too."""
    made = ClothMesh.from_faces(opened(2.0).numpy(), HINGE.faces)
    step, _ = make_step(made)
    term = Bending(3.96e-5)
    energy, gradient = term.energy_and_gradient(opened(2.0), step)
    assert energy.item() < 1e-20
    assert gradient.norm() < 1e-15
    for angle in (2.3, 1.7, 3.3):
        expected = 3.96e-5 * (angle - 2.0) ** 2 / (4.0 * math.sqrt(3.0))
        assert term(opened(angle), step).item() == pytest.approx(expected, rel=1e-7)


def test_bending_of_a_fold_is_finite_and_pulls_nowhere_wrong():
    """Half a turn stores π² and its gradient is finite."""
    step, _ = make_step(HINGE)
    energy, gradient = Bending(3.96e-5).energy_and_gradient(opened(math.pi), step)
    assert energy.item() == pytest.approx(3.96e-5 * math.pi**2 / (4.0 * math.sqrt(3.0)), rel=1e-6)
    assert torch.isfinite(gradient).all()


def test_a_collapsed_hinge_has_no_angle():
    """What is left of the angle of faces a billionth of their size is rounding; it counts as zero."""
    step, _ = make_step(HINGE)
    energy, gradient = Bending(3.96e-5).energy_and_gradient(1e-9 * opened(2.0), step)
    assert energy.item() < 1e-30
    assert gradient.norm() < 1e-12


def test_membrane_stiffness_is_never_too_small(small_cloth):
    """Under compression the stencils bound the Hessian from above; in tension they are it (contract)."""
    step, _ = make_step(small_cloth)
    term = StVK()
    x = step.mesh.rest_positions * torch.tensor([0.7, 1.1, 1.0]) + 0.02 * torch.randn(9, 3)
    hessian = torch.autograd.functional.hessian(lambda x: term(x, step).sum(), x).reshape(27, 27)
    excess = torch.linalg.eigvalsh(assembled(term.stencils(x, step), 9) - hessian)
    assert excess[0] > -1e-9 * hessian.abs().max()
    assert excess[-1] > 1e-3 * hessian.abs().max()


def test_free_fall_is_the_minimum_of_inertia_and_weight():
    """x + dt v + dt² (g + f/m): implicit Euler of a free cloth in a constant force."""
    step, _ = make_step(square_grid(1.0, 5))
    acceleration = step.gravity + step.external_force / step.mass[:, None]
    x = step.x + step.dt * step.v + step.dt**2 * acceleration
    total = sum(term.energy_and_gradient(x, step)[1] for term in (Inertia(), Gravity(), ExternalForce()))
    assert total.abs().max() < 1e-12


def test_slow_motion_far_away_is_not_rounded_off():
    """Single precision at 100 m: x + dt v is x for 0.1 mm/s, and still a cloth held at x feels its inertia, m v/dt."""
    step, _ = make_step(square_grid(1.0, 5))
    step = converted(replace(step, x=step.x + 100.0, v=torch.full_like(step.v, 1e-4)), torch.float32)
    _, gradient = Inertia().energy_and_gradient(step.x, step)
    torch.testing.assert_close(gradient, -step.mass[:, None] * step.v / step.dt)


def test_weight_of_a_lifted_cloth():
    """m g h, and forces times ways."""
    step, _ = make_step(square_grid(1.0, 5))
    step = replace(step, gravity=torch.tensor([0.0, 0.0, -10.0], dtype=torch.float64))
    lifted = step.x + torch.tensor([5.0, 0.0, 2.0])
    assert Gravity()(lifted, step).item() == pytest.approx(20.0 * step.mass.sum().item())
    work = step.external_force[:, 0].sum() * 5.0 + step.external_force[:, 2].sum() * 2.0
    assert ExternalForce()(lifted, step).item() == pytest.approx(-work.item())


def test_no_force_no_term():
    step, x = make_step(TRIANGLE)
    with pytest.raises(DrapeError, match="no external force"):
        ExternalForce()(x, replace(step, external_force=None))


@pytest.mark.parametrize(
    "make",
    [
        lambda: StVK(shear_modulus=0.0),
        lambda: StVK(first_lame=-3e4),
        lambda: StVK(thickness=-1.0),
        lambda: Bending(0.0),
    ],
)
def test_materials_without_a_rest_state_are_refused(make):
    with pytest.raises(DrapeError, match="expected"):
        make()


# A number for each mesh of a batch

SOFT = PhysMaterial(0.1, 17000.0, 9000.0, 2e-6)
STIFF = PhysMaterial(0.5, 61000.0, 80000.0, 9e-4)


def per_mesh(*materials: PhysMaterial) -> list:
    """The terms of several materials, one for each mesh of a batch."""
    _, shear, lame, bending = torch.tensor(materials, dtype=torch.float64).unbind(-1)
    return [StVK(shear, lame, THICKNESS), Bending(bending)]


@pytest.mark.parametrize("which", [0, 1], ids=["stvk", "bending"])
@pytest.mark.parametrize("materials", [(SOFT, STIFF), (STIFF, SOFT)], ids=["soft first", "stiff first"])
def test_a_batch_of_two_materials_is_the_two_alone(which, materials, cloth, small_cloth):
    step, x_next = make_step(cloth, small_cloth)
    term = per_mesh(*materials)[which]
    energy, gradient = term.energy_and_gradient(x_next, step)
    matrix = assembled(term.stencils(x_next, step), len(x_next))
    parts = (slice(0, cloth.num_vertices), slice(cloth.num_vertices, len(x_next)))
    for number, (mesh, part) in enumerate(zip((cloth, small_cloth), parts, strict=True)):
        one, end = make_step(mesh)
        alone = materials[number].terms()[which]
        expected, forces = alone.energy_and_gradient(end, one)
        torch.testing.assert_close(energy[number : number + 1], expected, rtol=1e-8, atol=0.0)
        torch.testing.assert_close(term(x_next, step)[number : number + 1], expected, rtol=1e-8, atol=0.0)
        assert (gradient[part] - forces).norm() < 1e-8 * forces.norm()
        rows = slice(3 * part.start, 3 * part.stop)
        hessian = assembled(alone.stencils(end, one), len(end))
        assert (matrix[rows, rows] - hessian).abs().max() <= 1e-8 * hessian.abs().max()


@pytest.mark.parametrize("which", [0, 1], ids=["stvk", "bending"])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_fast_gradient_of_two_materials_is_that_of_autograd(which, dtype, cloth, small_cloth):
    step, x_next = make_step(cloth, small_cloth, dtype=dtype)
    term = per_mesh(SOFT, STIFF)[which].to(dtype)
    x = x_next.clone().requires_grad_()
    energy = term(x, step)
    (gradient,) = torch.autograd.grad(energy.sum(), x)
    fast_energy, fast = term.energy_and_gradient(x, step)
    tolerance = 1e-9 if dtype == torch.float64 else 1e-4
    torch.testing.assert_close(fast_energy, energy.detach(), rtol=tolerance, atol=0.0)
    assert fast.dtype == dtype
    assert (fast - gradient).norm() < tolerance * gradient.norm()


def test_energies_are_differentiable_in_the_material_and_fast_ones_hold_no_graph(small_cloth):
    step, x_next = make_step(small_cloth, small_cloth)
    numbers = torch.tensor([SOFT, STIFF], dtype=torch.float64)
    scale = numbers.mean(0)

    def energies(shear, lame, bending, x):
        return StVK(shear * scale[1], lame * scale[2])(x, step) + 1e4 * Bending(bending * scale[3])(x, step)

    inputs = [(numbers / scale)[:, k].clone().requires_grad_() for k in (1, 2, 3)]
    assert torch.autograd.gradcheck(energies, [*inputs, x_next.requires_grad_()], atol=1e-6, rtol=1e-5)
    for term in (StVK(inputs[0], inputs[1]), Bending(inputs[2])):
        assert not any(value.requires_grad for value in term.energy_and_gradient(x_next, step))
        assert not any(piece.blocks.requires_grad for piece in term.stencils(x_next, step))


def test_numbers_for_other_meshes_than_those_of_the_batch_are_refused(small_cloth):
    step, x_next = make_step(small_cloth)
    for term in per_mesh(SOFT, STIFF):
        with pytest.raises(DrapeError, match="found 2 numbers for a batch of 1 meshes; expected one for each"):
            term(x_next, step)


@pytest.mark.parametrize("make", [
    lambda bad: StVK(bad, torch.ones(2)), lambda bad: StVK(torch.ones(2), bad - 1.5), Bending,
], ids=["shear", "lame", "bending"])  # fmt: skip
def test_one_mesh_without_a_rest_state_is_enough_to_be_refused(make):
    with pytest.raises(DrapeError, match="expected"):
        make(torch.tensor([1.0, 0.0]))


def test_prices_of_motions_are_not_stored():
    step, x = make_step(square_grid(0.5, 4))
    found = IncrementalPotential([Inertia(), Gravity(), Bending(1e-3)]).evaluate(x, step)
    assert found.terms["inertia"] > 0.0
    assert found.stored == pytest.approx(found.terms["gravity"] + found.terms["bending"])
