"""The deformation of edges and the forces that their slopes are, compiled: :class:`EdgeDeformation` in two passes."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from drape.energy.baked_kernel_vectors import (
    BLOCK,
    add,
    add_pulled,
    compiled,
    cross,
    difference,
    dot,
    inlined,
    load,
    row,
    series,
    store,
    sum_of_three,
    sum_of_two,
)
from drape.scene.geometry import TINY

DIRECTION, NORMAL_I, NORMAL_J, ON_I, ON_J, ON_EDGE = (3 * BLOCK * k for k in range(6))
INVERSE_LENGTH, E_I, E_J, C_I, C_J, SINE, COSINE, UPRIGHT, END = (BLOCK * k for k in range(18, 27))

EIGHTH_TURN_HALVED = math.tan(math.pi / 8.0)


def _arctangent(square: np.ndarray) -> np.ndarray:
    """``atan(t)/t`` of ``t²``."""
    tangent = np.sqrt(square)
    return np.arctan(tangent) / tangent


_FIT = Chebyshev.interpolate(_arctangent, 12, [0.0, EIGHTH_TURN_HALVED**2])
ARCTANGENT = tuple(_FIT.convert(kind=Polynomial).coef.tolist())
"""Series of ``atan(t)/t`` in t² for ``|t| < tan(π/8)``; error below 1e-16."""


@inlined
def arctangent(y, x):
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
def _wrapped(angle):
    return angle - 2.0 * math.pi * np.rint(angle / (2.0 * math.pi))


@inlined
def _cosine_of(sine):
    square = 1.0 - sine * sine
    return math.sqrt((0.0 if square < 0.0 else square) + TINY * TINY)


@inlined
def _normals(x, faces, smallest):
    """Unit vertex normals, and one over what they were divided by."""
    normals, inverse_sizes = np.zeros(x.shape), np.empty(len(x))
    for f in range(len(faces)):
        i, j, k = row(faces, f)
        normal = cross(difference(x, i, j), difference(x, i, k))
        add(normals, i, 1.0, normal)
        add(normals, j, 1.0, normal)
        add(normals, k, 1.0, normal)
    for v in range(len(x)):
        total = row(normals, v)
        inverse_sizes[v] = 1.0 / math.sqrt(dot(total, total) + (smallest * smallest / TINY) ** 2)
        for axis in range(3):
            normals[v, axis] *= inverse_sizes[v]
    return normals, inverse_sizes


@inlined
def _gather(x, normals, edges, buffer):
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        store(buffer, DIRECTION, e, difference(x, i, j))
        store(buffer, NORMAL_I, e, row(normals, i))
        store(buffer, NORMAL_J, e, row(normals, j))


@inlined
def _frames(buffer, smallest):
    for e in range(BLOCK):
        vector, n_i, n_j = load(buffer, DIRECTION, e), load(buffer, NORMAL_I, e), load(buffer, NORMAL_J, e)
        inverse = 1.0 / math.sqrt(dot(vector, vector) + smallest * smallest)
        y = (vector[0] * inverse, vector[1] * inverse, vector[2] * inverse)
        e_i, e_j = dot(n_i, y), dot(n_j, y)
        store(buffer, DIRECTION, e, y)
        buffer[INVERSE_LENGTH + e] = inverse
        buffer[E_I + e], buffer[E_J + e] = e_i, e_j
        buffer[C_I + e], buffer[C_J + e] = _cosine_of(e_i), _cosine_of(e_j)
        sine, cosine = dot(cross(n_j, n_i), y), dot(n_i, n_j) - e_i * e_j
        buffer[SINE + e], buffer[COSINE + e] = sine, cosine
        buffer[UPRIGHT + e] = math.sqrt(sine * sine + cosine * cosine + TINY * TINY)


@inlined
def _deformations(buffer, rest, q):
    for e in range(BLOCK):
        e_i, e_j, c_i, c_j = buffer[E_I + e], buffer[E_J + e], buffer[C_I + e], buffer[C_J + e]
        q[0, e] = 1.0 / buffer[INVERSE_LENGTH + e] - rest[0, e]
        q[1, e] = _wrapped(arctangent(buffer[SINE + e], buffer[COSINE + e]) - rest[1, e])
        # the difference of two elevations as the angle of one pair
        q[2, e] = _wrapped(arctangent(e_i * c_j - e_j * c_i, c_i * c_j + e_i * e_j) - rest[2, e])
        q[3, e] = buffer[UPRIGHT + e]


@inlined
def _pull(buffer, slopes):
    for e in range(BLOCK):
        y, n_i, n_j = load(buffer, DIRECTION, e), load(buffer, NORMAL_I, e), load(buffer, NORMAL_J, e)
        sine, cosine, upright = buffer[SINE + e], buffer[COSINE + e], buffer[UPRIGHT + e]
        turn, lift = slopes[1, e] / (upright * upright), slopes[3, e] / upright
        by_sine, by_cosine = turn * cosine + lift * sine, lift * cosine - turn * sine
        by_e_i = slopes[2, e] / buffer[C_I + e] - by_cosine * buffer[E_J + e]
        by_e_j = -slopes[2, e] / buffer[C_J + e] - by_cosine * buffer[E_I + e]
        store(buffer, ON_I, e, sum_of_three(by_sine, cross(y, n_j), by_cosine, n_j, by_e_i, y))
        store(buffer, ON_J, e, sum_of_three(by_sine, cross(n_i, y), by_cosine, n_i, by_e_j, y))
        on_y = sum_of_three(by_sine, cross(n_j, n_i), by_e_i, n_i, by_e_j, n_j)
        inverse = buffer[INVERSE_LENGTH + e]
        along = slopes[0, e] - dot(y, on_y) * inverse
        store(buffer, ON_EDGE, e, sum_of_two(along, y, inverse, on_y))


@inlined
def _scatter(buffer, edges, on_normals, gradient):
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        add(on_normals, i, 1.0, load(buffer, ON_I, e))
        add(on_normals, j, 1.0, load(buffer, ON_J, e))
        on_edge = load(buffer, ON_EDGE, e)
        add(gradient, i, -1.0, on_edge)
        add(gradient, j, 1.0, on_edge)


@compiled
def deformations(x, faces, edges, rest, smallest):
    """``(Δl, α, β, upright)`` [blocks, 4, BLOCK], vertex normals, and one over their sizes; ``rest`` as q, of the rest.

    ``smallest`` [m]: lengths are rounded up by it.
    """
    normals, inverse_sizes = _normals(x, faces, smallest)
    q, buffer = np.empty((len(rest), 4, BLOCK)), np.zeros(END)
    for block in range(len(rest)):
        _gather(x, normals, edges[block * BLOCK : (block + 1) * BLOCK], buffer)
        _frames(buffer, smallest)
        _deformations(buffer, rest[block], q[block])
    return q, normals, inverse_sizes


@compiled
def forces(x, faces, edges, normals, inverse_sizes, slopes, smallest):
    """``(∂q/∂x)ᵀ slopes``, from the slopes in q [blocks, 4, BLOCK] and what :func:`deformations` gave."""
    gradient, on_normals, buffer = np.zeros(x.shape), np.zeros(x.shape), np.zeros(END)
    for block in range(len(slopes)):
        near = edges[block * BLOCK : (block + 1) * BLOCK]
        _gather(x, normals, near, buffer)
        _frames(buffer, smallest)
        _pull(buffer, slopes[block])
        _scatter(buffer, near, on_normals, gradient)
    for v in range(len(x)):  # from the normals to the sums that they were made from
        along = dot(row(normals, v), row(on_normals, v))
        for axis in range(3):
            on_normals[v, axis] = (on_normals[v, axis] - normals[v, axis] * along) * inverse_sizes[v]
    for f in range(len(faces)):
        face = row(faces, f)
        i, j, k = face
        sides = difference(x, i, j), difference(x, i, k)
        on_face = sum_of_three(1.0, row(on_normals, i), 1.0, row(on_normals, j), 1.0, row(on_normals, k))
        add_pulled(gradient, face, sides, on_face)
    return gradient
