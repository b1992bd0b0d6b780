"""The law of an edge as a spring and a hinge: what a fabric stores in the length and in the dihedral angle of an edge."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.eunet import EUNet
from drape.energy.potential_hinge import HingePotential
from drape.energy.spline_plane import SplinePlane
from drape.scene.material import Material


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

    @abstractmethod
    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        """φp of q = (Δl [m], Δθ [rad]), the changes from rest [J]; twice differentiable in q."""

    def slopes(self, q: Float[Tensor, "edges 2"]) -> HingeSlopes:
        """φp with its first and second derivatives; no graph."""
        with torch.enable_grad():
            q = q.detach().requires_grad_()
            energy = self.potential(q)
            (gradient,) = torch.autograd.grad(energy.sum(), q, create_graph=True)
            rows = [torch.autograd.grad(gradient[:, k].sum(), q, retain_graph=True)[0] for k in range(2)]
        return HingeSlopes(energy.detach(), gradient.detach(), torch.stack(rows, 1))


class NetworkHinges(HingeLaw):
    """The law that the networks of a trained :class:`EUNet` are, for one fabric.

    Of what its dissipation units have learned a solver takes the axial damper and the drag; a negative one counts as 0.
    At which of three frames forces act belongs to the recorder, and is left out.
    """

    def __init__(self, energy: EUNet, attributes: Float[Tensor, " attributes"], face_area: float, dt: float):
        damper = drag = 0.0
        if energy.dissipates:
            damper, drag = energy.units["dissipation"].constants(attributes, dt)
        super().__init__(face_area, max(damper, 0.0), max(drag, 0.0))
        self.units: HingePotential = energy.potential
        self.register_buffer("attributes", attributes)

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        size = self.units.deformation.size
        return self.units.energies(q[:, :size], self.attributes.expand(len(q), -1)).to(q.dtype)


class BakedHinges(HingeLaw):
    """``φp = ½ K(u, v) z² + ½ B(u, v) y²``, z = Δl/stretch_scale, y = Δθ/angle_scale, u = asinh z, v = ln(1 + y²).

    K and B are cubic splines [J] that are never negative; beyond their nodes they are constant, so that φp goes on as
    a parabola. It is the form of :class:`HingePotential`, so that at rest energy, forces and stiffness are those of the
    network.
    """

    def __init__(
        self,
        plane: SplinePlane,
        *,
        fabric: Material,
        stretch_scale: float,
        angle_scale: float,
        face_area: float,
        damper: float,
        drag: float,
    ):
        super().__init__(face_area, damper, drag)
        self.plane, self.fabric = plane, fabric
        self.stretch_scale, self.angle_scale = stretch_scale, angle_scale

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        z, y = q[:, 0] / self.stretch_scale, q[:, 1] / self.angle_scale
        k, b = self.plane(torch.asinh(z), torch.log1p(y.square()))
        return 0.5 * (k.to(q.dtype) * z.square() + b.to(q.dtype) * y.square())
