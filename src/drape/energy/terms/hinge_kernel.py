"""Springs and hinges of a baked law, compiled: energies, forces, and the Hessian straight into a sparse matrix.

Each edge is visited once, in blocks: its four corners are gathered, all that follows from them is computed by vector
instructions, and the forces are added to the corners. The first call in an installation compiles this, some seconds;
from then on it is read from the disk.
"""

from __future__ import annotations

import math

import numpy as np

from drape.compiled import (
    BLOCK,
    arctangent2,
    basis,
    basis_curvatures,
    basis_slopes,
    compiled,
    inlined,
    logarithm,
)
from drape.energy.law.baked.spline_plane import MARGIN
from drape.geometry.edge_geometry import HALF_TURN, TINY
from drape.geometry.rest_shape import FADED

EDGE, ARM1, ARM2, NORMAL1, NORMAL2 = (3 * BLOCK * k for k in range(5))
ON_END, ON_THIRD, ON_FOURTH = (3 * BLOCK * k for k in range(5, 8))
LENGTH, SQUARE1, SQUARE2, STRETCH, ANGLE, U, V, AT_Z, AT_Y, BY_Z, BY_Y, FOOT1, FOOT2, TURN, PART1, PART2, END = (
    BLOCK * k for k in range(24, 41)
)
K, K_U, K_V, K_UU, K_UV, K_VV, B, B_U, B_V, B_UU, B_UV, B_VV, SUMS = (BLOCK * k for k in range(13))
"""Offsets of the quantities of a block: of its geometry, and of its two splines with their derivatives."""


@inlined
def _gather(x, corners, buffer):
    for e in range(BLOCK):
        i, j, k, m = corners[e, 0], corners[e, 1], corners[e, 2], corners[e, 3]
        for axis in range(3):
            origin = x[i, axis]
            buffer[EDGE + axis * BLOCK + e] = x[j, axis] - origin
            buffer[ARM1 + axis * BLOCK + e] = x[k, axis] - origin
            buffer[ARM2 + axis * BLOCK + e] = x[m, axis] - origin


@inlined
def _fading(part):
    """``f(t)`` of :meth:`HingeShape.change`, of t."""
    return part * part * (3.0 - 2.0 * part)


@inlined
def _deform(buffer, inner, rest_length, rest_angle, size, rest_square1, rest_square2, stretch_scale, angle_scale):
    """Length and angle of each edge, scaled, and what their slopes need."""
    for e in range(BLOCK):
        d0, d1, d2 = buffer[EDGE + e], buffer[EDGE + BLOCK + e], buffer[EDGE + 2 * BLOCK + e]
        a0, a1, a2 = buffer[ARM1 + e], buffer[ARM1 + BLOCK + e], buffer[ARM1 + 2 * BLOCK + e]
        b0, b1, b2 = buffer[ARM2 + e], buffer[ARM2 + BLOCK + e], buffer[ARM2 + 2 * BLOCK + e]
        n0, n1, n2 = d1 * a2 - d2 * a1, d2 * a0 - d0 * a2, d0 * a1 - d1 * a0
        m0, m1, m2 = b1 * d2 - b2 * d1, b2 * d0 - b0 * d2, b0 * d1 - b1 * d0
        length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + TINY * TINY * rest_length[e] * rest_length[e])
        square1 = n0 * n0 + n1 * n1 + n2 * n2 + TINY * TINY * rest_square1[e]
        square2 = m0 * m0 + m1 * m1 + m2 * m2 + TINY * TINY * rest_square2[e]
        cosine = n0 * m0 + n1 * m1 + n2 * m2
        sine = -(n0 * b0 + n1 * b1 + n2 * b2) * length
        angle = arctangent2(sine, cosine) - rest_angle[e]
        angle = inner[e] * (angle - 2.0 * math.pi * np.rint(angle / (2.0 * math.pi)))
        angle = angle if angle > HALF_TURN - math.pi else -angle
        part1 = math.sqrt(min(square1 / (FADED * FADED * rest_square1[e]), 1.0))
        part2 = math.sqrt(min(square2 / (FADED * FADED * rest_square2[e]), 1.0))
        buffer[TURN + e], buffer[PART1 + e], buffer[PART2 + e] = angle, part1, part2
        angle *= _fading(part1) * _fading(part2)
        buffer[NORMAL1 + e], buffer[NORMAL1 + BLOCK + e], buffer[NORMAL1 + 2 * BLOCK + e] = n0, n1, n2
        buffer[NORMAL2 + e], buffer[NORMAL2 + BLOCK + e], buffer[NORMAL2 + 2 * BLOCK + e] = m0, m1, m2
        buffer[FOOT1 + e], buffer[FOOT2 + e] = a0 * d0 + a1 * d1 + a2 * d2, b0 * d0 + b1 * d1 + b2 * d2
        buffer[LENGTH + e], buffer[SQUARE1 + e], buffer[SQUARE2 + e] = length, square1, square2
        z = (length - rest_length[e]) / (size[e] * stretch_scale)
        y = angle / (size[e] * angle_scale)
        buffer[STRETCH + e], buffer[ANGLE + e] = z, y
        buffer[AT_Z + e], buffer[AT_Y + e] = math.sqrt(1.0 + z * z), 1.0 + y * y
        buffer[U + e] = math.copysign(logarithm(abs(z) + math.sqrt(1.0 + z * z)), z)
        buffer[V + e] = logarithm(1.0 + y * y)


