"""Implicit Euler steps of garments in a batch, without a scene: a prior for networks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast
from weakref import WeakKeyDictionary

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.incremental_potential import IncrementalPotential, terms_of
from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.energy.terms.contact import Contact
from drape.geometry.mesh_batch import MeshBatch
from drape.simulators.advance import advance
from drape.simulators.kinematic.prior import KinematicPrior, Nothing
from drape.simulators.solver.minimise import Minimiser


class BatchSolver:
    """Minimises inertia, gravity, the fabric of a :class:`Step`, contact and friction, from where the body carries it.

    Args:
        contact: of cloth and body.
        friction: coefficient μ; 0 leaves the term out.
        share, rounds: of the :class:`KinematicPrior` at which a step starts.
    """

    def __init__(self, contact: Contact, friction: float, share: float, rounds: int):
        self.contact, self.friction = contact, friction
        self._start = KinematicPrior(Nothing(), share, rounds, contact.reach)
        self._kept: WeakKeyDictionary[MeshBatch, tuple[object, Minimiser]] = WeakKeyDictionary()

    @torch.no_grad()
    def end(self, step: Step, evaluations: int) -> Float[Tensor, "vertices 3"]:
        """Positions at the end of ``step``, with its ``touching``, after at most so many evaluations [m]."""
        minimiser = self._minimiser(step)
        minimiser.begin()
        return minimiser.minimise([advance(self._start, step)], step, 0.0, evaluations)[0]

    def response(self, force: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, "vertices 3"]:
        """Displacement of the cloth of ``step`` by a force [N] besides all others, whose :meth:`end` was last asked
        for, to first order [m]; differentiable in the force.
        """
        return _Response.apply(force, self._minimiser(step))

    def touching(self, step: Step) -> Step:
        """``step`` with the points of the cloth that the contact asks about, unless it has some."""
        if step.touching is not None or step.obstacle is None:
            return step
        return replace(step, touching=self.contact.surface(step.mesh))

    def _minimiser(self, step: Step) -> Minimiser:
        key = tuple(map(id, step.fabric)), step.external_force is None, step.obstacle is None
        kept = self._kept.get(step.mesh)
        if kept is None or kept[0] != key:
            contact, pushed = None if step.obstacle is None else self.contact, step.external_force is not None
            fabric = cast(Sequence[EnergyTerm], step.fabric)
            terms = terms_of(fabric, contact, self.friction, gravity=True, external=pushed)
            kept = self._kept[step.mesh] = key, Minimiser(IncrementalPotential(terms), step.free)
        return kept[1]


class _Response(torch.autograd.Function):
    """``H⁻¹ f`` by the factors of a minimiser; H is symmetric, so is its derivative."""

    @staticmethod
    def forward(ctx: Any, force: Tensor, minimiser: Minimiser) -> Tensor:
        ctx.minimiser = minimiser
        return minimiser.response(force)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None]:
        return ctx.minimiser.response(slope), None
