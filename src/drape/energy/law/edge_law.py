"""The law of an edge: what a fabric stores in the deformation of an edge, and what its motion costs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.law.dissipation_speed import SpeedDissipation
from drape.energy.law.eunet import EUNet
from drape.errors import DrapeError

MIRRORED = torch.tensor([1.0, -1.0, 1.0])
"""Signs that (Δl, α, β) of a cloth have in its mirror image (docs/sources.md, Twist and bend)."""


class Slopes(NamedTuple):
    """Energies of edges and their derivatives in the deformation q = (Δl, α, β)."""

    energy: Float[Tensor, " edges"]
    """[J]"""
    gradient: Float[Tensor, "edges 3"]
    """[J/m, J/rad, J/rad]"""
    hessian: Float[Tensor, "edges 3 3"] | None

    @property
    def curvature(self) -> Float[Tensor, "edges 3 3"]:
        """The Hessian that was asked for.

        Raises:
            DrapeError: none was.
        """
        if self.hessian is None:
            raise DrapeError("edge law: found slopes without a Hessian; expected one: ask with hessian=True")
        return self.hessian


class EdgeLaw(nn.Module, ABC):
    """φp(Δl, α, β) and φd(speed) of the edges of a cloth: all that a solver needs to know of a fabric.

    The energies are those of an edge of the mesh that the law was learned on: ``face_area`` [m²] is the mean area of
    that mesh's faces, ``dt`` [s] the time between the frames that were learned from.
    """

    face_area: float
    dt: float
    bends: bool
    """Whether φp sees α and β at all; where not, nobody computes normals."""
    dissipates: bool
    """Whether there is a φd; where not, there is no term for it."""

    @abstractmethod
    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        """φp of q = (Δl [m], α, β [rad]), the changes from rest [J]; differentiable in q."""

    @abstractmethod
    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        """φd per adjacent area of an edge that moves with ``speed`` [m/s], over a step of :attr:`dt` [J/m²]."""

    def potential_slopes(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"], *, hessian: bool
    ) -> Slopes:
        """φp with its first and, where asked for, second derivatives in q; no graph."""
        with torch.enable_grad():
            q = q.detach().requires_grad_()
            energy = self.potential(q, attributes)
            (gradient,) = torch.autograd.grad(energy.sum(), q, create_graph=hessian)
            rows = [torch.autograd.grad(gradient[:, k].sum(), q, retain_graph=True)[0] for k in range(3 * hessian)]
        return Slopes(energy.detach(), gradient.detach(), torch.stack(rows, 1) if hessian else None)

    def drag_slopes(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        """φd per area [J/m²] and its derivative in the speed [J s/m³]; no graph."""
        with torch.enable_grad():
            speed = speed.detach().requires_grad_()
            energy = self.drag(speed, attributes)
            (slope,) = torch.autograd.grad(energy.sum(), speed)
        return energy.detach(), slope


class NetworkLaw(EdgeLaw):
    """The law that the networks of a trained :class:`EUNet` are; see there and in its units for the formulas.

    A fabric and its mirror image store the same energy, and mirroring negates the twist: φp is the mean of the network
    at α and at -α. That also closes the gap between half a turn to the left and to the right where angles are scaled
    (:class:`EdgeScale`): at a sharp fold it was a cliff in the energy.

    Of the dissipation units a step of any length takes the drag of the air. What they learned of rates of deformation
    is not a property of the fabric: seen frame by frame, the tension lags behind, a negative damping of the sampling's
    own making, which a step forward in time must not repeat (its amplification factor for stiff edges exceeds 1).

    Raises:
        DrapeError: an energy whose areas are not the paper's, or whose dissipation has no drag for a solver.
    """

    def __init__(self, energy: EUNet, face_area: float, dt: float):
        super().__init__()
        units = energy.dissipation
        if not isinstance(units, SpeedDissipation | None):
            raise DrapeError(
                f"energy: found units {type(units).__name__} of what its motion costs; expected SpeedDissipation, "
                "whose drag a solver can take, or none: train with model/dissipation=speed or zero"
            )
        if units is not None and units.boundary_faces != 1.0:
            raise DrapeError(
                "energy: its dissipation counts the faces of boundary edges twice, as the official code does; expected "
                "once, as in the paper: train for animation with model.dissipation.boundary_faces=1"
            )
        self.energy = energy
        self.face_area = face_area
        self.dt = dt
        self.bends = energy.potential.deformation.size > 1
        self.dissipates = energy.dissipates

    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        potential = self.energy.potential
        if not self.bends:
            return potential.energies(q[:, :1], attributes).to(q.dtype)
        both = torch.cat([q, q * MIRRORED.to(q)])
        pairs = torch.stack([both[:, 1:].cos(), both[:, 1:].sin()], -1).flatten(1)
        energy = potential.energies(torch.cat([both[:, :1], pairs], -1), attributes.repeat(2, 1))
        return energy.view(2, -1).mean(0).to(q.dtype)

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return cast(SpeedDissipation, self.energy.dissipation).drag(speed, attributes).to(speed.dtype)


KEPT = torch.tensor([1.0, 0.0, 0.0])


class StretchOnly(EdgeLaw):
    """``φp(Δl, 0, 0)`` of another law, and its φd: no gradient from bending (the paper's ablation, appendix)."""

    def __init__(self, law: EdgeLaw):
        super().__init__()
        self.law = law
        self.face_area, self.dt, self.dissipates, self.bends = law.face_area, law.dt, law.dissipates, False

    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.law.potential(q * KEPT.to(q), attributes)

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return self.law.drag(speed, attributes)

    def potential_slopes(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"], *, hessian: bool
    ) -> Slopes:
        kept = KEPT.to(q)
        full = self.law.potential_slopes(q * kept, attributes, hessian=hessian)
        blocks = None if full.hessian is None else full.hessian * kept[:, None] * kept
        return Slopes(full.energy, full.gradient * kept, blocks)

    def drag_slopes(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        return self.law.drag_slopes(speed, attributes)
