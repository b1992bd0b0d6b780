"""Materials of PHYS: positions within HOOD's ranges, draws, and terms."""

from __future__ import annotations

import pytest
import torch

from drape.energy.phys_material import RANGES, PhysMaterial, material_numbers

SOFT = PhysMaterial(0.1, 17000.0, 9000.0, 2e-6)
STIFF = PhysMaterial(0.5, 61000.0, 80000.0, 9e-4)


def test_positions_are_0_and_1_at_the_ends_and_come_back():
    low, high = (PhysMaterial(*(getattr(r, end) for r in RANGES.values())) for end in ("low", "high"))
    torch.testing.assert_close(low.inputs(), torch.zeros(4, dtype=torch.float64))
    torch.testing.assert_close(high.inputs(), torch.ones(4, dtype=torch.float64))
    for material in (SOFT, STIFF, PhysMaterial.default()):
        assert tuple(PhysMaterial.at(material.inputs())) == pytest.approx(tuple(material), rel=1e-9)


def test_scales_of_the_positions():
    """The middle is the geometric mean of a logarithmic range, the mean of λ's."""
    middle = PhysMaterial.at(torch.full((4,), 0.5, dtype=torch.float64))
    assert middle.shear_modulus == pytest.approx((15909 * 63636) ** 0.5)
    assert middle.first_lame == pytest.approx((3535.4144 + 93333.7351) / 2, rel=1e-6)
    assert middle.areal_density == pytest.approx((4.34e-2 * 7e-1) ** 0.5)
    assert middle.bending_stiffness == pytest.approx((6.370782e-08 * 1.313974e-03) ** 0.5, rel=1e-6)


def test_draws_fill_the_ranges_and_repeat_with_the_seed():
    """Means of uniform draws lie in the middle: that of log μ and log k, of λ itself, of ρ itself."""
    generator = torch.Generator().manual_seed(0)
    drawn = torch.tensor([PhysMaterial.sampled(generator) for _ in range(2000)], dtype=torch.float64)
    for column, (name, logarithmic) in enumerate(
        {"areal_density": False, "shear_modulus": True, "first_lame": False, "bending_stiffness": True}.items()
    ):
        scale = RANGES[name]._replace(is_logarithmic=logarithmic)
        share = scale.position(drawn[:, column])
        assert 0.0 <= share.min() < 0.01
        assert 0.99 < share.max() <= 1.0
        assert share.mean() == pytest.approx(0.5, abs=0.02)
    assert PhysMaterial.sampled(torch.Generator().manual_seed(0)) == tuple(drawn[0].tolist())


def test_terms_have_the_numbers():
    stvk, bending = SOFT.terms()
    assert (stvk.shear_modulus, stvk.first_lame, stvk.thickness) == (17000.0, 9000.0, 4.7e-4)
    assert bending.stiffness == 2e-6


def test_numbers_are_differentiable_in_the_positions():
    positions = torch.rand(3, 4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: material_numbers(p) / torch.tensor(SOFT), positions)
