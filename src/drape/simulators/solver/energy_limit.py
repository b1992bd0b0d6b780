"""Limit velocities so that undriven cloth gains no energy."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from drape.scene.state import State

TINY = float(np.finfo(np.float64).tiny)


def without_gain(
    before: State,
    after: State,
    released: float,
    mass: Float[np.ndarray, " vertices"],
    free: Bool[np.ndarray, " vertices"],
    rounding: float,
) -> State:
    """``after`` with velocities that need no more energy than ``before`` had and the step ``released`` [J].

    A step of implicit Euler loses energy where the stored energy is convex, ``E(x) - E(x') >= ∇E(x')·(x - x')``. Where
    inertia carries a cloth through its own folds it is not, and a step may also end far from the minimum when its
    iterations do. Then the motion relative to the centre of mass (or to the pins) is slowed down to what there is; a
    step that goes down the incremental potential from ``before`` leaves at least the energy of its inertia term for it.

    Args:
        before: at the start of the step.
        after: at its end.
        released: stored energy at the start minus that at the end [J].
        mass: [kg]
        free: False where a vertex is pinned.
        rounding: excess that means nothing [J].
    """
    excess = _kinetic(after.v, mass) - _kinetic(before.v, mass) - released
    if not excess > rounding:
        return after
    whole = mass @ after.v / mass.sum() if free.all() else np.zeros(3)
    inner = after.v - whole
    left = max(0.0, _kinetic(inner, mass) - excess)
    return State(after.x, whole + inner * np.sqrt(left / max(_kinetic(inner, mass), TINY)))


def _kinetic(v: Float[np.ndarray, "vertices 3"], mass: Float[np.ndarray, " vertices"]) -> float:
    return 0.5 * float((mass[:, None] * v**2).sum())
