"""Axial dampers and the drag of the air: what units and term say of known motions, in kg/s, and that they agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from drape.energy.law.damping import Damping
from drape.energy.law.edge_law import NetworkLaw
from drape.energy.law.eunet import EUNet
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.step import Step
from drape.energy.terms.hinge_elastic import Damping as DampingTerm
from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.energies import make_energy
from tests.terms import hinges, make_step

VECTOR = torch.linspace(0.1, 0.9, 5, dtype=torch.float64)
DT = 1.0 / 25.0
DAMPER, DRAG = 300.0, 0.2


def units(axial: float = 0.0, air: float = 0.0, lost: tuple[float, float] = (0.0, 0.0)) -> Damping:
    """With coefficients that are the same for every fabric."""
    made = Damping(16, stretch_scale=0.01, speed_scale=2.0, energy_scale=0.1).double()
    with torch.no_grad():
        for part, values in ((made.coefficients, (axial, air)), (made.lost, lost)):
            part.layers[-1].weight.zero_()
            part.layers[-1].bias.copy_(torch.tensor(values))
    return made


def of_constants(damper: float, drag: float) -> Damping:
    """With what makes a damper and a drag [kg/s] out of its scales."""
    axial, air = damper * 0.01**2 / (2 * 0.1 * DT), drag * 2.0**2 * DT / (2 * 0.1)
    return units(axial, air, (2.0 * axial, 2.0 * air))


def evaluated(made: Damping, x: Tensor, x_next: Tensor, mesh: MeshBatch) -> tuple[Tensor, Tensor]:
    """φd and what is lost, of each edge."""
    seen = made.inputs(EdgeGeometry(x_next, mesh), EdgeGeometry(x, mesh), DT)
    return made.energies(seen, VECTOR.expand(len(seen), -1))


def test_constants_are_in_kilograms_a_second():
    assert of_constants(DAMPER, DRAG).constants(VECTOR, DT) == pytest.approx((DAMPER, DRAG))


def test_a_cloth_that_moves_as_a_whole_loses_by_drag_alone(cloth_batch):
    """½ d v² dt of each vertex, and twice that is lost; a damper feels nothing of it."""
    x = cloth_batch.rest_positions
    moved = torch.tensor([0.01, 0.02, -0.03], dtype=torch.float64)
    energy, lost = evaluated(of_constants(DAMPER, DRAG), x, x + moved, cloth_batch)
    expected = 0.5 * DRAG * len(x) * float(moved.square().sum()) / DT
    assert energy.sum().item() == pytest.approx(expected, rel=1e-6)
    assert lost.sum().item() == pytest.approx(2.0 * expected, rel=1e-6)
    for part in evaluated(of_constants(DAMPER, 0.0), x, x + moved, cloth_batch):
        assert part.abs().max() < 1e-12


def test_an_edge_that_grows_loses_by_its_damper():
    """½ c (dl/dt)² dt of each edge, along its direction before the step; turning it costs nothing to first order."""
    mesh = MeshBatch.from_meshes([ClothMesh.from_faces(_triangle().numpy(), np.array([[0, 1, 2]]))])
    made, x = of_constants(DAMPER, 0.0), _triangle()
    energy, lost = evaluated(made, x, 1.02 * x, mesh)
    expected = 0.5 * DAMPER * (0.02 * EdgeGeometry(x, mesh).length).square() / DT
    torch.testing.assert_close(energy, expected, rtol=1e-6, atol=0.0)
    torch.testing.assert_close(lost, 2.0 * expected, rtol=1e-6, atol=0.0)
    for angle in (1e-3, 2e-3):
        turned = x + angle * torch.stack([-x[:, 1], x[:, 0], x[:, 2]], 1)
        assert evaluated(made, x, turned, mesh)[0].max() < 1e-12


def _triangle() -> Tensor:
    return torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 2.0, 0.0]], dtype=torch.float64)


def test_every_vertex_has_the_same_drag(cloth_batch):
    """Whether two edges meet there, as in one corner of the grid, or six, as inside: the force is d v."""
    x = cloth_batch.rest_positions
    moved = 0.01 * torch.randn_like(x)
    x_next = (x + moved).requires_grad_()
    (gradient,) = torch.autograd.grad(evaluated(of_constants(0.0, DRAG), x, x_next, cloth_batch)[0].sum(), x_next)
    torch.testing.assert_close(gradient, DRAG * moved / DT, rtol=1e-6, atol=1e-12)
    assert set(torch.bincount(cloth_batch.edges.reshape(-1)).tolist()) == {2, 3, 4, 6}


def test_a_leading_axis_is_a_batch_of_motions(cloth_batch):
    rest, made = cloth_batch.rest_positions, of_constants(DAMPER, DRAG)
    frames = rest + 0.01 * torch.randn(3, *rest.shape, dtype=torch.float64)
    both = made.inputs(EdgeGeometry(frames[1:], cloth_batch), EdgeGeometry(frames[:-1], cloth_batch), DT)
    for k in range(2):
        one = made.inputs(EdgeGeometry(frames[k + 1], cloth_batch), EdgeGeometry(frames[k], cloth_batch), DT)
        torch.testing.assert_close(both[k], one)


@pytest.mark.parametrize("dt", [DT, 0.01])
def test_the_term_of_a_solver_has_the_energy_of_the_units(dt):
    """The same φd for the same motion; with steps of another length the same dampers."""
    step, x_next = make_step(square_grid(1.0, 6))
    step = replace(step, dt=DT)
    energy = EUNet(make_energy("hinge", "none").potential, of_constants(DAMPER, DRAG))
    law = NetworkHinges(energy, VECTOR, face_area=0.01, dt=DT)
    assert (law.damper, law.drag) == pytest.approx((DAMPER, DRAG))
    learned = evaluated(of_constants(DAMPER, DRAG), step.x, x_next, step.mesh)[0].sum()
    found = DampingTerm(law, transfer=False)(x_next, replace(step, dt=dt))
    torch.testing.assert_close(found, (DT / dt * learned)[None], rtol=1e-6, atol=0.0)


@pytest.mark.parametrize(("potential", "dissipation"), [("hinge", "speed"), ("mlp", "damping"), ("mlp", "none")])
def test_hinges_are_told_apart_from_units_that_no_solver_knows_dampers_of(potential, dissipation):
    with pytest.raises(DrapeError, match=r"expected HingePotential and Damping.*model/dissipation=damping or zero"):
        NetworkHinges(make_energy(potential, dissipation), VECTOR, face_area=0.01, dt=DT)


def test_the_papers_law_takes_only_the_papers_drag():
    with pytest.raises(DrapeError, match=r"found units Damping .*model/dissipation=speed or zero"):
        NetworkLaw(make_energy("mlp", "damping"), face_area=0.01, dt=DT)
    assert not NetworkLaw(make_energy("mlp", "none"), face_area=0.01, dt=DT).dissipates


def dragged(step: Step, *, transfer: bool) -> Tensor:
    """The forces of the air on a cloth that moves as a whole, by 1 cm along x in a step."""
    law = hinges()
    moved = torch.tensor([0.01, 0.0, 0.0], dtype=torch.float64)
    return -DampingTerm(law, transfer=transfer).energy_and_gradient(step.x + moved, step)[1][:, 0]


def test_drag_goes_with_the_area_of_a_vertex():
    """Finer cloths of the same size meet nearly the same drag as a whole; each cloth of a batch has its own."""
    meshes = [square_grid(1.0, 11), square_grid(1.0, 21)]
    law, ((step, _), *alone) = hinges(), [make_step(*some) for some in (meshes, meshes[:1], meshes[1:])]
    speed = 0.01 / step.dt
    for transfer in (False, True):
        both = dragged(step, transfer=transfer).split([121, 441])
        for found, mesh, (single, _) in zip(both, meshes, alone, strict=True):
            share = 1.0 / mesh.num_faces / law.face_area if transfer else 1.0
            expected = torch.full((mesh.num_vertices,), -law.drag * share * speed, dtype=torch.float64)
            torch.testing.assert_close(found, expected, rtol=1e-5, atol=0.0)
            torch.testing.assert_close(dragged(single, transfer=transfer), found)


def test_a_term_that_saw_another_cloth_forgets_it():
    term, other = DampingTerm(hinges(), transfer=True), DampingTerm(hinges(), transfer=True)
    steps = [make_step(square_grid(size, count)) for size, count in ((1.0, 5), (0.5, 5), (2.0, 4))]
    for step, x_next in steps:
        torch.testing.assert_close(term(x_next, step), DampingTerm(other.law, transfer=True)(x_next, step))
