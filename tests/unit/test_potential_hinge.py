"""Potential units of springs and hinges: known values, symmetries, what they refuse."""

from __future__ import annotations

import copy

import pytest
import torch

from drape.energy.law.deformation import Stretch, StretchBending, StretchHinge
from drape.energy.law.potential_hinge import HingePotential
from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from tests.conftest import bent
from tests.energies import SEEN, make_energy

ATTRIBUTES = torch.linspace(0.1, 0.9, 5, dtype=torch.float64).expand(300, -1)
either = pytest.mark.parametrize("deformation", SEEN["hinge"])


def inputs(deformation: str, count: int = 300) -> torch.Tensor:
    """From a thousandth of the scales to a thousand times them, of both signs."""
    q = torch.randn(count, 2, dtype=torch.float64) * 10.0 ** (6.0 * torch.rand(count, 1, dtype=torch.float64) - 3.0)
    return (q * torch.tensor([0.01, 0.2], dtype=torch.float64))[:, : 2 if deformation == "stretch_hinge" else 1]


def test_before_anything_is_learned_it_is_a_spring_and_a_hinge():
    """Of coefficient 1: energy_scale (z² + y²), as soon as the network that sees the fabric says nothing."""
    units = HingePotential(StretchHinge(), 16, stretch_scale=0.01, angle_scale=0.2, energy_scale=0.1).double()
    with torch.no_grad():
        units.coefficients.base.layers[-1].weight.zero_()
    q = torch.tensor([[0.02, 0.0], [0.0, 0.4], [-0.01, 0.2], [0.0, 0.0]], dtype=torch.float64)
    expected = torch.tensor([0.4, 0.4, 0.2, 0.0], dtype=torch.float64)
    torch.testing.assert_close(units.energies(q, ATTRIBUTES[:4]), expected)


@either
def test_zero_at_rest_and_never_negative(deformation):
    units, q = make_energy("hinge", "none", deformation).potential, inputs(deformation)
    rest = torch.zeros_like(q).requires_grad_()
    energy = units.energies(rest, ATTRIBUTES)
    (slope,) = torch.autograd.grad(energy.sum(), rest)
    assert not energy.any()
    assert not slope.any()
    found = units.energies(q, ATTRIBUTES)
    assert found.dtype == torch.float64
    assert (found > 0.0).all()


def test_both_sides_of_a_fabric_are_the_same():
    """Even in Δθ; not in Δl: a stretched edge is not a compressed one."""
    units, q = make_energy("hinge", "none").potential, inputs("stretch_hinge")
    energy = units.energies(q, ATTRIBUTES)
    for signs, same in (([1.0, -1.0], True), ([-1.0, 1.0], False)):
        other = units.energies(q * torch.tensor(signs, dtype=torch.float64), ATTRIBUTES)
        assert torch.allclose(other, energy, rtol=1e-12) == same


@either
def test_energy_goes_with_its_scale(deformation):
    units, q = make_energy("hinge", "none", deformation).potential, inputs(deformation)
    double = copy.deepcopy(units)
    double.energy_scale *= 2.0
    torch.testing.assert_close(double.energies(q, ATTRIBUTES), 2.0 * units.energies(q, ATTRIBUTES))


@either
def test_lengths_and_angles_count_in_their_scales(deformation):
    """The same energy where everything is twice as long, twice as wide, and measured so."""
    units, q = make_energy("hinge", "none", deformation).potential, inputs(deformation)
    double = copy.deepcopy(units)
    double.scales = tuple(2.0 * scale for scale in units.scales)
    torch.testing.assert_close(double.energies(2.0 * q, ATTRIBUTES), units.energies(q, ATTRIBUTES))


@either
def test_stiffness_is_what_the_energy_is_made_of(deformation):
    """φp = ½ K z² + ½ B y² with K and B at (asinh z, ln(1 + y²)); at rest they are the second derivatives."""
    units, q = make_energy("hinge", "none", deformation).potential, inputs(deformation)
    z = q / torch.tensor(units.scales, dtype=torch.float64)
    seen = torch.cat([z[:, :1].asinh(), (1.0 + z[:, 1:].square()).log()], 1)
    expected = 0.5 * (units.stiffness(seen, ATTRIBUTES) * z.square()).sum(1)
    torch.testing.assert_close(units.energies(q, ATTRIBUTES), expected, rtol=1e-6, atol=0.0)
    rest = torch.zeros(1, q.shape[1], dtype=torch.float64)
    hessian = torch.autograd.functional.hessian(lambda x: units.energies(x, ATTRIBUTES[:1]).sum(), rest)[0, :, 0]
    at_rest = units.stiffness(rest, ATTRIBUTES[:1])[0] / torch.tensor(units.scales, dtype=torch.float64).square()
    torch.testing.assert_close(hessian, at_rest.diag())


def test_turning_all_faces_over_changes_nothing(cloth):
    """The winding of the faces says which side is up, and the energy does not ask."""
    units, found = make_energy("hinge", "none").potential, []
    for faces in (cloth.faces, cloth.faces[:, ::-1]):
        mesh = MeshBatch.from_meshes([ClothMesh.from_faces(cloth.rest_positions, faces)])
        seen = units.inputs(EdgeGeometry(bent(mesh.rest_positions), mesh))
        found.append(units.energies(seen, ATTRIBUTES[:1].expand(len(seen), -1)).sum())
    torch.testing.assert_close(*found)


def test_other_deformations_are_refused():
    with pytest.raises(DrapeError, match=r"found StretchBending, expected model/deformation=stretch_hinge or stretch"):
        HingePotential(StretchBending(), 16, 0.01, 0.2, 0.1)
    assert HingePotential(Stretch(), 16, 0.01, 0.2, 0.1).scales == (0.01,)
