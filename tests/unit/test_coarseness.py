"""Curvature of bodies, and which cloths are too coarse for them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from drape.contact.coarseness import Turns, curvatures, least_radius, too_coarse
from drape.geometry.grid import square_grid
from drape.scene.obstacle import Obstacle

SPHERE = trimesh.creation.icosphere(3, 1.2)


def radius_of(body: trimesh.Trimesh) -> float:
    return least_radius(np.asarray(body.vertices, np.float64), np.asarray(body.faces))


def test_a_sphere_is_curved_by_its_radius():
    x, faces = np.asarray(SPHERE.vertices), np.asarray(SPHERE.faces)
    curvature, area = curvatures(Turns.of(x, faces), len(x), faces)
    assert 1 / curvature == pytest.approx(np.full(len(area), 1.2), rel=0.15)
    assert area.sum() == pytest.approx(SPHERE.area)
    assert radius_of(SPHERE) == pytest.approx(1.2, rel=0.08)


def test_a_tube_is_curved_across_it_however_long_its_faces():
    for length in (0.1, 5.0):
        tube = trimesh.creation.cylinder(0.05, length, sections=24)
        sides = np.abs(tube.face_normals[:, 2]) < 0.5
        assert least_radius(tube.vertices, tube.faces[sides]) == pytest.approx(0.05, rel=0.02)


def test_only_what_is_convex_counts():
    inwards = SPHERE.copy()
    inwards.invert()
    assert radius_of(inwards) == math.inf
    flat = square_grid(1.0, 4)
    assert least_radius(flat.rest_positions, flat.faces) == math.inf


def test_faces_without_area_and_edges_of_three_faces_are_no_edges():
    x = np.concatenate([np.asarray(SPHERE.vertices), [[0.0, 0.0, 5.0]]])
    faces = np.concatenate([SPHERE.faces, [[0, 0, 1], [*SPHERE.faces[0][:2], len(x) - 1]]])
    assert least_radius(x, faces) == pytest.approx(1.2, rel=0.06)


def test_edges_of_a_floor_are_a_small_part_of_it():
    for times in (0, 3, 5):
        floor = trimesh.creation.box((10.0, 10.0, 0.1))
        for _ in range(times):
            floor = floor.subdivide()
        obstacle = Obstacle(floor.faces, floor.vertices[None])
        assert too_coarse(square_grid(2.0, 20), obstacle, per_edge=1, thickness=9e-3) is None


def test_a_coarse_cloth_over_a_sphere_is_told_what_helps():
    """And what helps does help."""
    obstacle = Obstacle(SPHERE.faces, SPHERE.vertices[None])
    sheet = lambda n: square_grid(3.6, n, "alternating")  # noqa: E731
    assert too_coarse(sheet(30), obstacle, 1, 9e-3) is None
    words = too_coarse(sheet(6), obstacle, 1, 9e-3)
    diagonal = math.sqrt(2) * 0.72
    for part in ("up to 509 mm apart", "thickness of the contact, 9 mm", "contact=surface", f"{diagonal:.3g} m"):
        assert part in words
    depth = float(words.split("sinks in by up to ")[1].split()[0])
    assert depth == pytest.approx(1e3 * (diagonal / 2) ** 2 / (8 * 1.2), rel=0.08)
    assert too_coarse(sheet(6), obstacle, 2, 9e-3) is not None
    assert too_coarse(sheet(6), obstacle, 3, 9e-3) is None
    assert too_coarse(sheet(6), obstacle, 1, 1.1e-3 * depth) is None
    below = float(words.split("edges below ")[1].split()[0])
    assert too_coarse(sheet(2 + int(3600 * math.sqrt(2) / below)), obstacle, 1, 9e-3) is None
    assert too_coarse(sheet(int(3600 * math.sqrt(2) / below)), obstacle, 1, 9e-3) is not None


def test_corners_of_its_own_for_each_face_hide_no_curvature():
    corners = np.asarray(SPHERE.vertices)[SPHERE.faces].reshape(-1, 3)
    loose = Obstacle(np.arange(len(corners)).reshape(-1, 3), corners[None])
    assert too_coarse(square_grid(3.6, 6), loose, 1, 9e-3) is not None
