"""The cantilever test of bending: a strip is pushed over an edge until its tip is 41.5 degrees below (ASTM D1388)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from drape.benchmark.elastica import bending_lengths
from drape.benchmark.sample import GRAVITY, Sample
from drape.benchmark.triangular_sheet import triangular_sheet
from drape.errors import DrapeError
from drape.scene.pins import Pins

ANGLE = 41.5
"""Of the plane that the tip touches, below the horizontal [degrees]."""
CLOSE = 0.1
"""Tolerance of the angle of a strip [degrees]."""
FIRST = 0.04
"""Overhang that is tried first [m]."""
WIDTH = 2.0
"""Of a strip, in overhangs."""
ROUNDS = 20
"""Overhangs that are tried, at most."""


@dataclass(frozen=True)
class Bent:
    """A strip at rest over the edge."""

    overhang: float
    """[m]"""
    angle: float
    """Of the line from the edge to the tip, below the horizontal [degrees]."""
    profile: Float[np.ndarray, "columns 2"]
    """Along and up from the edge, the mean of each column of vertices across the strip [m]."""
    areal_density: float
    """[kg/m²]"""

    @property
    def bending_length(self) -> float:
        """Half of the overhang [m], of a strip at 41.5 degrees: the c of data sheets."""
        return 0.5 * self.overhang

    @property
    def flexural_rigidity(self) -> float:
        """G = ρ g c³ [N m]."""
        return self.areal_density * GRAVITY * self.bending_length**3


def bending_test(sample: Sample, cells: int) -> Bent:
    """The strip of which the tip is 41.5 degrees below the edge, with ``cells`` edges along it.

    Theory says from each strip which is the next to try; at the end only the measured angle counts.

    Raises:
        DrapeError: no strip comes near, or see :meth:`Sample.at_rest`.
    """
    overhang, wanted = FIRST, bending_lengths(ANGLE)
    for _ in range(ROUNDS):
        bent = bend(sample, overhang, cells)
        if abs(bent.angle - ANGLE) <= CLOSE:
            return bent
        overhang *= wanted / bending_lengths(bent.angle)
    raise DrapeError(
        f"fabric card: strips of {sample.material.name}: found {bent.angle:.1f} degrees at {overhang:.3g} m; expected "
        f"some overhang with {ANGLE} degrees; the law does not resist bending as a fabric does"
    )


def bend(sample: Sample, overhang: float, cells: int) -> Bent:
    """A strip that reaches ``overhang`` [m] over the edge, at rest.

    It is twice as wide, more than the standard's 25 mm: hinges beside its hems stand for less cloth than others, and
    count for less the more there are. Two columns of vertices are held. The hinges across the second stand for the half
    cells on both its sides, so the edge is half a cell before it.
    """
    cell = overhang / (cells + 0.5)
    mesh, column = triangular_sheet((cells + 1) * cell, WIDTH * overhang, cells + 1)
    rest = np.asarray(mesh.rest_positions, np.float64)
    scene = sample.scene("cantilever test", mesh, rest, pins=Pins.fixed(np.flatnonzero(column < 2), rest))
    x = sample.at_rest(scene).x
    profile = np.stack([np.bincount(column, x[:, k]) for k in (0, 2)], 1) / np.bincount(column)[:, None]
    profile -= [0.5 * cell, 0.0]
    angle = float(np.degrees(np.arctan2(-profile[-1, 1], profile[-1, 0])))
    return Bent(overhang, angle, profile, sample.areal_density)
