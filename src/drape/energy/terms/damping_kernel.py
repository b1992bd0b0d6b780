"""Axial dampers of edges and the drag of the air on vertices, compiled."""

from __future__ import annotations

import numpy as np

from drape.compiled import compiled


@compiled
def damping(x, start, edges, direction, axial, drag):
    """``Σ ½ axial ((e - e_start)·y)² + Σ ½ drag |x - x_start|²`` [J], and its gradient in ``x`` [N].

    Over edges and vertices; both factors in kg/s², y the ``direction``.
    """
    energy, gradient = 0.0, np.empty(x.shape)
    for i in range(len(x)):
        square = 0.0
        for axis in range(3):
            moved = x[i, axis] - start[i, axis]
            gradient[i, axis] = drag[i] * moved
            square += moved * moved
        energy += 0.5 * drag[i] * square
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        rate = 0.0
        for axis in range(3):
            rate += ((x[j, axis] - start[j, axis]) - (x[i, axis] - start[i, axis])) * direction[e, axis]
        energy += 0.5 * axial * rate * rate
        for axis in range(3):
            pull = axial * rate * direction[e, axis]
            gradient[i, axis] -= pull
            gradient[j, axis] += pull
    return energy, gradient


@compiled
def add_hessian(data, places, direction, axial):
    """Add ``axial y yᵀ`` of each edge to the entries of a matrix: see :class:`drape.linalg.stencil_sum.Filled`."""
    for e in range(len(direction)):
        place = 0
        for row in range(6):
            for column in range(row, 6):
                value = axial * direction[e, row % 3] * direction[e, column % 3]
                data[places[e, place]] += value if row // 3 == column // 3 else -value
                place += 1