@inlined
def _clamped(x, nodes):
    """As in :mod:`spline_plane`; what is not a number goes to the lower end: it must not be looked up elsewhere."""
    x = x if x > 1.0 - MARGIN else 1.0 - MARGIN
    return x if x < nodes + MARGIN - 2.001 else nodes + MARGIN - 2.001


@inlined
def _look_up(tables, buffer, rows):
    """Cells of the splines; the places inside them stay where u and v were."""
    for e in range(BLOCK):
        u = _clamped(buffer[U + e] / tables.step_u - tables.first_u, tables.nodes_u)
        v = _clamped(buffer[V + e] / tables.step_v - tables.first_v, tables.nodes_v)
        cell_u, cell_v = np.floor(u), np.floor(v)
        buffer[U + e], buffer[V + e] = u - cell_u, v - cell_v
        rows[e] = (np.int64(cell_u) + (MARGIN - 1)) * (tables.nodes_v + 2 * MARGIN - 3) + np.int64(cell_v) + MARGIN - 1


@inlined
def _along(t, k, w):
    return t[k] * w[0] + t[k + 1] * w[1] + t[k + 2] * w[2] + t[k + 3] * w[3]


@inlined
def _across(p, w):
    return p[0] * w[0] + p[1] * w[1] + p[2] * w[2] + p[3] * w[3]


@inlined
def _splines(tables, buffer, rows, sums, curved):
    """K and B of each edge with their derivatives in u and v, of second order too where ``curved``."""
    by_u, by_v = 1.0 / tables.step_u, 1.0 / tables.step_v
    for e in range(BLOCK):
        w_u, w_v = basis(buffer[U + e]), basis(buffer[V + e])
        d_u, d_v = basis_slopes(buffer[U + e]), basis_slopes(buffer[V + e])
        t = tables.taps[rows[e]]
        for part in range(2):
            k, place = 16 * part, K if part == 0 else B
            value = (_along(t, k, w_v), _along(t, k + 4, w_v), _along(t, k + 8, w_v), _along(t, k + 12, w_v))
            slope = (_along(t, k, d_v), _along(t, k + 4, d_v), _along(t, k + 8, d_v), _along(t, k + 12, d_v))
            sums[place + e] = _across(value, w_u)
            sums[place + BLOCK + e] = _across(value, d_u) * by_u
            sums[place + 2 * BLOCK + e] = _across(slope, w_u) * by_v
            if curved:
                c_u, c_v = basis_curvatures(buffer[U + e]), basis_curvatures(buffer[V + e])
                curve = (_along(t, k, c_v), _along(t, k + 4, c_v), _along(t, k + 8, c_v), _along(t, k + 12, c_v))
                sums[place + 3 * BLOCK + e] = _across(value, c_u) * by_u * by_u
                sums[place + 4 * BLOCK + e] = _across(slope, d_u) * by_u * by_v
                sums[place + 5 * BLOCK + e] = _across(curve, w_u) * by_v * by_v


@inlined
def _slopes(buffer, sums, size, share, energy, scales):
    """Energy of each edge [J], and its slopes in length and angle: ``½ K z² + ½ B y²``."""
    for e in range(BLOCK):
        z, y = buffer[STRETCH + e], buffer[ANGLE + e]
        zz, yy = 0.5 * z * z, 0.5 * y * y
        u_z, v_y = 1.0 / buffer[AT_Z + e], 2.0 * y / buffer[AT_Y + e]
        by_z = sums[K + e] * z + (sums[K + BLOCK + e] * zz + sums[B + BLOCK + e] * yy) * u_z
        by_y = sums[B + e] * y + (sums[K + 2 * BLOCK + e] * zz + sums[B + 2 * BLOCK + e] * yy) * v_y
        counted = share[e] * size[e]
        energy[e] = counted * size[e] * (sums[K + e] * zz + sums[B + e] * yy)
        buffer[BY_Z + e], buffer[BY_Y + e] = counted * by_z / scales[0], counted * by_y / scales[1]


