"""What the compiled kernels are written with: settings of the compiler, blocks of edges, vectors of three, series.

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


@inlined
def load(buffer, place, e):
    """The vector of edge ``e`` whose components stand from ``place`` on, one block each."""
    return buffer[place + e], buffer[place + BLOCK + e], buffer[place + 2 * BLOCK + e]


@inlined
def store(buffer, place, e, a):
    """Put ``a`` where :func:`load` finds it."""
    buffer[place + e] = a[0]
    buffer[place + BLOCK + e] = a[1]
    buffer[place + 2 * BLOCK + e] = a[2]


@inlined
def row(x, i):
    """``x[i]``."""
    return x[i, 0], x[i, 1], x[i, 2]


@inlined
def difference(x, i, j):
    """``x[j] - x[i]``."""
    return x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]


@inlined
def add(total, i, factor, a):
    """``total[i] += factor a``."""
    total[i, 0] += factor * a[0]
    total[i, 1] += factor * a[1]
    total[i, 2] += factor * a[2]


@inlined
def dot(a, b):
    """``a·b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """``a x b``."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def sum_of_two(s, a, t, b):
    """``s a + t b``."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@inlined
def sum_of_three(s, a, t, b, u, c):
    """``s a + t b + u c``."""
    return s * a[0] + t * b[0] + u * c[0], s * a[1] + t * b[1] + u * c[1], s * a[2] + t * b[2] + u * c[2]


@inlined
def add_pulled(gradient, face, sides, on_normal):
    """Add what ``on_normal``, the slopes in ``sides[0] x sides[1]`` of a face, is at its corners."""
    second, third = cross(sides[1], on_normal), cross(on_normal, sides[0])
    add(gradient, face[0], -1.0, second)
    add(gradient, face[0], -1.0, third)
    add(gradient, face[1], 1.0, second)
    add(gradient, face[2], 1.0, third)
