"""Input arrays of the compiled kernels of springs and hinges: splines of a law, edges of a mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Tables(NamedTuple):
    """The two splines of a law; see :class:`BakedHinges`."""

    taps: np.ndarray
    """A row for each cell: the 4 x 4 coefficients of K around it, then those of B."""
    first_u: int
    """Number of the first node in u; nodes stand at whole numbers of steps."""
    first_v: int
    nodes_u: int
    nodes_v: int
    step_u: float
    step_v: float
    stretch_scale: float
    angle_scale: float


class Edges(NamedTuple):
    """The edges of a mesh, as many as fill whole blocks."""

    corners: np.ndarray
    """``edges 4``: both ends, then the opposite corners of both faces; twice the same one on a boundary."""
    inner: np.ndarray
    """1.0 where there are two faces, else 0.0."""
    rest_length: np.ndarray
    rest_angle: np.ndarray
    size: np.ndarray
    """S of each edge: see :class:`EdgeScale`."""
    share: np.ndarray
    """Share of its energy that counts; 0 of edges that only fill up a block."""
    rest_square1: np.ndarray
    """Square of twice the area at rest of the one face [m⁴], and of the other."""
    rest_square2: np.ndarray
