"""Barrier of incremental potential contact (Li et al. 2020): the pressure at a distance, and how stiff it has to be.

Surfaces nearer than ``reach`` (d̂ of the paper) push each other apart. The energy of a pair of primitives at a distance
d (a vertex and a face, two edges) is, with r = d / d̂,

    E = w κ d̂ b(r) [J],    b(r) = -(1 - r²)² ln r²,    -d̂ db/dd = φ(r) = 2 (1 - r²)² / r - 8 r (1 - r²) ln r,

where κ is the stiffness [Pa] and w a quarter of the area at rest of the vertex or of the two edges [m²]. (ipctk: the
physical barrier with area weighting.) Two sheets at d feel the pressure ``coverage · κ · φ(r)`` [Pa], on average.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError


def push(r: Float[np.ndarray, " pairs"] | float) -> Float[np.ndarray, " pairs"] | float:
    """φ(r), falls from infinity at r = 0 to 0 at r = 1; 1.8 at 0.7, 4.3 at 0.5, 8.2 at 0.3."""
    return 2.0 * (1.0 - r**2) ** 2 / r - 8.0 * r * (1.0 - r**2) * np.log(r)


def push_slope(r: Float[np.ndarray, " pairs"]) -> Float[np.ndarray, " pairs"]:
    """dφ/dr, negative: the barrier is convex in the distance."""
    return -8.0 * (1.0 - 3.0 * r**2) * np.log(r) - 16.0 * (1.0 - r**2) - 2.0 * ((1.0 - r**2) / r) ** 2


def coverage(reach: float, edge: float) -> float:
    """Pairs that act at a place, in units of whole areas; ``edge`` is the mean length of edges [m].

    Measured on two sheets whose edges differ by up to a half, turned against each other, for reaches of 0.05 to 0.6
    edges: within 15 %. It is three times that where two equal meshes lie vertex on vertex, as each meets six faces.
    """
    return 1.7 + 4.4 * reach / edge


def stiffness_for(pressure: float, reach: float, edge: float, share: float = 0.5) -> float:
    """κ [Pa] of the barrier under which sheets pressed together by ``pressure`` [Pa] rest at ``share`` of the reach.

    The pressure of one sheet that lies on another is areal density · gravity; a sheet that is stopped within a step
    adds areal density · speed / dt. As κ is proportional to the pressure, light and heavy cloth behave alike, and the
    stiffness of the contact against that of inertia, ``κ |dφ/dr| / d̂`` against ``areal density / dt²``, depends on the
    reach and the step only.

    Raises:
        DrapeError: a pressure or a length that is not positive, a share that is not between 0 and 1.
    """
    if not (all(0.0 < number < math.inf for number in (pressure, reach, edge)) and 0.0 < share < 1.0):
        raise DrapeError(
            f"contact: pressure {pressure} Pa at {share} of a reach of {reach} m, edges of {edge} m; expected positive "
            "numbers and a share between 0 and 1 (one sheet on another presses with areal density times gravity)"
        )
    return pressure / (coverage(reach, edge) * float(push(share)))
