"""Speeds of edges and the forces of their drag, compiled: the geometry of :class:`Dissipation` in two passes."""

from __future__ import annotations

import math

import numpy as np

from drape.energy.baked_kernel_vectors import (
    add,
    add_pulled,
    compiled,
    cross,
    difference,
    dot,
    inlined,
    row,
    sum_of_two,
)
from drape.energy.dissipation_speed import SLOWEST


@inlined
def _area(normal, smallest_area):
    return 0.5 * math.sqrt(dot(normal, normal) + smallest_area * smallest_area)


@inlined
def _motion(moved, i, j):
    return sum_of_two(0.5, row(moved, i), 0.5, row(moved, j))


@compiled
def speeds(x, moved, faces, edges, edge_faces, smallest_area, dt):
    """Speed of each edge's midpoint [m/s] and the area γ of the faces at it [m²].

    ``moved`` [vertices, 3]: displacements over the step [m]. ``edge_faces`` [edges, 2]: the number of faces, where an
    edge has only one.
    """
    areas, speed, gamma = np.zeros(len(faces) + 1), np.empty(len(edges)), np.empty(len(edges))
    for f in range(len(faces)):
        i, j, k = row(faces, f)
        areas[f] = _area(cross(difference(x, i, j), difference(x, i, k)), smallest_area)
    for e in range(len(edges)):
        motion = _motion(moved, edges[e, 0], edges[e, 1])
        speed[e] = math.sqrt(dot(motion, motion) / (dt * dt) + SLOWEST * SLOWEST)
        gamma[e] = areas[edge_faces[e, 0]] + areas[edge_faces[e, 1]]
    return speed, gamma


@compiled
def drag_forces(x, moved, faces, edges, edge_faces, smallest_area, dt, speed, gamma, density, slope):
    """Gradient of ``Σ γ φd(speed)`` in the positions, from φd per area and its slope in the speed."""
    gradient, on_area = np.zeros(x.shape), np.zeros(len(faces) + 1)
    for e in range(len(edges)):
        i, j = edges[e, 0], edges[e, 1]
        motion = _motion(moved, i, j)
        strength = 0.5 * gamma[e] * slope[e] / (speed[e] * dt * dt)
        add(gradient, i, strength, motion)
        add(gradient, j, strength, motion)
        on_area[edge_faces[e, 0]] += density[e]
        on_area[edge_faces[e, 1]] += density[e]
    for f in range(len(faces)):
        face = row(faces, f)
        sides = difference(x, face[0], face[1]), difference(x, face[0], face[2])
        normal = cross(sides[0], sides[1])
        share = 0.25 * on_area[f] / _area(normal, smallest_area)
        add_pulled(gradient, face, sides, (share * normal[0], share * normal[1], share * normal[2]))
    return gradient
