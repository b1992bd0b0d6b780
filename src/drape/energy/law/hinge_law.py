"""The law of an edge as a spring and a hinge: what a fabric stores in its length and its dihedral angle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.law.damping import Damping
from drape.energy.law.eunet import EUNet
from drape.energy.law.potential_hinge import HingePotential
from drape.errors import DrapeError

FELT = 0.1
"""Of ``k dt``, which a backward Euler step of dt damps an edge by, that a damper has to have to be told from it."""


class HingeSlopes(NamedTuple):
    """Energies of edges and their derivatives in q = (Δl, Δθ)."""

    energy: Float[Tensor, " edges"]
    """[J]"""
    gradient: Float[Tensor, "edges 2"]
    """[J/m, J/rad]"""
    hessian: Float[Tensor, "edges 2 2"]


class HingeLaw(nn.Module, ABC):
    """φp(Δl, Δθ) of an edge of the mesh that the law was learned on, and what slows its motion.

    Args:
        face_area: mean area of the faces of that mesh [m²].
        damper: axial damper of an edge [kg/s].
        drag: of the air on a vertex [kg/s].
    """

    def __init__(self, face_area: float, damper: float, drag: float):
        super().__init__()
        self.face_area, self.damper, self.drag = face_area, damper, drag

    @property
    def constants(self) -> Float[Tensor, "3"]:
        """(face_area, damper, drag)."""
        return torch.tensor([self.face_area, self.damper, self.drag], dtype=torch.float64)

    @abstractmethod
    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        """φp of q = (Δl [m], Δθ [rad]), the changes from rest [J]; twice differentiable in q."""

    def energy_and_gradient(
        self, q: Float[Tensor, "edges 2"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, "edges 2"]]:
        """φp [J] with its first derivatives [J/m, J/rad]; no graph."""
        with torch.enable_grad():
            q = q.detach().requires_grad_()
            energy = self.potential(q)
            (gradient,) = torch.autograd.grad(energy.sum(), q)
        return energy.detach(), gradient

    def slopes(self, q: Float[Tensor, "edges 2"]) -> HingeSlopes:
        """φp with its first and second derivatives; no graph."""
        with torch.enable_grad():
            q = q.detach().requires_grad_()
            energy = self.potential(q)
            (gradient,) = torch.autograd.grad(energy.sum(), q, create_graph=True)
            rows = [torch.autograd.grad(gradient[:, k].sum(), q, retain_graph=True)[0] for k in range(2)]
        return HingeSlopes(energy.detach(), gradient.detach(), torch.stack(rows, 1))


def fabrics_damper(damper: float, stiffness: float, dt: float) -> float:
    """An axial damper [kg/s] that was found in frames of a recording; 0 where a fabric need not have it.

    A recorder that takes q solver steps in a frame of dt, each with the linearised force of its springs, shows a damper
    of ``k dt/q²``: Blender's cloth does at every quality (``benchmark.py measure=recorder``), and held-out cloth is
    nearer without it. A step of the solver damps an edge of stiffness k by ``k dt`` of its own.
    """
    return damper if damper > FELT * stiffness * dt else 0.0


class NetworkHinges(HingeLaw):
    """The law that the networks of a trained :class:`EUNet` are, for one fabric.

    Of what its dissipation units have learned a solver takes the drag, and the axial damper where it is one of the
    fabric: see :func:`fabrics_damper`. At which of three frames forces act belongs to the recorder, and is left out.

    Raises:
        DrapeError: an energy of other units than hinges and their damping.
    """

    attributes: Float[Tensor, " attributes"]

    def __init__(self, energy: EUNet, attributes: Float[Tensor, " attributes"], face_area: float, dt: float):
        potential, damping = energy.potential, energy.dissipation
        if not isinstance(potential, HingePotential) or not isinstance(damping, Damping | None):
            raise DrapeError(
                f"energy: found units {type(potential).__name__} and {type(damping).__name__}; expected HingePotential "
                "and Damping, of which a solver knows a damper and a drag, or no dissipation: train with "
                "model/potential=hinge, and with model/dissipation=damping or zero"
            )
        damper, drag = (0.0, 0.0) if damping is None else damping.constants(attributes, dt)
        super().__init__(face_area, 0.0, max(drag, 0.0))
        self.units = potential
        self.register_buffer("attributes", attributes)
        self.damper = fabrics_damper(damper, float(self.slopes(torch.zeros(1, 2).double()).hessian[0, 0, 0]), dt)

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        size = self.units.deformation.size
        return self.units.energies(q[:, :size], self.attributes.expand(len(q), -1)).to(q.dtype)

    def stiffness(self, seen: Float[Tensor, "places 2"]) -> Float[Tensor, "places 2"]:
        """K and B [J] at places (u, v) of :class:`BakedHinges`; B = 0 of a law that does not see hinges."""
        found = self.units.stiffness(seen[:, : self.units.deformation.size], self.attributes.expand(len(seen), -1))
        return torch.nn.functional.pad(found, (0, 2 - found.shape[1]))


class WithoutHinges(HingeLaw):
    """``φp(Δl, 0)`` of another law, and its damping: no force from bending (the paper's ablation)."""

    def __init__(self, law: HingeLaw):
        super().__init__(law.face_area, law.damper, law.drag)
        self.law = law

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        return self.law.potential(q * q.new_tensor([1.0, 0.0]))
