"""Parts of the compiled kernels: settings of the compiler, blocks of edges, series.

Loops over the edges of a block without calls, jumps and scattered memory become vector instructions. All that such a
loop needs lies in one buffer, quantity after quantity: what the compiler knows not to overlap, it need not check.

The compiled form lies beside the source (or in the user's cache where that cannot be written), and is made anew when
the file of the compiled function changes, not when this file or a constant of another does: then delete
``__pycache__``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from inspect import unwrap
from typing import Any

import numpy as np
from numba import njit
from numpy.polynomial import Chebyshev, Polynomial

SETTINGS: dict[str, Any] = {
    "error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}, "no_cfunc_wrapper": True
}  # fmt: skip
"""Sums in any order; but what is not a number stays so: a solver has to see it."""


def inlined(function: Callable) -> Callable:
    """For parts of compiled functions of the same file, and of this one; Python itself cannot call them.

    What was left as a call would be linked to other machine code in the process that compiles than in those that read
    the compiled form: other last bits, and an animation that was interrupted in its first run would go on differently.
    """
    settings = SETTINGS | {"no_cpython_wrapper": True, "forceinline": True}
    return njit(**settings)(unwrap(function))


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


LOGARITHM = tuple(2.0 / (2 * k + 1) for k in range(10))
"""Series to the last digit of ``ln((1 + s)/(1 - s))/s`` in s² for ``|s| < 0.172``."""
LN_2, SQRT_2 = math.log(2.0), math.sqrt(2.0)
MANTISSA, ONE = (1 << 52) - 1, 1023 << 52
EIGHTH_TURN_HALVED = math.tan(math.pi / 8.0)


def _arctangent(square: np.ndarray) -> np.ndarray:
    """``atan(t)/t`` of ``t²``."""
    tangent = np.sqrt(square)
    return np.arctan(tangent) / tangent


ARCTANGENT = tuple(
    Chebyshev.interpolate(_arctangent, 12, [0.0, EIGHTH_TURN_HALVED**2]).convert(kind=Polynomial).coef.tolist()
)
"""Series of ``atan(t)/t`` in t² for ``|t| < tan(π/8)``; error below 1e-16."""


@inlined
def logarithm(x):
    """Of a positive number; exact to some 1e-16 in absolute terms near 1."""
    bits = np.float64(x).view(np.int64)
    part = np.int64((bits & MANTISSA) | ONE).view(np.float64)
    large = part > SQRT_2
    part = 0.5 * part if large else part
    exponent = np.float64((bits >> 52) - 1023) + (1.0 if large else 0.0)
    s = (part - 1.0) / (part + 1.0)
    return exponent * LN_2 + s * series(s * s, LOGARITHM)


@inlined
def arctangent2(y, x):
    """``atan2(y, x)`` to the last digit or two, without jumps."""
    a, b = abs(y), abs(x)
    low, high = (a, b) if a < b else (b, a)
    far = low > EIGHTH_TURN_HALVED * high  # then the angle to the diagonal
    above = low - high if far else low
    below = low + high if far else high
    t = above / (below if below != 0.0 else 1.0)
    angle = t * series(t * t, ARCTANGENT) + (0.25 * math.pi if far else 0.0)
    angle = 0.5 * math.pi - angle if a > b else angle
    angle = math.pi - angle if x < 0.0 else angle
    return math.copysign(angle, y)


@inlined
def basis(f):
    """The weights of the four coefficients of a cubic spline around the place ``f`` of a cell of unit length."""
    g = 1.0 - f
    low, high = (0.5 * f - 1.0) * f * f + 2.0 / 3.0, (0.5 * g - 1.0) * g * g + 2.0 / 3.0
    return g * g * g / 6.0, low, high, f * f * f / 6.0


@inlined
def basis_slopes(f):
    """Their first derivatives."""
    g = 1.0 - f
    return -0.5 * g * g, (1.5 * f - 2.0) * f, (2.0 - 1.5 * g) * g, 0.5 * f * f


@inlined
def basis_curvatures(f):
    """Their second derivatives."""
    g = 1.0 - f
    return g, 3.0 * f - 2.0, 3.0 * g - 2.0, f