@inlined
def _turns(buffer):
    """∂θ/∂x of the second end and of both opposite corners."""
    for e in range(BLOCK):
        length = buffer[LENGTH + e]
        tilt1, tilt2 = 1.0 / (length * buffer[SQUARE1 + e]), 1.0 / (length * buffer[SQUARE2 + e])
        foot1, foot2 = buffer[FOOT1 + e] * tilt1, buffer[FOOT2 + e] * tilt2
        high1, high2 = -length * length * tilt1, -length * length * tilt2
        for axis in range(3):
            n, m = buffer[NORMAL1 + axis * BLOCK + e], buffer[NORMAL2 + axis * BLOCK + e]
            buffer[ON_END + axis * BLOCK + e] = foot1 * n + foot2 * m
            buffer[ON_THIRD + axis * BLOCK + e] = high1 * n
            buffer[ON_FOURTH + axis * BLOCK + e] = high2 * m


@inlined
def _fade(buffer, rest_square1, rest_square2):
    """The same of what the law sees of θ: :meth:`HingeShape.change_slopes`."""
    for e in range(BLOCK):
        part1, part2 = buffer[PART1 + e], buffer[PART2 + e]
        if part1 == 1.0 and part2 == 1.0:
            continue
        share1, share2 = _fading(part1), _fading(part2)
        turn = 6.0 * buffer[TURN + e] / (FADED * FADED)
        by1, by2 = turn * share2 * (1.0 - part1) / rest_square1[e], turn * share1 * (1.0 - part2) / rest_square2[e]
        for k in range(3):
            axis, after, last = k * BLOCK + e, (k + 1) % 3 * BLOCK + e, (k + 2) % 3 * BLOCK + e
            end1 = buffer[ARM1 + after] * buffer[NORMAL1 + last] - buffer[ARM1 + last] * buffer[NORMAL1 + after]
            end2 = buffer[ARM2 + last] * buffer[NORMAL2 + after] - buffer[ARM2 + after] * buffer[NORMAL2 + last]
            third = buffer[NORMAL1 + after] * buffer[EDGE + last] - buffer[NORMAL1 + last] * buffer[EDGE + after]
            fourth = buffer[NORMAL2 + last] * buffer[EDGE + after] - buffer[NORMAL2 + after] * buffer[EDGE + last]
            buffer[ON_END + axis] = share1 * share2 * buffer[ON_END + axis] + by1 * end1 + by2 * end2
            buffer[ON_THIRD + axis] = share1 * share2 * buffer[ON_THIRD + axis] + by1 * third
            buffer[ON_FOURTH + axis] = share1 * share2 * buffer[ON_FOURTH + axis] + by2 * fourth


@inlined
def _scatter(buffer, corners, gradient):
    for e in range(BLOCK):
        i, j, k, m = corners[e, 0], corners[e, 1], corners[e, 2], corners[e, 3]
        along, turn = buffer[BY_Z + e] / buffer[LENGTH + e], buffer[BY_Y + e]
        for axis in range(3):
            end = along * buffer[EDGE + axis * BLOCK + e] + turn * buffer[ON_END + axis * BLOCK + e]
            third, fourth = turn * buffer[ON_THIRD + axis * BLOCK + e], turn * buffer[ON_FOURTH + axis * BLOCK + e]
            gradient[j, axis] += end
            gradient[k, axis] += third
            gradient[m, axis] += fourth
            gradient[i, axis] -= end + third + fourth


@inlined
def _evaluate(x, edges, tables, first, buffer, sums, rows, energy, curved):
    last = first + BLOCK
    _gather(x, edges.corners[first:last], buffer)
    _deform(
        buffer, edges.inner[first:last], edges.rest_length[first:last], edges.rest_angle[first:last],
        edges.size[first:last], edges.rest_square1[first:last], edges.rest_square2[first:last],
        tables.stretch_scale, tables.angle_scale,
    )  # fmt: skip
    _look_up(tables, buffer, rows)
    _splines(tables, buffer, rows, sums, curved)
    scales = (tables.stretch_scale, tables.angle_scale)
    _slopes(buffer, sums, edges.size[first:last], edges.share[first:last], energy, scales)
    _turns(buffer)
    _fade(buffer, edges.rest_square1[first:last], edges.rest_square2[first:last])


