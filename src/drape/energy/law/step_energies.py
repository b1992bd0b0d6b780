"""Energies and forces of a learned energy over one window, each computed once and when asked for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.eunet import EdgeEnergies, EUNet
from drape.geometry.edge_geometry import EdgeGeometry


class StepEnergies:
    """Energies and forces of ``energy`` for the step x → x_next of ``window``.

    ``training``: keep the graph to the parameters of the forces as well (energies always have theirs).
    """

    def __init__(self, energy: EUNet, window: Window, *, training: bool):
        self.energy = energy
        self.window = window
        self.training = training

    @cached_property
    def attributes(self) -> Float[Tensor, "edges attributes"]:
        return self.window.edge_attributes

    @cached_property
    def current(self) -> EdgeGeometry:
        """Geometry at t."""
        return EdgeGeometry(self.window.x, self.window.mesh)

    @cached_property
    def _x(self) -> Float[Tensor, "frames vertices 3"]:
        """Positions at which forces act, t+1 last; t+1 alone, unless the energy knows at which frames they do."""
        window = self.window
        frames = [window.x_next] if self.energy.timing is None else [window.x_prev, window.x, window.x_next]
        return torch.stack(frames).detach().requires_grad_()

    @cached_property
    def inputs(self) -> dict[str, Tensor]:
        """Inputs of the units: elastic ones at all frames, ``frames edges inputs``, dissipation ones at t+1."""
        with torch.enable_grad():
            inputs = {"potential": self.energy.potential.inputs(EdgeGeometry(self._x, self.window.mesh))}
            if self.energy.dissipation is not None:
                after = EdgeGeometry(self._x[-1], self.window.mesh)
                inputs["dissipation"] = self.energy.dissipation.inputs(after, self.current, self.window.dt)
        return inputs

    @cached_property
    def _leaves(self) -> dict[str, Tensor]:
        return {name: value.detach().requires_grad_() for name, value in self.inputs.items()}

    @cached_property
    def _potentials(self) -> Float[Tensor, "frames edges"]:
        """φp of each edge at all frames [J]."""
        with torch.enable_grad():
            inputs = self._leaves["potential"]
            attributes = self.attributes.repeat(len(inputs), 1)
            return self.energy.potential.energies(inputs.flatten(0, 1), attributes).unflatten(0, (len(inputs), -1))

    @cached_property
    def _dissipated(self) -> tuple[Float[Tensor, " edges"], Float[Tensor, " edges"]] | None:
        """φd of each edge, and the energy that it loses [J]."""
        if self.energy.dissipation is None:
            return None
        with torch.enable_grad():
            return self.energy.dissipation.energies(self._leaves["dissipation"], self.attributes)

    @cached_property
    def next(self) -> EdgeEnergies:
        """Energies of each edge for the step to t+1 [J]."""
        potential = self._potentials[-1]
        if self._dissipated is None:
            return EdgeEnergies(potential, potential)
        dissipation, lost = self._dissipated
        return EdgeEnergies(potential + dissipation, potential + lost)

    @cached_property
    def potential(self) -> Float[Tensor, " edges"]:
        """φp of each edge at t [J]."""
        if self.energy.timing is not None:
            return self._potentials[1]
        units = self.energy.potential
        return units.energies(units.inputs(self.current), self.attributes)

    @cached_property
    def change(self) -> Float[Tensor, " meshes"]:
        """ΔV_Φ = Φp(t+1) + lost - Φp(t) of each mesh [J] (paper, eq. 7), differenced edge by edge."""
        return self.window.mesh.sum_edges(self.next.balance - self.potential)

    @cached_property
    def slopes(self) -> dict[str, Tensor]:
        """Derivatives of φp and φd in their :attr:`inputs`."""
        with torch.enable_grad():
            total = self._potentials.sum() + (0.0 if self._dissipated is None else self._dissipated[0].sum())
            leaves = list(self._leaves.values())
            found = torch.autograd.grad(total, leaves, create_graph=self.training, retain_graph=True)
        return dict(zip(self._leaves, found, strict=True))

    @cached_property
    def gradient(self) -> Float[Tensor, "vertices 3"]:
        """∂Φ/∂x [N], minus the internal and damping force on each vertex: that at t+1, or, of an energy that knows at
        which frames forces act, the mean of those at t-1, t and t+1 with these weights.
        """
        timing, slopes = self.energy.timing, dict(self.slopes)
        with torch.enable_grad():
            if timing is not None:
                weights = timing(self.attributes)
                slopes["potential"] = slopes["potential"] * (weights if self.training else weights.detach())
            return pullback(list(self.inputs.values()), self._x, list(slopes.values())).sum(0)

    @cached_property
    def force_residual(self) -> Float[Tensor, "vertices 3"]:
        """``m a - m g + ∂Φ/∂x`` at t+1 [N]: zero where the energy explains the motion (paper, eq. 9); 0 at pins."""
        residual = self.window.inertial_force + self.gradient
        return residual * self.window.free[:, None]


def _laid_out_as(pattern: Tensor, values: Tensor) -> Tensor:
    """A copy of ``values`` in the order in memory of ``pattern``, which the geometry is fastest in."""
    return torch.empty_like(pattern.detach()).copy_(values.detach())


class _Pullback(torch.autograd.Function):
    @staticmethod
    def forward(ctx, x, count, *inputs_and_slopes):
        inputs, slopes = inputs_and_slopes[:count], inputs_and_slopes[count:]
        with torch.enable_grad():
            slopes = [_laid_out_as(one, slope).requires_grad_() for one, slope in zip(inputs, slopes, strict=True)]
            (pulled,) = torch.autograd.grad(inputs, x, slopes, create_graph=True)
        ctx.pulled, ctx.slopes = pulled, slopes
        return pulled.detach()

    @staticmethod
    def backward(ctx, cotangent):
        pushed = torch.autograd.grad(ctx.pulled, ctx.slopes, _laid_out_as(ctx.pulled, cotangent))
        return None, None, *(None for _ in pushed), *pushed


def pullback(inputs: Sequence[Tensor], x: Tensor, slopes: Sequence[Tensor]) -> Tensor:
    """``Σ_k (∂inputs_k/∂x)ᵀ slopes_k``, the gradient of an energy in ``x`` from its slopes in its inputs.

    Differentiable in ``slopes`` only: the geometry has no parameters, so differentiating it twice more in ``x``, as
    ``create_graph=True`` alone would, is work that training never uses. ``inputs`` carry their graph to ``x``.
    """
    return _Pullback.apply(x, len(inputs), *inputs, *slopes)
