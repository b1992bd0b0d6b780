"""Points of a cloth against the faces of a body that they are near to, compiled: contact, friction, their Hessians.

``y_p = Σ_c weights[p, c] x[vertices[p, c]]``; what the energies are stands with the terms of the same names.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from drape.compiled import compiled, inlined


class Points(NamedTuple):
    """Points, and the place on the body that each is near to at the end of a step."""

    vertices: np.ndarray
    """``points 3``"""
    weights: np.ndarray
    place: np.ndarray
    """[m]"""
    normal: np.ndarray
    tangents: np.ndarray
    """``points 2 3``"""
    along: np.ndarray
    """Offset along the tangents at the start [m]; ``points 2``."""


@inlined
def _arm(x, points, p):
    """From the place on the body to the point."""
    i, j, k = points.vertices[p, 0], points.vertices[p, 1], points.vertices[p, 2]
    u, v, w = points.weights[p, 0], points.weights[p, 1], points.weights[p, 2]
    return (
        u * x[i, 0] + v * x[j, 0] + w * x[k, 0] - points.place[p, 0],
        u * x[i, 1] + v * x[j, 1] + w * x[k, 1] - points.place[p, 1],
        u * x[i, 2] + v * x[j, 2] + w * x[k, 2] - points.place[p, 2],
    )


@compiled
def contact(x, points, stiffness, thickness):
    """``Σ k max(thickness - d, 0)³`` [J], and its gradient in ``x`` [N]."""
    energy, gradient = 0.0, np.zeros(x.shape)
    for p in range(len(stiffness)):
        arm, normal = _arm(x, points, p), points.normal[p]
        depth = thickness - (arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2])
        if depth <= 0.0:
            continue
        push = 3.0 * stiffness[p] * depth * depth
        energy += push * depth / 3.0
        for corner in range(3):
            share = points.weights[p, corner] * push
            for axis in range(3):
                gradient[points.vertices[p, corner], axis] -= share * normal[axis]
    return energy, gradient


@compiled
def contact_blocks(x, points, stiffness, thickness):
    """The points that are pushed, and their Hessians ``6 k (thickness - d) n nᵀ`` [N/m]."""
    pushed, blocks, count = np.empty(len(stiffness), np.int64), np.empty((len(stiffness), 3, 3)), 0
    for p in range(len(stiffness)):
        arm, normal = _arm(x, points, p), points.normal[p]
        depth = thickness - (arm[0] * normal[0] + arm[1] * normal[1] + arm[2] * normal[2])
        if depth <= 0.0:
            continue
        for row in range(3):
            for column in range(3):
                blocks[count, row, column] = 6.0 * stiffness[p] * depth * normal[row] * normal[column]
        pushed[count] = p
        count += 1
    return pushed[:count], blocks[:count]


@inlined
def _slip(x, points, p):
    """Slip of a point along the tangents."""
    arm, tangents = _arm(x, points, p), points.tangents[p]
    u = arm[0] * tangents[0, 0] + arm[1] * tangents[0, 1] + arm[2] * tangents[0, 2] - points.along[p, 0]
    v = arm[0] * tangents[1, 0] + arm[1] * tangents[1, 1] + arm[2] * tangents[1, 2] - points.along[p, 1]
    return u, v, math.sqrt(u * u + v * v)


@compiled
def friction(x, points, force, end):
    """``Σ force f(|u|)`` [J], u the slip of a point, and its gradient in ``x`` [N]; see :class:`Friction`.

    ``end``: the slip from which friction is full [m].
    """
    energy, gradient = 0.0, np.zeros(x.shape)
    for p in range(len(force)):
        (u, v, size), tangents = _slip(x, points, p), points.tangents[p]
        rate = 1.0 / size if size > end else (2.0 - size / end) / end
        energy += force[p] * (size - end / 3.0 if size > end else size * size * (1.0 - size / (3.0 * end)) / end)
        u, v = force[p] * rate * u, force[p] * rate * v
        for corner in range(3):
            share, vertex = points.weights[p, corner], points.vertices[p, corner]
            for axis in range(3):
                gradient[vertex, axis] += share * (u * tangents[0, axis] + v * tangents[1, axis])
    return energy, gradient


@compiled
def friction_blocks(x, points, force, end):
    """Their Hessians ``force Tᵀ (f'/|u| I + (f'' - f'/|u|) û ûᵀ) T`` [N/m]."""
    blocks = np.empty((len(force), 3, 3))
    for p in range(len(force)):
        (u, v, size), tangents = _slip(x, points, p), points.tangents[p]
        rate = 1.0 / size if size > end else (2.0 - size / end) / end
        drop = 1.0 / size if size > end else size / (end * end)
        u, v = (u / size, v / size) if size > 1e-9 * end else (0.0, 0.0)
        uu, uv, vv = force[p] * (rate - drop * u * u), -force[p] * drop * u * v, force[p] * (rate - drop * v * v)
        for row in range(3):
            first, second = tangents[0, row], tangents[1, row]
            for column in range(3):
                by_first, by_second = uu * first + uv * second, uv * first + vv * second
                blocks[p, row, column] = by_first * tangents[0, column] + by_second * tangents[1, column]
    return blocks


@compiled
def add_blocks(corners, points, first, carrier, weights, blocks, data, places):
    """Add ``w_a w_b B`` of each point to the entries of one kind to the entries of its vertex, edge or face.

    Of ``points``, rows of a surface, those of the kind stand from the row ``first`` on, one for each of ``carrier``;
    ``data`` and ``places`` are those of :class:`drape.linalg.stencil_sum.Filled`.
    """
    for p in range(len(points)):
        row_of_kind, place = points[p] - first, 0
        if row_of_kind < 0 or row_of_kind >= len(carrier):
            continue
        for row in range(3 * corners):
            for column in range(row, 3 * corners):
                a, b = row // 3, column // 3
                value = weights[points[p], a] * weights[points[p], b] * blocks[p, row - 3 * a, column - 3 * b]
                data[places[carrier[row_of_kind], place]] += value
                place += 1
