"""All that losses and metrics want to know of a learned energy over one window, computed once and when asked for."""

from __future__ import annotations

from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.windows import Window
from drape.energy.eunet import EdgeEnergies, EUNet
from drape.energy.pullback import pullback
from drape.scene.geometry import EdgeGeometry


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
    def _x_next(self) -> Float[Tensor, "vertices 3"]:
        return self.window.x_next.detach().requires_grad_()

    @cached_property
    def _inputs_next(self) -> dict[str, Tensor]:
        with torch.enable_grad():
            return self.energy.inputs(EdgeGeometry(self._x_next, self.window.mesh), self.current, self.window.dt)

    @cached_property
    def _leaves(self) -> dict[str, Tensor]:
        return {name: value.detach().requires_grad_() for name, value in self._inputs_next.items()}

    @cached_property
    def next(self) -> EdgeEnergies:
        """Energies of each edge for the step to t+1 [J]."""
        with torch.enable_grad():
            return self.energy.energies(self._leaves, self.attributes)

    @cached_property
    def potential(self) -> Float[Tensor, " edges"]:
        """φp of each edge at t [J]."""
        units = self.energy.potential
        return units.energies(units.inputs(self.current), self.attributes)

    @cached_property
    def change(self) -> Float[Tensor, " meshes"]:
        """ΔV_Φ = Φp(t+1) + lost - Φp(t) of each mesh [J] (paper, eq. 7), differenced edge by edge."""
        return self.window.mesh.sum_edges(self.next.balance - self.potential)

    @cached_property
    def gradient(self) -> Float[Tensor, "vertices 3"]:
        """∂Φ/∂x [N], minus the internal and damping force on each vertex: that at t+1, or, of an energy that knows at
        which frames forces act, the mean of those at t-1, t and t+1 with these weights.
        """
        if self.energy.timing is not None:
            return self._weighted_gradient
        with torch.enable_grad():
            total = self.next.total.sum()
            leaves = list(self._leaves.values())
            slopes = torch.autograd.grad(total, leaves, create_graph=self.training, retain_graph=True)
            return pullback(list(self._inputs_next.values()), self._x_next, slopes)

    @cached_property
    def _weighted_gradient(self) -> Float[Tensor, "vertices 3"]:
        window, units = self.window, self.energy.potential
        with torch.enable_grad():
            x = torch.stack([window.x_prev, window.x, self._x_next.detach()]).requires_grad_()
            inputs = units.inputs(EdgeGeometry(x, window.mesh))
            leaves = inputs.detach().flatten(0, 1).requires_grad_()
            total = units.energies(leaves, self.attributes.repeat(3, 1)).sum()
            (slopes,) = torch.autograd.grad(total, leaves, create_graph=self.training)
            weights = self.energy.timing(self.attributes)
            weights = weights if self.training else weights.detach()
            pulled = pullback([inputs], x, [weights * slopes.unflatten(0, (3, -1))]).sum(0)
            if not self.energy.dissipates:
                return pulled
            leaf = self._leaves["dissipation"]
            lost, _ = self.energy.units["dissipation"].energies(leaf, self.attributes)
            (slopes,) = torch.autograd.grad(lost.sum(), leaf, create_graph=self.training)
            return pulled + pullback([self._inputs_next["dissipation"]], self._x_next, [slopes])

    @cached_property
    def force_residual(self) -> Float[Tensor, "vertices 3"]:
        """``m a - m g + ∂Φ/∂x`` at t+1 [N]: zero where the energy explains the motion (paper, eq. 8); 0 at pins."""
        residual = self.window.inertial_force + self.gradient
        return residual * self.window.free[:, None]
