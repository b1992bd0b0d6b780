"""What holds for every learned energy, whatever it is made of."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
import torch

from drape.energy.law.dissipation_speed import SpeedDissipation
from drape.energy.law.edge_law import NetworkLaw
from drape.energy.law.eunet import EUNet
from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.energies import ENERGIES, NET, SEEN, make_energy, make_window

family = pytest.mark.parametrize(("potential", "dissipation", "deformation"), ENERGIES)


def evaluate(energy, window, x_next=None, x=None):
    x_next = window.x_next if x_next is None else x_next
    return energy(x_next, window.x if x is None else x, window.mesh, window.attributes, window.dt)


@family
def test_derivatives(potential, dissipation, deformation, small_cloth):
    """First and second derivatives in the positions agree with finite differences, and are not zero."""
    window = make_window(MeshBatch.from_meshes([small_cloth]))
    energy = make_energy(potential, dissipation, deformation)
    x = window.x_next.clone().requires_grad_()
    assert torch.autograd.grad(evaluate(energy, window, x).sum(), x)[0].norm() > 1e-3
    assert torch.autograd.gradcheck(lambda x: evaluate(energy, window, x), x, fast_mode=True)
    assert torch.autograd.gradgradcheck(lambda x: evaluate(energy, window, x), x, fast_mode=True, atol=1e-3)


@family
def test_rigid_motion_changes_nothing(potential, dissipation, deformation, cloth_batch):
    """The energy of a step is the same after turning and moving the whole scene."""
    window, energy = make_window(cloth_batch), make_energy(potential, dissipation, deformation)
    rotation, _ = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))
    rotation = rotation * torch.det(rotation)
    moved = [x @ rotation.T + torch.tensor([1.0, -2.0, 3.0]) for x in (window.x_next, window.x)]
    torch.testing.assert_close(evaluate(energy, window, *moved), evaluate(energy, window), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("potential", "deformation"), [(p, f) for p, d, f in ENERGIES if d == "none"])
def test_internal_forces_have_no_sum(potential, deformation, cloth_batch):
    """The potential part pushes the cloth as a whole nowhere and turns it nowhere."""
    window, energy = make_window(cloth_batch), make_energy(potential, "none", deformation)
    x = window.x_next.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(evaluate(energy, window, x).sum(), x)
    size = gradient.norm()
    assert gradient.sum(0).norm() < 1e-9 * size
    assert torch.linalg.cross(window.x_next, gradient).sum(0).norm() < 1e-9 * size


@family
def test_batch_is_as_single(potential, dissipation, deformation, cloth, small_cloth):
    """Two meshes of different size in one batch have the energies that they have alone, and do not see each other."""
    energy = make_energy(potential, dissipation, deformation)
    # the scale below which lengths count as degenerate is that of the batch: irrelevant at this tolerance
    both = make_window(MeshBatch.from_meshes([cloth, small_cloth]))
    x = both.x_next.clone().requires_grad_()
    energies = evaluate(energy, both, x)
    (gradient,) = torch.autograd.grad(energies[0], x)
    count = cloth.num_vertices
    assert gradient[:count].norm() > 0
    assert gradient[count:].norm() == 0
    for number, (mesh, part) in enumerate(((cloth, slice(0, count)), (small_cloth, slice(count, None)))):
        one = MeshBatch.from_meshes([mesh])
        alone = energy(both.x_next[part], both.x[part], one, both.attributes[number : number + 1], both.dt)
        torch.testing.assert_close(energies[number : number + 1], alone, rtol=1e-8, atol=1e-8)


@family
def test_order_of_vertices_does_not_matter(potential, dissipation, deformation, cloth, cloth_batch):
    """Renumbering vertices and faces leaves the energy as it is."""
    window, energy = make_window(cloth_batch), make_energy(potential, dissipation, deformation)
    order = torch.randperm(cloth.num_vertices)
    place = torch.argsort(order).numpy()
    renumbered = ClothMesh.from_faces(cloth.rest_positions[order.numpy()], place[cloth.faces][::-1])
    mesh = MeshBatch.from_meshes([renumbered])
    found = energy(window.x_next[order], window.x[order], mesh, window.attributes, window.dt)
    torch.testing.assert_close(found, evaluate(energy, window), rtol=1e-9, atol=1e-9)


@family
def test_single_precision_is_close(potential, dissipation, deformation, cloth_batch):
    """Parameters in float32 give the energy change and the forces of float64 to 0.1 %."""
    window, energy = make_window(cloth_batch), make_energy(potential, dissipation, deformation)
    exact, rounded = (StepEnergies(e, window, training=False) for e in (energy, copy.deepcopy(energy).float()))
    assert (exact.gradient - rounded.gradient).norm() < 1e-3 * exact.gradient.norm()
    assert (exact.change - rounded.change).abs().max() < 1e-3 * exact.next.total.abs().sum()


@family
def test_finite_on_degenerate_input(potential, dissipation, deformation, cloth_batch):
    """Folded, flattened and collapsed cloth has finite energies, forces and second derivatives."""
    window, energy = make_window(cloth_batch), make_energy(potential, dissipation, deformation)
    rest = cloth_batch.rest_positions
    folded = torch.stack([rest[:, 0].abs(), rest[:, 1], rest[:, 2]], -1)
    line = rest * torch.tensor([1.0, 0.0, 0.0])
    merged = window.x_next.clone()
    merged[0] = merged[1]
    for x in (folded, line, torch.zeros_like(rest), merged, rest):
        x = x.clone().requires_grad_()
        value = evaluate(energy, window, x, x.detach()).sum()
        (gradient,) = torch.autograd.grad(value, x, create_graph=True)
        (second,) = torch.autograd.grad((gradient * torch.randn_like(gradient)).sum(), x)
        assert torch.isfinite(value)
        assert torch.isfinite(gradient).all()
        assert torch.isfinite(second).all()


@family
def test_forces_through_inputs_are_the_gradient(potential, dissipation, deformation, cloth_batch):
    """The short way that training takes gives the same forces and the same gradients of the parameters."""
    window, energy = make_window(cloth_batch), make_energy(potential, dissipation, deformation)
    x = window.x_next.clone().requires_grad_()
    (plain,) = torch.autograd.grad(evaluate(energy, window, x).sum(), x, create_graph=True)
    short = StepEnergies(energy, window, training=True).gradient
    torch.testing.assert_close(short, plain, rtol=1e-9, atol=1e-9)
    parameters = list(energy.parameters())
    for_short = torch.autograd.grad(short.square().sum(), parameters, allow_unused=True)
    for_plain = torch.autograd.grad(plain.square().sum(), parameters, allow_unused=True)
    compared = 0
    for a, b in zip(for_short, for_plain, strict=True):
        assert (a is None) == (b is None)
        if a is not None:
            torch.testing.assert_close(a, b, rtol=1e-7, atol=1e-8)
            compared += 1
    assert compared > 5


@pytest.mark.parametrize("deformation", SEEN["hinge"])
def test_hinges_are_zero_at_rest_and_never_negative(deformation, cloth_batch):
    """φp(rest) = 0 with zero force, φp >= 0 anywhere."""
    energy, window = make_energy("hinge", "none", deformation), make_window(cloth_batch)
    rest = cloth_batch.rest_positions.clone().requires_grad_()
    value = evaluate(energy, window, rest, rest.detach()).sum()
    (gradient,) = torch.autograd.grad(value, rest)
    assert value.item() < 1e-12
    assert gradient.abs().max() < 1e-9
    crumpled = cloth_batch.rest_positions + 0.3 * torch.randn_like(cloth_batch.rest_positions)
    for x in (window.x, crumpled):
        energies = StepEnergies(energy, replace(window, x=x), training=False).potential
        assert energies.min() >= 0
        assert energies.max() > 1e-3


def test_nothing_is_lost_where_nothing_moves(cloth_batch):
    """A cloth that stands still: no energy of dissipation, no force, nothing lost; one that moves: some of each."""
    energy, window = make_energy("hinge", "damping"), make_window(cloth_batch)
    without = make_energy("hinge", "none")
    without.load_state_dict({k: v for k, v in energy.state_dict().items() if "dissipation" not in k})
    for x_next, moves in ((window.x, False), (window.x_next, True)):
        both, alone = (StepEnergies(e, replace(window, x_next=x_next), training=False) for e in (energy, without))
        differences = both.next.total - alone.next.total, both.next.balance - alone.next.balance
        for found in (*differences, both.gradient - alone.gradient):
            assert (found.abs().max() > 1e-4) == moves
            assert moves or found.abs().max() < 1e-9


def test_an_ablated_part_does_not_exist(cloth_batch, monkeypatch):
    """Without dissipation there are no parameters for it; without bending no normal is ever computed."""
    bare = make_energy("mlp", "none", "stretch")
    assert not bare.dissipates
    assert not any("dissipation" in name for name, _ in bare.named_parameters())

    def forbidden(_):
        raise AssertionError("normals computed for an energy without bending")

    monkeypatch.setattr(EdgeGeometry, "vertex_normals", property(forbidden))
    assert torch.isfinite(evaluate(bare, make_window(cloth_batch))).all()


def test_the_face_of_a_boundary_edge_counts_as_often_as_it_is_told(cloth_batch):
    window = make_window(cloth_batch)
    lost = {}
    for count in (1.0, 2.0):
        torch.manual_seed(0)
        units = SpeedDissipation(NET, speed_scale=1.0, energy_scale=0.1, boundary_faces=count).double()
        before, after = EdgeGeometry(window.x, cloth_batch), EdgeGeometry(window.x_next, cloth_batch)
        lost[count], _ = units.energies(units.inputs(after, before, window.dt), window.edge_attributes)
    boundary = cloth_batch.boundary
    torch.testing.assert_close(lost[2.0][boundary], 2.0 * lost[1.0][boundary])
    torch.testing.assert_close(lost[2.0][~boundary], lost[1.0][~boundary])
    with pytest.raises(DrapeError, match="counts the faces of boundary edges twice"):
        NetworkLaw(EUNet(make_energy("mlp", "none").potential, units), face_area=1.0, dt=1.0)
