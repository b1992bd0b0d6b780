"""The splines of a :class:`BakedLaw`, compiled: energies of edges and their slopes in the deformation or the speed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from drape.energy.baked_kernel_vectors import BLOCK, compiled, inlined, series
from drape.energy.cubic_spline import MARGIN
from drape.energy.edge_scale import WIDEST
from drape.energy.twist_share import FADES_BELOW

(SCALE, BY_ALPHA, BY_BETA, STRETCH, ALPHA, BETA, U, A, B, S, S_U, S_A, S_B, END) = (BLOCK * k for k in range(14))
SUMS = 44
"""Numbers on the way from the coefficients around a cell to a value and three slopes."""

SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(11))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(12))
EXPONENTIAL = tuple(1.0 / math.factorial(k + 1) for k in range(14))
LOGARITHM = tuple(2.0 / (2 * k + 1) for k in range(10))
"""Series to the last digit: of ``sin(h)/h`` and ``cos h`` in h² for ``|h| < π/2``, of ``(exp(r) - 1)/r`` for
``|r| < ½ ln 2``, and of ``ln((1 + s)/(1 - s))/s`` in s² for ``|s| < 0.172``."""
LN_2, SQRT_2 = math.log(2.0), math.sqrt(2.0)
MANTISSA, ONE = (1 << 52) - 1, 1023 << 52


class Table(NamedTuple):
    """What :func:`potentials` needs of a :class:`BakedLaw`; the names are those of its parts."""

    taps: np.ndarray
    nodes: int
    angles: int
    first: int
    step: float
    stretch_scale: float
    rest_hessian: tuple


class Line(NamedTuple):
    """What :func:`drags` needs of a :class:`BakedLaw`; the names are those of its parts."""

    taps: np.ndarray
    nodes: int
    first: int
    step: float
    speed_scale: float
    rest_drag: tuple


@inlined
def _asinh(z, root):
    """Asinh z, given √(1 + z²); exact to some 1e-16 in absolute terms."""
    x = abs(z) + root
    bits = np.float64(x).view(np.int64)
    part = np.int64((bits & MANTISSA) | ONE).view(np.float64)
    large = part > SQRT_2
    part = 0.5 * part if large else part
    exponent = np.float64((bits >> 52) - 1023) + (1.0 if large else 0.0)
    s = (part - 1.0) / (part + 1.0)
    return math.copysign(exponent * LN_2 + s * series(s * s, LOGARITHM), z)


@inlined
def _expm1(x):
    power = np.rint(x / LN_2)
    power = power if power > -1000.0 else -1000.0
    rest = x - power * LN_2
    factor = np.int64((np.int64(power) + 1023) << 52).view(np.float64)
    return factor * (rest * series(rest, EXPONENTIAL)) + (factor - 1.0)


@inlined
def _sine_cosine(angle):
    """Of an angle in [-π, π], by its half."""
    half = 0.5 * angle
    sine, cosine = half * series(half * half, SINE), series(half * half, COSINE)
    return 2.0 * sine * cosine, cosine * cosine - sine * sine


@inlined
def _basis(f):
    g = 1.0 - f
    low, high = (0.5 * f - 1.0) * f * f + 2.0 / 3.0, (0.5 * g - 1.0) * g * g + 2.0 / 3.0
    return g * g * g / 6.0, low, high, f * f * f / 6.0


@inlined
def _basis_slopes(f):
    g = 1.0 - f
    return -0.5 * g * g, (1.5 * f - 2.0) * f, (2.0 - 1.5 * g) * g, 0.5 * f * f


@inlined
def _clamped(x, nodes):
    """As in :mod:`cubic_spline`; what is not a number goes to the lower end: it must not be looked up elsewhere."""
    x = x if x > 1.0 - MARGIN else 1.0 - MARGIN
    return x if x < nodes + MARGIN - 2.001 else nodes + MARGIN - 2.001


@inlined
def _place(cell, angles):
    turned = cell - angles * np.floor(cell / angles)
    turned = turned if turned > 0.0 else 0.0
    return np.int64(turned if turned < angles - 1.0 else angles - 1.0)


@inlined
def _unscaled(q, buffer):
    for e in range(BLOCK):
        buffer[STRETCH + e], buffer[ALPHA + e], buffer[BETA + e] = q[0, e], q[1, e], q[2, e]


@inlined
def _scaled(q, sizes, buffer):
    """q/S, S and its slopes in the angles, as :class:`EdgeScale` has them."""
    for e in range(BLOCK):
        alpha, beta = q[1, e], q[2, e]
        size = math.sqrt(alpha * alpha + beta * beta + 1e-12)
        x = size / (sizes[e] * WIDEST)
        drop = _expm1(-2.0 * x)
        cotangent = -(2.0 + drop) / drop  # 1/tanh(x)
        slope = (cotangent - x * (cotangent * cotangent - 1.0)) / (WIDEST * size)
        scale = sizes[e] * x * cotangent
        buffer[SCALE + e], buffer[BY_ALPHA + e], buffer[BY_BETA + e] = scale, slope * alpha, slope * beta
        buffer[STRETCH + e], buffer[ALPHA + e], buffer[BETA + e] = q[0, e] / scale, alpha / scale, beta / scale


@inlined
def _cells(table, buffer, rows):
    angles, turns = table.angles, table.angles / (2.0 * math.pi)
    for e in range(BLOCK):
        z = buffer[STRETCH + e] / table.stretch_scale
        u = _clamped(_asinh(z, math.sqrt(1.0 + z * z)) / table.step - table.first, table.nodes)
        a, b = buffer[ALPHA + e] * turns, buffer[BETA + e] * turns
        cell_u, cell_a, cell_b = np.floor(u), np.floor(a), np.floor(b)
        buffer[U + e], buffer[A + e], buffer[B + e] = u - cell_u, a - cell_a, b - cell_b
        node = np.int64(cell_u) + (MARGIN - 1)
        rows[e] = (node * angles + _place(cell_a, angles)) * angles + _place(cell_b, angles)


@inlined
def _spline(table, rows, buffer, sums):
    next_node, turns = table.angles**2, table.angles / (2.0 * math.pi)
    for e in range(BLOCK):
        u0, u1, u2, u3 = _basis(buffer[U + e])
        v0, v1, v2, v3 = _basis_slopes(buffer[U + e])
        first = rows[e]
        t0, t1 = table.taps[first], table.taps[first + next_node]
        t2, t3 = table.taps[first + 2 * next_node], table.taps[first + 3 * next_node]
        for k in range(16):
            sums[k] = t0[k] * u0 + t1[k] * u1 + t2[k] * u2 + t3[k] * u3
            sums[16 + k] = t0[k] * v0 + t1[k] * v1 + t2[k] * v2 + t3[k] * v3
        a0, a1, a2, a3 = _basis(buffer[A + e])
        c0, c1, c2, c3 = _basis_slopes(buffer[A + e])
        for k in range(4):
            sums[32 + k] = sums[k] * a0 + sums[4 + k] * a1 + sums[8 + k] * a2 + sums[12 + k] * a3
            sums[36 + k] = sums[k] * c0 + sums[4 + k] * c1 + sums[8 + k] * c2 + sums[12 + k] * c3
            sums[40 + k] = sums[16 + k] * a0 + sums[20 + k] * a1 + sums[24 + k] * a2 + sums[28 + k] * a3
        b0, b1, b2, b3 = _basis(buffer[B + e])
        d0, d1, d2, d3 = _basis_slopes(buffer[B + e])
        buffer[S + e] = sums[32] * b0 + sums[33] * b1 + sums[34] * b2 + sums[35] * b3
        buffer[S_B + e] = (sums[32] * d0 + sums[33] * d1 + sums[34] * d2 + sums[35] * d3) * turns
        buffer[S_A + e] = (sums[36] * b0 + sums[37] * b1 + sums[38] * b2 + sums[39] * b3) * turns
        buffer[S_U + e] = (sums[40] * b0 + sums[41] * b1 + sums[42] * b2 + sums[43] * b3) / table.step


@inlined
def _energies(table, buffer, energy, slopes):
    """``S² φp`` and its slopes ``S φp' + (2 S φp - φp'·q) dS/dq`` at the deformation q that q/S is in the buffer."""
    h_0, h_1, h_2 = table.rest_hessian
    for e in range(BLOCK):
        stretch, alpha, beta = buffer[STRETCH + e], buffer[ALPHA + e], buffer[BETA + e]
        z = stretch / table.stretch_scale
        square = 1.0 + z * z
        sin_a, cos_a = _sine_cosine(alpha)
        sin_b, cos_b = _sine_cosine(beta)
        pull_0 = h_0[0] * stretch + h_0[1] * sin_a + h_0[2] * sin_b
        pull_1 = h_1[0] * stretch + h_1[1] * sin_a + h_1[2] * sin_b
        pull_2 = h_2[0] * stretch + h_2[1] * sin_a + h_2[2] * sin_b
        phi = 0.5 * (pull_0 * stretch + pull_1 * sin_a + pull_2 * sin_b) + square * buffer[S + e]
        by_z = 2.0 * z * buffer[S + e] + math.sqrt(square) * buffer[S_U + e]
        by_stretch = pull_0 + by_z / table.stretch_scale
        by_alpha = pull_1 * cos_a + square * buffer[S_A + e]
        by_beta = pull_2 * cos_b + square * buffer[S_B + e]
        scale = buffer[SCALE + e]
        by_scale = scale * (2.0 * phi - (by_stretch * stretch + by_alpha * alpha + by_beta * beta))
        energy[e] = scale * scale * phi
        slopes[0, e] = scale * by_stretch
        slopes[1, e] = scale * by_alpha + by_scale * buffer[BY_ALPHA + e]
        slopes[2, e] = scale * by_beta + by_scale * buffer[BY_BETA + e]


@inlined
def _evaluate(q, sizes, same, table, buffer, sums, rows, energy, slopes):
    if same:
        _unscaled(q, buffer)
    else:
        _scaled(q, sizes, buffer)
    _cells(table, buffer, rows)
    _spline(table, rows, buffer, sums)
    _energies(table, buffer, energy, slopes)


@inlined
def _fade(upright, untwisted, its_slopes, energy, slopes):
    """As :func:`twist_share` says, from the energies with and without twist."""
    for e in range(BLOCK):
        t = upright[e] / FADES_BELOW
        t = t if t < 1.0 else 1.0
        share, rise = t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / FADES_BELOW
        gained = energy[e] - untwisted[e]
        energy[e] = untwisted[e] + share * gained
        slopes[0, e] = its_slopes[0, e] + share * (slopes[0, e] - its_slopes[0, e])
        slopes[1, e] = share * slopes[1, e]
        slopes[2, e] = its_slopes[2, e] + share * (slopes[2, e] - its_slopes[2, e])
        slopes[3, e] = rise * gained


@compiled
def potentials(q, sizes, same, table):
    """``S² φp(q/S)`` [blocks, BLOCK] [J] and its slopes in q [blocks, 4, BLOCK]; with ``same``, S = 1.

    ``q`` as from :func:`deformations`; ``sizes`` [blocks, BLOCK]: :attr:`EdgeScale.rest`.
    """
    energy, slopes = np.empty(sizes.shape), np.zeros(q.shape)
    untwisted, its_energy, its_slopes = np.zeros((4, BLOCK)), np.empty(BLOCK), np.empty((4, BLOCK))
    buffer, sums, rows = np.zeros(END), np.empty(SUMS), np.zeros(BLOCK, np.int64)
    buffer[SCALE : SCALE + BLOCK] = 1.0
    for block in range(len(q)):
        near, fading = q[block], q[block, 3].min() < FADES_BELOW
        untwisted[0], untwisted[2] = near[0], near[2]
        place = near, energy[block], slopes[block]
        for _ in range(2 if fading else 1):  # one call: what is called in two places is compiled twice
            seen, its, their = place
            _evaluate(seen, sizes[block], same, table, buffer, sums, rows, its, their)
            place = untwisted, its_energy, its_slopes
        if fading:
            _fade(near[3], its_energy, its_slopes, energy[block], slopes[block])
    return energy, slopes


@compiled
def drags(speed, line):
    """φd per area [J/m²] and its slope in the speed [J s/m³], for each ``speed`` [m/s]."""
    density, slope, places = np.empty(speed.shape), np.empty(speed.shape), np.empty(speed.shape)
    start, rise = line.rest_drag
    for e in range(len(speed)):
        y = speed[e] / line.speed_scale
        places[e] = _clamped(_asinh(y, math.sqrt(1.0 + y * y)) / line.step - line.first, line.nodes)
    for e in range(len(speed)):
        y = speed[e] / line.speed_scale
        cell = np.floor(places[e])
        taps = line.taps[np.int64(cell) + (MARGIN - 1)]
        w, d = _basis(places[e] - cell), _basis_slopes(places[e] - cell)
        value = taps[0] * w[0] + taps[1] * w[1] + taps[2] * w[2] + taps[3] * w[3]
        by_w = (taps[0] * d[0] + taps[1] * d[1] + taps[2] * d[2] + taps[3] * d[3]) / line.step
        density[e] = start + rise * y + y * y * value
        slope[e] = (rise + 2.0 * y * value + y * y / math.sqrt(1.0 + y * y) * by_w) / line.speed_scale
    return density, slope
