"""The interface of simulators: one step of a scene, and a report of how it went."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol, runtime_checkable

from drape.energy.terms.ipc import Barrier
from drape.scene.state import State


class Outcome(Enum):
    """Outcome of a step; the value is the remedy."""

    CONVERGED = "converged"
    ITERATIONS = (
        "stopped at the maximum of iterations above the tolerance. Raise simulator.iterations for accuracy, or "
        "simulator.steps for fast motion"
    )
    PRECISION = (
        "made no further progress in this floating-point precision. Use simulator.precision=float64, or a larger "
        "simulator.tolerance"
    )
    NOT_FINITE = (
        "the energy of the present frame is not finite, so there is no next one; the cloth stays where it is. Look "
        "for impossible pins or a damaged initial state"
    )
    NOT_PREDICTED = (
        "the network predicts numbers that are not finite; the cloth stays where it is. The motion is unlike anything "
        "that it was trained on: train longer, or use simulator=implicit"
    )
    BLOCKED = (
        "found no way on that crosses nothing, and end with crossing faces. Look for a body that passes through itself "
        "or moves very fast, raise simulator.steps or simulator.iterations, or take contact=surface"
    )


@dataclass(frozen=True)
class StepResult:
    """A frame and how it was found."""

    state: State
    outcome: Outcome
    iterations: int
    """Evaluations of the incremental potential with its gradient."""
    residual: float
    """Mean norm of the gradient over the free vertices [N]: what the forces miss to balance."""
    energies: dict[str, float] = field(default_factory=dict)
    """Energy of each term at the end of the (last) step [J]."""
    steps: int = 1
    """Time steps that the frame was cut into."""


@runtime_checkable
class Simulator(Protocol):
    """Turns the scene that it was made for into frames."""

    def step(self, state: State, frame: int) -> StepResult:
        """The state at frame ``frame + 1`` from that at ``frame``."""
        ...


def barrier_of(simulator: Simulator) -> Barrier | None:
    """The barrier that lets nothing cross in its frames; None where there is no such thing."""
    return getattr(simulator, "barrier", None)
