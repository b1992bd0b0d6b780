"""The accurate end of the trade: implicit Euler steps that minimise an incremental potential."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.contact.collisions import Collisions
from drape.contact.untangle import untangle
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.scene_step import SceneSteps
from drape.energy.step import Step
from drape.errors import DrapeError
from drape.scene.scene import Scene
from drape.scene.state import State
from drape.simulators.advance import advance
from drape.simulators.kinematic.prior import KinematicPrior, Nothing
from drape.simulators.simulator import Outcome, StepResult
from drape.simulators.solver.balance import BALANCED, mean_weight
from drape.simulators.solver.energy_limit import without_gain
from drape.simulators.solver.minimise import SHORT_OF, Minimiser

PRECISIONS = {"float32": torch.float32, "float64": torch.float64}


SHARES: tuple[dict[str, Any], ...] = ({"share": 0.9, "rounds": 16},)
"""Settings of the starts in which cloth goes with the body (:class:`KinematicPrior`)."""
RIGID: dict[str, Any] = {"share": 1.0, "rounds": 0}
"""The same where nothing may cross: as if fixed to a body that turns."""
CUTS = 20
"""Parts into which a time step is cut where no start of it can be reached without a crossing."""
LEAST_SHARE = 1e-3
"""Of the rest of a time step: below it nothing is gained by a further cut."""
MOVES = 30
"""Of cloth that has to cross, at most, to untangle it."""
ROUNDS = 3
"""Searches for contact at the end of a step that left vertices inside the body."""


class ImplicitSolver:
    """Implicit Euler steps, one or more a frame: ``x' = argmin E(x')``, ``v' = (x' - x)/dt``.

    Each frame follows from the state before it alone, to the last bit: nothing else is remembered, so an animation that
    was interrupted goes on as if it had not been.

    The faces of contact are those nearest at t (the paper). Where vertices end inside the body all the same, because
    they slid off their face or the body is thin or fast, the nearest faces at the end are taken and the step is
    minimised on from there.

    Where it starts from: the present positions, or free motion, with a body where that carries the cloth
    (:class:`KinematicPrior`), whichever has the lowest energy; so a step never ends above that of standing still.
    Without a body or moving pins, which do work, the energy of the cloth does not grow, at any number of iterations:
    see :func:`without_gain`.

    Args:
        potential: the terms of the scene.
        scene: what is simulated.
        attributes: the scaled vector **a** of the fabric.
        tolerance: mean norm of the unbalanced force over the free vertices at which a step is done [N]; None for a
            thousandth of the mean weight (or of mass times 9.81 m/s² without gravity).
        iterations: the most evaluations of the incremental potential for a time step, the knob between speed and
            accuracy; where cloth ends inside the body, up to ``ROUNDS`` times as many again.
        steps: equal time steps in each frame; body and pins move on straight lines between frames.
        precision: of the law of the fabric, float32 or float64. Positions, and what is seen of them, are always
            float64: in single precision the rounding of a stiff edge alone weighs more than its vertices.
        factors: precision of the sparse factors of Hessians; float32 takes half the time, where PARDISO is there.
        device: where energies are evaluated.

    Raises:
        DrapeError: a value that makes no sense.
    """

    def __init__(
        self,
        potential: IncrementalPotential,
        scene: Scene,
        attributes: Float[Tensor, " attributes"],
        tolerance: float | None = None,
        iterations: int = 300,
        steps: int = 1,
        precision: str = "float64",
        factors: str = "float64",
        device: str = "cpu",
    ):
        for name, value in {"iterations": iterations, "steps": steps}.items():
            if value < 1:
                raise DrapeError(f"simulator.{name}: found {value}; expected a whole number from 1 on")
        for name, chosen in {"precision": precision, "factors": factors}.items():
            if chosen not in PRECISIONS:
                raise DrapeError(f"simulator.{name}: found {chosen!r}; expected {' or '.join(PRECISIONS)}")
        if tolerance is None:
            tolerance = BALANCED * mean_weight(scene)
        if not tolerance > 0:
            raise DrapeError(f"simulator.tolerance: found {tolerance}; expected newtons, more than 0")
        self.potential = potential.to(device).with_laws_in(PRECISIONS[precision])
        contact = self.potential.contact
        self.steps = SceneSteps(scene, attributes, device, contact)
        self.tolerance = tolerance
        self.iterations = iterations
        self.steps_per_frame = steps
        self._minimiser = Minimiser(self.potential, self.steps.free, single=factors == "float32")
        self.barrier = self.potential.barrier
        self._carried = []
        if contact is not None:
            shares = SHARES if self.barrier is None else (*SHARES, RIGID)
            self._carried = [KinematicPrior(Nothing(), **each, reach=contact.reach) for each in shares]
        self._is_left_alone = scene.obstacle is None and (scene.pins is None or scene.pins.is_static)

    def step(self, state: State, frame: int) -> StepResult:
        """The state at frame ``frame + 1`` from that at ``frame``; how it ended is that of its worst time step."""
        count, taken = self.steps_per_frame, []
        for part in range(count):
            taken.append(self._advance(state, frame + part / count, frame + (part + 1) / count))
            state = taken[-1].state
            if taken[-1].outcome is Outcome.NOT_FINITE:
                break
        result = replace(_worst(taken), steps=count)
        return result if self.barrier is None else self._untangled(result, self.barrier.collisions, frame + 1.0)

    def _advance(self, state: State, start: float, stop: float, cuts: int = 0) -> StepResult:
        step = self.steps.step(state, start, stop)
        moved = [advance(carried, step) for carried in self._carried] or [step.inertial]
        places = [step.x, *moved]
        places = [self.steps.pinned(place, state, stop) for place in places]
        if self.barrier is None:
            return self._minimised(state, step, places, stop)
        self.barrier.collisions.forget()
        shares = [self.barrier.share_beside_body(step.x, place, step) for place in places]
        free = [place for place, share in zip(places, shares, strict=True) if share == 1.0]
        if free:
            return self._minimised(state, step, free, stop)
        share, place = max(zip(shares, places, strict=True), key=lambda pair: pair[0])
        if cuts == CUTS or share < LEAST_SHARE:
            return self._crossing(state, step, places, stop)
        between = start + SHORT_OF * share * (stop - start)
        part = self.steps.step(state, start, between)
        place = self.steps.pinned(step.x + SHORT_OF * share * (place - step.x), state, between)
        first = self._minimised(state, part, [place], between)
        if first.outcome is Outcome.NOT_FINITE:
            return first
        second = self._advance(first.state, between, stop, cuts + 1)
        return _worst([first, second])

    def _crossing(self, state: State, step: Step, starts: list[Tensor], stop: float) -> StepResult:
        """The step without the barrier."""
        kept = IncrementalPotential([term for term in self.potential.terms if term is not self.barrier])
        whole, self._minimiser = self._minimiser, Minimiser(kept, self.steps.free)
        result = self._minimised(state, step, starts, stop)
        self._minimiser = whole
        return result

    def _untangled(self, result: StepResult, collisions: Collisions, stop: float) -> StepResult:
        """A frame with what crosses all the same untangled as far as that can be; what was moved is stopped."""
        before = result.state
        pinned = ~self.steps.free.cpu().numpy()
        x, left = untangle(collisions, before.x, self.steps.body(stop), held=pinned, moves=MOVES)
        moved = (x != before.x).any(axis=1, keepdims=True)
        after = State(x, np.where(moved, 0.0, before.v)) if moved.any() else before
        return replace(result, state=after, outcome=Outcome.BLOCKED if len(left.pairs) else result.outcome)

    def _minimised(self, state: State, step: Step, starts: list[Tensor], stop: float) -> StepResult:
        self._minimiser.begin()
        x, found, outcome, used, residual = self._minimiser.minimise(starts, step, self.tolerance, self.iterations)
        before = self._minimiser.standing
        positions = self._positions(x, step, state, stop)
        for _ in range(ROUNDS if step.obstacle is not None and outcome is not Outcome.NOT_FINITE else 0):
            ending = self.steps.with_near_at(step, x, positions, stop)
            if not bool((ending.near.distance < 0).any()):
                break
            step = ending
            x, found, outcome, more, residual = self._minimiser.minimise([x], step, self.tolerance, self.iterations)
            positions, used = self._positions(x, step, state, stop), used + more
        if outcome is Outcome.NOT_FINITE:
            return StepResult(State.at_rest(state.x), outcome, used, residual, found.terms)
        after = State(positions, (positions - state.x) / step.dt)
        if self._is_left_alone and before is not None:
            free, released = step.free.cpu().numpy(), before.stored - found.stored
            after = without_gain(state, after, released, self.steps.scene.mass, free, 4 * before.rounding)
        return StepResult(after, outcome, used, residual, found.terms)

    def _positions(self, x: Tensor, step: Step, state: State, stop: float) -> Float[np.ndarray, "vertices 3"]:
        """``x`` of a step in the world, in float64, pinned vertices exactly where they are led [m]."""
        positions = state.x + (x - step.x).cpu().numpy()
        if self.steps.scene.pins is not None:
            positions[self.steps.scene.pins.vertices] = self.steps.pin_targets(stop)
        return positions


def _worst(taken: Sequence[StepResult]) -> StepResult:
    """Time steps as one: it ends as the last, as well as the one whose forces are least balanced."""
    worst = max(taken, key=lambda each: (each.outcome is Outcome.BLOCKED, np.nan_to_num(each.residual, nan=np.inf)))
    iterations = sum(each.iterations for each in taken)
    return replace(taken[-1], outcome=worst.outcome, residual=worst.residual, iterations=iterations)
