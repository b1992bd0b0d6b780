"""The membrane energy of PHYS: a St. Venant-Kirchhoff sheet."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils
from drape.energy.terms.per_mesh import PerMesh, everywhere, hold, of_pieces
from drape.errors import DrapeError
from drape.geometry.corners import dot
from drape.geometry.rest_shape import RestFaces


class _Strain(NamedTuple):
    f1: Float[Tensor, "3 faces"]
    f2: Float[Tensor, "3 faces"]
    trace: Float[Tensor, " faces"]
    """G11 + G22"""
    difference: Float[Tensor, " faces"]
    """G11 - G22"""
    shear: Float[Tensor, " faces"]
    """2 G12"""


class _Moduli(NamedTuple):
    """For all faces, or for each; times A h, in joules."""

    shear: Float[Tensor, " faces"]
    """μ"""
    bulk: Float[Tensor, " faces"]
    """μ + λ"""


class StVK(EnergyTerm):
    """``Σ_faces A h (μ tr(G²) + λ/2 tr(G)²)`` [J] with ``G = (FᵀF - I)/2``, A the rest area (docs/sources.md, HOOD).

    Written as a sum of squares, ``A h/2 ((μ + λ) (G11 + G22)² + μ ((G11 - G22)² + (2 G12)²))``. F = D_s D_m⁻¹ is the
    deformation gradient from the rest positions; no quantity is divided by the deformed size, so collapsed faces
    are as good as any. The defaults are HOOD's.

    Args:
        shear_modulus: μ [Pa]; one number, or one for each mesh of the batch.
        first_lame: λ [Pa], likewise.
        thickness: h [m].

    Raises:
        DrapeError: ``μ <= 0``, ``μ + λ <= 0`` (the sheet would have no rest state) or ``h <= 0``.
    """

    name = "stvk"
    shear_modulus: PerMesh
    first_lame: PerMesh

    def __init__(self, shear_modulus: PerMesh = 23600.0, first_lame: PerMesh = 44400.0, thickness: float = 4.7e-4):
        super().__init__()
        if not (everywhere(shear_modulus > 0) and everywhere(shear_modulus + first_lame > 0) and thickness > 0):
            raise DrapeError(
                f"energy term stvk: shear_modulus {shear_modulus} Pa, first_lame {first_lame} Pa, thickness "
                f"{thickness} m; expected shear_modulus > 0, shear_modulus + first_lame > 0 and thickness > 0"
            )
        hold(self, "shear_modulus", shear_modulus)
        hold(self, "first_lame", first_lame)
        self.thickness = thickness

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        rest = step.mesh.rest_faces
        energies = _energies(_strain(x_next, rest), self._moduli(step, x_next.dtype))
        return step.sum_stencils(energies, step.mesh.faces[:, 0])

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        rest = step.mesh.rest_faces
        strain = _strain(x_next.detach(), rest)
        a, b, d = (number.to(x_next.dtype) for number in (rest.a, rest.b, rest.d))
        moduli = _detached(self._moduli(step, x_next.dtype))
        s11, s22, s12 = _stress(strain, moduli)
        p1, p2 = s11 * strain.f1 + s12 * strain.f2, s12 * strain.f1 + s22 * strain.f2
        first, second = a * p1 + b * p2, d * p2
        gradient = rest.corners.scatter(torch.cat([-(first + second), first, second]), len(x_next))
        return step.sum_stencils(_energies(strain, moduli), step.mesh.faces[:, 0]), gradient

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> list[Stencils]:
        """``Σ_strains (∂G)ᵀ C ∂G + S₊ ⊗ I`` of each face, S₊ the tensile part of the stress.

        The Hessian with S in the place of S₊: exact in tension, never less than the Hessian under compression.
        """
        rest = step.mesh.rest_faces
        strain = _strain(x_next.detach(), rest)
        a, b, d = (number.to(x_next.dtype) for number in (rest.a, rest.b, rest.d))
        corner1 = torch.stack([-a, a, torch.zeros_like(a)])
        corner2 = torch.stack([-(b + d), b, d])
        along1, along2 = (corner1[:, None] * strain.f1).flatten(0, 1), (corner2[:, None] * strain.f2).flatten(0, 1)
        sheared = (corner2[:, None] * strain.f1 + corner1[:, None] * strain.f2).flatten(0, 1)
        moduli = _detached(self._moduli(step, x_next.dtype))
        root, roots = moduli.bulk.sqrt(), moduli.shear.sqrt()
        blocks = x_next.new_zeros(9, 9, len(rest.area))
        for row in (root * (along1 + along2), roots * (along1 - along2), roots * sheared):
            blocks.addcmul_(row[:, None], row)
        t11, t22, t12 = _tensile(*_stress(strain, moduli))
        spread = corner2[:, None] * corner2 * t22 + corner1[:, None] * corner1 * t11
        mixed = corner1[:, None] * corner2 * t12
        spread = spread + mixed + mixed.transpose(0, 1)
        blocks = blocks.view(3, 3, 3, 3, -1)
        for axis in range(3):
            blocks[:, axis, :, axis] += spread
        return [Stencils(rest.corners.vertices, blocks.permute(4, 0, 1, 2, 3))]

    def _moduli(self, step: Step, dtype: torch.dtype) -> _Moduli:
        weight = (self.thickness * step.mesh.rest_faces.area).to(dtype)
        shear, lame = (of_pieces(v, step, step.mesh.faces[:, 0], dtype) for v in (self.shear_modulus, self.first_lame))
        return _Moduli(shear * weight, (shear + lame) * weight)


def _detached(moduli: _Moduli) -> _Moduli:
    return _Moduli(*(number.detach() for number in moduli))


def _energies(strain: _Strain, moduli: _Moduli) -> Float[Tensor, " faces"]:
    shape = strain.difference.square() + strain.shear.square()
    return 0.5 * (moduli.bulk * strain.trace.square() + moduli.shear * shape)


def _stress(strain: _Strain, moduli: _Moduli) -> tuple[Tensor, Tensor, Tensor]:
    """A h (S11, S22, S12) with the second Piola-Kirchhoff stress S = 2 μ G + λ tr(G) I [J]."""
    mean, deviator = moduli.bulk * strain.trace, moduli.shear * strain.difference
    return mean + deviator, mean - deviator, moduli.shear * strain.shear


def _strain(x: Float[Tensor, "vertices 3"], rest: RestFaces) -> _Strain:
    x0, x1, x2 = rest.corners.gather(x)
    a, b, d = (number.to(x.dtype) for number in (rest.a, rest.b, rest.d))
    first = x1 - x0
    f1, f2 = a * first, b * first + d * (x2 - x0)
    g11, g22 = 0.5 * (dot(f1, f1) - 1.0), 0.5 * (dot(f2, f2) - 1.0)
    return _Strain(f1, f2, g11 + g22, g11 - g22, dot(f1, f2))


def _tensile(s11: Tensor, s22: Tensor, s12: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The positive semi-definite part of [[s11, s12], [s12, s22]] from its eigenvalues ``mean ± radius``."""
    mean, half = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    radius = torch.hypot(half, s12)
    upper, lower = (mean + radius).clamp(min=0.0), (mean - radius).clamp(min=0.0)
    centre = 0.5 * (upper + lower)
    slope = 0.5 * (upper - lower) / radius.clamp(min=torch.finfo(radius.dtype).tiny)
    return centre + slope * half, centre - slope * half, slope * s12
