"""What the compiled kernels are written with: settings of the compiler, blocks of edges, series.

Loops over the edges of a block without calls, jumps and scattered memory become vector instructions. All that such a
loop needs lies in one buffer, quantity after quantity: what the compiler knows not to overlap, it need not check.

The compiled form lies beside the source (or in the user's cache where that cannot be written), and is made anew when
the file of the compiled function changes, not when this file or a constant of another does: then delete
``__pycache__``.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import unwrap

from numba import njit

SETTINGS = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}, "no_cfunc_wrapper": True}
"""Sums in any order; but what is not a number stays so: a solver has to see it."""


def inlined(function: Callable) -> Callable:
    """For parts of compiled functions of the same file, and of this one; Python itself cannot call them.

    What was left as a call would be linked to other machine code in the process that compiles than in those that read
    the compiled form: other last bits, and an animation that was interrupted in its first run would go on differently.
    """
    return njit(**SETTINGS, no_cpython_wrapper=True, forceinline=True)(unwrap(function))


def compiled(function: Callable) -> Callable:
    """For functions that Python calls. Whatever checks annotations is taken off: it cannot be compiled."""
    try:
        return njit(**SETTINGS, cache=True)(unwrap(function))
    except RuntimeError:  # nowhere to write: then every process compiles for itself
        return njit(**SETTINGS)(unwrap(function))


BLOCK = 64
"""Edges of a block: few enough for the fastest memory."""


@inlined
def series(z, coefficients):
    """``Σ_k coefficients[k] z^k``."""
    total = coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        total = total * z + coefficients[k]
    return total
