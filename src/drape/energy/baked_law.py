"""The law of one fabric as splines: what a network says, at a fraction of the cost."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.certificate import Certificate
from drape.energy.cubic_spline import SplineLine, SplineTable
from drape.energy.edge_law import EdgeLaw, Slopes
from drape.scene.material import Material


class BakedLaw(EdgeLaw):
    """``φp = ½ yᵀ H y + (1 + z²) S(asinh z, α, β)`` with ``z = Δl / stretch_scale``, ``y = (Δl, sin α, sin β)``.

    H is the Hessian at rest of a law that is stationary there, else zero; the cubic spline S takes what is left, and
    has a node at rest. Derivatives are those of this formula, exactly. Beyond the table S is constant in Δl, so that
    φp goes on as a parabola, C² and convex for a law that gains energy at least quadratically.

    ``φd = d₀ + d₁ y + y² D(asinh y)`` with ``y = speed / speed_scale`` and a cubic spline D.

    S and D are computed in the precision of the tables (``law.double()`` for all of it in float64), everything else in
    that of the argument. ``attributes`` are not looked at: the law is that of one fabric.
    """

    def __init__(
        self,
        *,
        fabric: Material,
        attributes: Float[Tensor, " attributes"],
        bends: bool,
        face_area: float,
        dt: float,
        stretch_scale: float,
        speed_scale: float,
        rest_hessian: Float[Tensor, "3 3"],
        rest_drag: tuple[float, float],
        table: SplineTable,
        line: SplineLine | None,
        certificate: Certificate | None = None,
    ):
        super().__init__()
        self.fabric, self.bends, self.face_area, self.dt = fabric, bends, face_area, dt
        self.attributes, self.dissipates = attributes, line is not None
        self.stretch_scale, self.speed_scale, self.rest_drag = stretch_scale, speed_scale, rest_drag
        self.rest_hessian = tuple(map(tuple, rest_hessian.tolist()))  # numbers: a scalar costs less than a tensor
        self.table, self.line, self.certificate = table, line, certificate

    def potential(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return _Potential.apply(q, self)

    def drag(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> Float[Tensor, " edges"]:
        return _Drag.apply(speed, self)

    @torch.no_grad()
    def potential_slopes(
        self, q: Float[Tensor, "edges 3"], attributes: Float[Tensor, "edges attributes"], *, hessian: bool
    ) -> Slopes:
        return Slopes(*self._derivatives(q, 3 if hessian else 2))

    @torch.no_grad()
    def drag_slopes(
        self, speed: Float[Tensor, " edges"], attributes: Float[Tensor, "edges attributes"]
    ) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        return self._drag(speed)

    def _drag(self, speed: Float[Tensor, " edges"]) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]]:
        y = speed / self.speed_scale
        root = (1.0 + y * y).sqrt()
        start, slope = self.rest_drag
        value, by_w = (part.to(y.dtype) for part in self.line(_asinh(y, root)))
        by_y = slope + 2.0 * y * value + y * y / root * by_w
        return start + slope * y + y * y * value, by_y / self.speed_scale

    def _derivatives(self, q: Float[Tensor, "edges 3"], orders: int) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """The energy and its derivatives below ``orders``; what is not asked for is None."""
        stretch, alpha, beta = q.unbind(-1)
        z = stretch / self.stretch_scale
        square = 1.0 + z * z
        root = square.sqrt()
        found = self.table(_asinh(z, root), alpha, beta, orders)
        spline = {order: part.to(q.dtype) for order, part in found.items()}
        y = torch.stack([stretch, alpha.sin(), beta.sin()])
        pull = [h[0] * y[0] + h[1] * y[1] + h[2] * y[2] for h in self.rest_hessian]  # H y
        energy = 0.5 * (pull[0] * y[0] + pull[1] * y[1] + pull[2] * y[2]) + square * spline[0, 0, 0]
        if orders == 1:
            return energy, None, None
        cosine = [alpha.cos(), beta.cos()]
        by_z = 2.0 * z * spline[0, 0, 0] + root * spline[1, 0, 0]
        slopes = [pull[0] + by_z / self.stretch_scale]
        slopes += [pull[1] * cosine[0] + square * spline[0, 1, 0], pull[2] * cosine[1] + square * spline[0, 0, 1]]
        gradient = torch.stack(slopes).T
        if orders == 2:
            return energy, gradient, None
        return energy, gradient, self._hessian(spline, z, square, root, pull, y, cosine)

    def _hessian(self, spline, z, square, root, pull, y, cosine) -> Float[Tensor, "edges 3 3"]:
        h, scale = self.rest_hessian, self.stretch_scale
        zz = 2.0 * spline[0, 0, 0] + 3.0 * z / root * spline[1, 0, 0] + spline[2, 0, 0]
        za = h[0][1] * cosine[0] + (2.0 * z * spline[0, 1, 0] + root * spline[1, 1, 0]) / scale
        zb = h[0][2] * cosine[1] + (2.0 * z * spline[0, 0, 1] + root * spline[1, 0, 1]) / scale
        aa = h[1][1] * cosine[0].square() - pull[1] * y[1] + square * spline[0, 2, 0]
        ab = h[1][2] * cosine[0] * cosine[1] + square * spline[0, 1, 1]
        bb = h[2][2] * cosine[1].square() - pull[2] * y[2] + square * spline[0, 0, 2]
        entries = [h[0][0] + zz / scale**2, za, zb, za, aa, ab, zb, ab, bb]
        return torch.stack(entries, -1).unflatten(-1, (3, 3))


def _asinh(z: Tensor, root: Tensor) -> Tensor:
    """Asinh z, given √(1 + z²): several times faster than PyTorch's own, and as exact."""
    size = z.abs()
    return torch.log1p(size + size * (size / (1.0 + root))).copysign(z)


class _Potential(torch.autograd.Function):
    @staticmethod
    def forward(ctx, q, law):
        energy, gradient, _ = law._derivatives(q, 2 if ctx.needs_input_grad[0] else 1)
        ctx.save_for_backward(gradient)
        return energy

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, cotangent):
        return cotangent[:, None] * ctx.saved_tensors[0], None


class _Drag(torch.autograd.Function):
    @staticmethod
    def forward(ctx, speed, law):
        energy, slope = law._drag(speed)
        ctx.save_for_backward(slope)
        return energy

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, cotangent):
        return cotangent * ctx.saved_tensors[0], None
