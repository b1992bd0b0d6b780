"""The parametric body: a watertight mesh with a skeleton, skinning weights and a distance."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import gpytoolbox
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from drape.errors import DrapeError
from drape.figure.body_surface import body_field
from drape.figure.distance import SurfaceDistance
from drape.figure.level_set import level_surface, sample_mirrored
from drape.figure.phenotype import Phenotype
from drape.figure.shape import FigureShape
from drape.figure.skeleton import JOINTS, REFERENCE_HEIGHT, bone_directions, reference_skeleton, rest_joints
from drape.figure.skinning import smooth_weights, strongest

CELL = 0.009
"""Of the grid on which the surface is found, at the reference height [m]."""
LOW, HIGH = np.array([-1.1, -0.36, -0.04]), np.array([1.1, 0.30, 1.81])
"""Corners of a box around every shape at the reference height [m]."""
ROUNDS = 5
"""Of splitting, collapsing, flipping and smoothing."""
NEIGHBOURS = 6
"""Vertices whose weights a point near the surface takes over."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A body at rest in metres: z up, soles at z = 0, facing -y, its left side at +x, arms 35 degrees down."""

    shape: FigureShape | Phenotype
    """The shape that it was made from."""
    stature: float
    """From sole to crown [m]."""
    directions: dict[str, Float[np.ndarray, "3"]]
    """Unit vectors along the bones at rest."""
    rest_positions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    """Closed, winding outwards."""
    joints: Float[np.ndarray, "joints 3"]
    bones: Int[np.ndarray, "vertices 4"]
    weights: Float[np.ndarray, "vertices 4"]
    """Add up to one."""
    surface: SurfaceDistance = field(repr=False)
    """The smooth surface that the mesh was made from."""

    def signed_distance(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Distance to the smooth surface that the rest mesh was made from, negative inside [m]."""
        return self.surface(points)

    def skin_weights(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Int[np.ndarray, "points 4"], Float[np.ndarray, "points 4"]]:
        """Bones and weights of the nearest vertices, averaged with the inverse squares of their distances."""
        distances, nearest = self._tree.query(points, k=NEIGHBOURS)
        share = 1.0 / np.maximum(distances, 1e-6) ** 2
        share = share / share.sum(axis=1, keepdims=True)
        dense = np.zeros((len(points), len(JOINTS)))
        values = share[:, :, None] * self.weights[nearest]
        np.add.at(dense, (np.arange(len(points))[:, None, None], self.bones[nearest]), values)
        return strongest(dense)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.rest_positions)


def make_figure(shape: FigureShape, edge: float = 0.0185) -> Figure:
    """Build a body with edges of about ``edge`` [m]; the same shape gives the same body.

    Raises:
        DrapeError: edges outside 1 to 4 cm.
    """
    check_edge(edge)
    scale = shape.height / REFERENCE_HEIGHT
    values, corner = sample_mirrored(lambda points: body_field(points, shape), LOW, HIGH, CELL)
    dense, dense_faces = level_surface(values, corner, CELL)
    positions, faces = gpytoolbox.remesh_botsch(dense, dense_faces.astype(np.int32), ROUNDS, edge / scale, True)
    faces = faces.astype(np.int64)
    bones, weights = strongest(smooth_weights(positions, faces, *reference_skeleton(shape)))
    return Figure(
        shape=shape,
        stature=shape.height,
        directions=bone_directions(shape),
        rest_positions=positions * scale,
        faces=faces,
        joints=rest_joints(shape),
        bones=bones,
        weights=weights,
        surface=SurfaceDistance(dense * scale, dense_faces),
    )


def check_edge(edge: float) -> None:
    """Refuse a length of edges that a body cannot have.

    Raises:
        DrapeError: outside 1 to 4 cm.
    """
    if not 0.01 <= edge <= 0.04:
        raise DrapeError(f"figure: edge {edge} m; expected 0.01 to 0.04 m; choose a length in this range")
