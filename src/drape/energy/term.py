"""The contract of everything that an incremental potential is a sum of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy import sparse
from torch import Tensor, nn

from drape.energy.step import Step
from drape.linalg.stencil_sum import Filled, StencilSum

Kernel = Callable[[Float[np.ndarray, "vertices 3"]], tuple[float, Float[np.ndarray, "vertices 3"]]]
"""Energy of all cloths together [J] and its gradient [N] at positions in double precision."""


class Stencils(NamedTuple):
    """Positive semi-definite pieces of a Hessian: piece s couples the vertices ``vertices[s]`` by ``blocks[s]``."""

    vertices: Int[Tensor, "stencils corners"]
    blocks: Float[Tensor, "stencils corners 3 corners 3"]
    """[N/m]"""


def array(values: Tensor) -> np.ndarray:
    """In double precision, for compiled code."""
    return values.detach().double().contiguous().cpu().numpy()


class EnergyTerm(nn.Module, ABC):
    """One summand of an incremental potential, in joules, differentiable in the positions at the end of a step.

    A term says in ``forward`` what it costs, and for a solver in ``stencils`` how stiff it is; it never decides
    whether it belongs into a scene (see :mod:`drape.energy.incremental_potential`).
    """

    name: str
    """Short name, the same in logs, tables and messages."""
    stores: ClassVar[bool] = True
    """Whether it is an energy of the place that a step ends at; if not, it is the price of a motion."""

    def __init__(self, law: nn.Module | None = None):
        """``law``: of the edges of a fabric, of a term that has one."""
        super().__init__()
        self.law = law

    @property
    def relative_rounding(self) -> float:
        """Share of its energy that means nothing: that of double precision, or of the networks of its law."""
        weight = None if self.law is None else next(self.law.parameters(), None)
        return torch.finfo(torch.float64 if weight is None else weight.dtype).eps

    @abstractmethod
    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        """Energy of each cloth for the step that ends at ``x_next`` [J]."""

    def energy_and_gradient(
        self, x_next: Float[Tensor, "vertices 3"], step: Step
    ) -> tuple[Float[Tensor, " meshes"], Float[Tensor, "vertices 3"]]:
        """The energy [J] and its gradient, minus the force on each vertex [N]; no graph. Override where faster."""
        with torch.enable_grad():
            x_next = x_next.detach().requires_grad_()
            energy = self(x_next, step)
            (gradient,) = torch.autograd.grad(energy.sum(), x_next)
        return energy.detach(), gradient

    def kernel(self, step: Step) -> Kernel | None:
        """The same for many positions in one step, without tensors; None where there is none, as on a device."""
        return None

    def stencils(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Sequence[Stencils | Filled]:
        """A positive semi-definite approximation of the Hessian at ``x_next``, piece by piece; [] if it is zero."""
        return []

    def hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array | None:
        """A better approximation than the stencils', as :meth:`rough_hessian`; None where there is none."""
        return None

    def loose_hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array | None:
        """A part of the Hessian with entries elsewhere each time, as :meth:`rough_hessian`; None where none is."""
        return None

    def rough_hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> sparse.csr_array:
        """The stencils as one matrix, ``3 vertices`` square, of which the upper triangle is there."""
        return StencilSum().upper(self.stencils(x_next, step), len(x_next))
