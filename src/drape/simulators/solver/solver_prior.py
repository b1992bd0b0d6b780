"""One cheap step of the solver, which knows gravity, contact and the fabric: a network adds what it misses."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.energy.terms.contact import Contact
from drape.simulators.solver.batch_solver import BatchSolver


class SolverPrior(nn.Module):
    """The acceleration [m/s²] after which ``x' = x₁ + H⁻¹ M network(x, (x₁ - x)/dt)``.

    x₁ is where :class:`BatchSolver` comes to in so many ``evaluations`` of the incremental potential; three are a step
    of Newton's method and one more with the same factors, those of its Hessian H. What the network predicts acts as a
    further force on the masses M, to which the cloth answers as stiff as it is: a network errs in all directions alike,
    and what it errs in stiff ones, along edges and into the body, is taken back. It is told x₁ as where the cloth goes
    without it.

    Args:
        network: what predicts the rest, accelerations [m/s²] of free vertices.
        share, rounds, contact, friction: of :class:`BatchSolver`.
        evaluations: of the incremental potential, at most.
    """

    asks_device = True
    """It solves on a CPU."""

    def __init__(
        self, network: nn.Module, share: float, rounds: int, contact: Contact, friction: float, evaluations: int
    ):
        super().__init__()
        self.network, self.contact, self.evaluations = network, contact, evaluations
        self._solver = BatchSolver(contact, friction, share, rounds)

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        """In world axes and the precision of the step; 0 at pinned vertices."""
        step = self._solver.touching(step)
        x = self._solver.end(step, self.evaluations)
        v = torch.where(step.free[:, None], (x - step.x) / step.dt, step.v)
        reached = replace(step, v=v)
        if step.obstacle is not None:
            reached = reached.with_near(step.near, step.surface)
        further = self._solver.response(step.mass[:, None] * self.network(reached), step)
        return further / step.dt**2 + (v - step.v) / step.dt