@inlined
def _curvatures(buffer, sums, tables, share, e):
    """The positive part of the second derivatives of the energy of an edge: in its length, its angle, and both."""
    z, y = buffer[STRETCH + e], buffer[ANGLE + e]
    zz, yy = 0.5 * z * z, 0.5 * y * y
    root, square = buffer[AT_Z + e], buffer[AT_Y + e]
    u_z, u_zz = 1.0 / root, -z / (root * root * root)
    v_y, v_yy = 2.0 * y / square, (2.0 - 2.0 * y * y) / (square * square)
    k_u, k_v, b_u, b_v = sums[K_U + e], sums[K_V + e], sums[B_U + e], sums[B_V + e]
    h_zz = sums[K + e] + 2.0 * k_u * u_z * z + (k_u * u_zz + sums[K_UU + e] * u_z * u_z) * zz
    h_zz += (b_u * u_zz + sums[B_UU + e] * u_z * u_z) * yy
    h_yy = sums[B + e] + 2.0 * b_v * v_y * y + (b_v * v_yy + sums[B_VV + e] * v_y * v_y) * yy
    h_yy += (k_v * v_yy + sums[K_VV + e] * v_y * v_y) * zz
    h_zy = k_v * v_y * z + b_u * u_z * y + (sums[K_UV + e] * zz + sums[B_UV + e] * yy) * u_z * v_y
    a = share * h_zz / (tables.stretch_scale * tables.stretch_scale)
    b = share * h_yy / (tables.angle_scale * tables.angle_scale)
    c = share * h_zy / (tables.stretch_scale * tables.angle_scale)
    # the positive part of [[a, c], [c, b]]
    mean, half = 0.5 * (a + b), 0.5 * (a - b)
    spread = math.sqrt(half * half + c * c)
    if mean - spread < 0.0:
        high = mean + spread if mean + spread > 0.0 else 0.0
        part = high / (2.0 * spread) if spread > 0.0 else 0.0
        a, b, c = part * (spread + half), part * (spread - half), part * c
    return a, b, c


@compiled
def energies_and_forces(x, edges, tables):
    """Energy of each edge [J], and the gradient of their sum in ``x`` [N]."""
    energy, gradient = np.empty(len(edges.share)), np.zeros(x.shape)
    buffer, sums, rows = np.zeros(END), np.empty(SUMS), np.zeros(BLOCK, np.int64)
    for first in range(0, len(energy), BLOCK):
        _evaluate(x, edges, tables, first, buffer, sums, rows, energy[first : first + BLOCK], False)
        _scatter(buffer, edges.corners[first : first + BLOCK], gradient)
    return energy, gradient


@compiled
def add_hessian(x, edges, tables, count, data, places):
    """Add the Hessians of the first ``count`` edges, positive semi-definite, to the entries ``data`` of a matrix.

    ``Jᵀ H₊ J + |∂φ/∂l|/l (I - y yᵀ)``, J the derivatives of length and angle, H₊ the positive part of the second
    derivatives of the energy in them. ``places[e, p]`` is where entry p of edge e stands, of the upper triangle of its
    12 x 12 block row by row.
    """
    buffer, sums, rows = np.zeros(END), np.empty(SUMS), np.zeros(BLOCK, np.int64)
    energy, turn, stretch = np.empty(BLOCK), np.empty(12), np.zeros(12)
    for first in range(0, len(edges.share), BLOCK):
        _evaluate(x, edges, tables, first, buffer, sums, rows, energy, True)
        for e in range(min(BLOCK, count - first)):
            a, b, c = _curvatures(buffer, sums, tables, edges.share[first + e], e)
            length = buffer[LENGTH + e]
            string = abs(buffer[BY_Z + e]) / length
            for axis in range(3):
                along = buffer[EDGE + axis * BLOCK + e] / length
                end, third = buffer[ON_END + axis * BLOCK + e], buffer[ON_THIRD + axis * BLOCK + e]
                fourth = buffer[ON_FOURTH + axis * BLOCK + e]
                stretch[axis], stretch[3 + axis] = -along, along
                turn[3 + axis], turn[6 + axis], turn[9 + axis] = end, third, fourth
                turn[axis] = -(end + third + fourth)
            if edges.inner[first + e] == 0.0:
                b, c = 0.0, 0.0
            place = 0
            for p in range(12):
                by_stretch, by_turn = a * stretch[p] + c * turn[p], c * stretch[p] + b * turn[p]
                if p < 6:
                    by_stretch -= string * stretch[p]
                for q in range(p, 12):
                    value = by_stretch * stretch[q] + by_turn * turn[q]
                    if q == p and p < 6:
                        value += string
                    if p < 3 and q == p + 3:
                        value -= string
                    data[places[first + e, place]] += value
                    place += 1
