"""Deformations of edges: the quantities of EdgeGeometry, with derivatives that autograd confirms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from drape.energy.terms.edge_deformation import EdgeDeformation
from drape.energy.terms.edge_scale import WIDEST, EdgeScale
from drape.energy.terms.elastic import ElasticEnergy
from drape.geometry.edge_geometry import EdgeGeometry, subtract_angles
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from tests.conftest import bent
from tests.terms import law, make_step


def test_the_same_quantities_as_in_training(cloth_batch):
    x = bent(cloth_batch.rest_positions, 0.8)
    stretch, alpha, beta = EdgeDeformation(x, cloth_batch, bends=True).q
    geometry, rest = EdgeGeometry(x, cloth_batch), cloth_batch.rest
    torch.testing.assert_close(stretch, geometry.length - cloth_batch.rest_lengths)
    for angle, pair, at_rest in ((alpha, geometry.twist, rest.twist), (beta, geometry.bend, rest.bend)):
        expected = subtract_angles(pair, at_rest)
        torch.testing.assert_close(torch.stack([angle.cos(), angle.sin()], -1), expected, atol=1e-10, rtol=0)


@pytest.mark.parametrize("bends", [True, False])
def test_pull_is_the_derivative(cloth_batch, bends):
    x = bent(cloth_batch.rest_positions, 0.8).requires_grad_()
    deformation = EdgeDeformation(x, cloth_batch, bends=bends)
    slopes = torch.randn_like(deformation.q)
    (expected,) = torch.autograd.grad((deformation.q * slopes).sum(), x)
    found = EdgeDeformation(x.detach(), cloth_batch, bends=bends).pull(slopes)
    torch.testing.assert_close(found, expected, atol=1e-8, rtol=1e-8)


@pytest.mark.parametrize("bends", [True, False])
def test_jacobian_is_the_transpose_of_pull(cloth_batch, bends):
    deformation = EdgeDeformation(bent(cloth_batch.rest_positions, 0.8), cloth_batch, bends=bends)
    slopes = torch.randn_like(deformation.q)
    rows = deformation.jacobian()
    assert len(rows) == (3 if bends else 1)
    pulled = sum(row.T @ slope.numpy() for row, slope in zip(rows, slopes, strict=False))
    np.testing.assert_allclose(pulled.reshape(-1, 3), deformation.pull(slopes).numpy(), atol=1e-9)


@pytest.mark.parametrize("place", ["one point", "one line", "folded", "scrambled", "far away"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_finite_for_every_input(cloth_batch, place, dtype):
    rest = cloth_batch.rest_positions
    x = {
        "one point": torch.zeros_like(rest),
        "one line": rest * torch.tensor([1.0, 0.0, 0.0]),
        "folded": torch.stack([rest[:, 0].abs(), rest[:, 1], 0 * rest[:, 0]], -1),
        "scrambled": torch.randn_like(rest),
        "far away": rest + 1e4,
    }[place].to(dtype)
    deformation = EdgeDeformation(x, cloth_batch, bends=True)
    assert deformation.q.isfinite().all()
    assert deformation.q.dtype == dtype
    assert deformation.pull(torch.ones_like(deformation.q)).isfinite().all()
    assert all(np.isfinite(row.data).all() for row in deformation.jacobian())


@pytest.mark.parametrize("transfer", [False, True])
def test_a_normal_passes_through_the_direction_of_its_edge(transfer):
    """There the twist jumps by half a turn; the energy does not."""
    step, _ = make_step(square_grid(1.0, 4))
    torch.manual_seed(0)
    x = (step.x + 0.3 * torch.randn_like(step.x)).requires_grad_()
    edge = int(EdgeDeformation(x, step.mesh, bends=True).upright.argmin())
    for _ in range(60):  # Newton's method for upright = 0 along its gradient
        upright = EdgeDeformation(x, step.mesh, bends=True).upright[edge]
        (slope,) = torch.autograd.grad(upright, x)
        x = (x - 0.5 * upright * slope / slope.square().sum()).detach().requires_grad_()
    x = x.detach()
    assert EdgeDeformation(x, step.mesh, bends=True).upright[edge] < 1e-5
    across = torch.randn_like(x)
    ends = [EdgeDeformation(x + side * across, step.mesh, bends=True).q[1, edge] for side in (-1e-4, 1e-4)]
    assert abs(ends[1] - ends[0]) > 1.0
    term = ElasticEnergy(law(), transfer=transfer)
    near, far = (
        abs(torch.sub(*(term.energy_and_gradient(x + side * across, step)[0] for side in (-size, size))))
        for size in (1e-5, 1e-4)
    )
    assert far > 0
    assert near < 0.2 * far  # a tenth where there is no cliff


def test_without_bending_no_normal_is_computed(cloth_batch, monkeypatch):
    monkeypatch.setattr(EdgeDeformation, "_sum", property(lambda self: pytest.fail("normals were computed")))
    deformation = EdgeDeformation(bent(cloth_batch.rest_positions), cloth_batch, bends=False)
    assert (deformation.q[1:] == 0).all()
    deformation.pull(deformation.q)


def test_the_mesh_learned_on_has_scale_one():
    mesh = MeshBatch.from_meshes([square_grid(4.8, 22)])
    scale, turns = EdgeScale(mesh, (4.8 / 21) ** 2 / 2).at(torch.ones(3, mesh.num_edges, dtype=torch.float64))
    assert scale == 1.0
    assert turns is None


def test_scale_follows_resolution_and_keeps_angles_within_what_was_learned():
    mesh = MeshBatch.from_meshes([square_grid(4.8, 43)])
    edges = EdgeScale(mesh, (4.8 / 21) ** 2 / 2)
    small = torch.zeros(3, mesh.num_edges, dtype=torch.float64)
    torch.testing.assert_close(edges.at(small)[0], torch.full_like(small[0], 0.5), atol=1e-4, rtol=0)
    wide = torch.full_like(small, 2.5)
    scale, _ = edges.at(wide)
    assert (wide[1:].norm(dim=0) / scale <= WIDEST * (1 + 1e-6)).all()


@pytest.mark.parametrize("axis", [0, 1])
def test_a_strain_costs_the_same_at_every_resolution(axis):
    """The whole cloth, its hems included: 0.5 x, 1 x and 2 x the mesh that the law was learned on."""
    learned, energies = law(), []
    size = 20 * (2.0 * learned.face_area) ** 0.5
    for resolution in (11, 21, 41):
        step, _ = make_step(square_grid(size, resolution))
        x = step.mesh.rest_positions.clone()
        x[:, axis] *= 1.001
        energies.append(ElasticEnergy(learned, transfer=True).energy_and_gradient(x, step)[0])
    torch.testing.assert_close(energies[0], energies[1], rtol=1e-4, atol=0)
    torch.testing.assert_close(energies[2], energies[1], rtol=1e-4, atol=0)


def test_slopes_of_the_scale_are_its_derivatives():
    mesh = MeshBatch.from_meshes([square_grid(1.0, 5)])
    edges = EdgeScale(mesh, 0.1)
    q = torch.randn(3, mesh.num_edges, dtype=torch.float64).requires_grad_()
    scale, turns = edges.at(q)
    (expected,) = torch.autograd.grad(scale.sum(), q)
    torch.testing.assert_close(turns, expected[1:])
    assert (expected[0] == 0).all()
