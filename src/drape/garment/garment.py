"""A garment around a figure in its rest pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.garment.anatomy import measure_anatomy
from drape.garment.boundary import boundary_loops
from drape.garment.clearance import push_out
from drape.garment.clip import clip, largest_component
from drape.garment.cloth_field import Grid, body_distance, zero_level
from drape.garment.figure_like import FigureLike
from drape.garment.kinds import LOOPS, Pattern
from drape.garment.quality import GarmentQuality, check_quality, measure_quality
from drape.garment.remeshing import remesh
from drape.garment.skinning import garment_weights
from drape.garment.style import GarmentStyle, known_kind

EDGES = (0.008, 0.06)
"""Edge lengths that garments can have [m]."""
SAGITTA = 0.08
"""Additional ease per edge length: a flat triangle on a limb of 6 cm radius lies so much closer than its corners."""
FINER = 0.5
"""Spacing of the grid over the edge length."""
SPACING = (0.008, 0.016)
"""Smallest and largest spacing of the grid [m]."""


@dataclass(frozen=True, eq=False)
class Garment:
    """One piece of clothing: a manifold triangle mesh with its boundary loops, clear of the body."""

    kind: str
    style: GarmentStyle
    rest_positions: Float[np.ndarray, "vertices 3"]
    """Rest positions, around the figure in its rest pose [m]."""
    faces: Int[np.ndarray, "faces 3"]
    """Wound so that normals point away from the body."""
    pinned: Int[np.ndarray, " pinned"]
    """Vertices of the waistband of skirt and trousers; none otherwise."""
    bones: Int[np.ndarray, "vertices 4"]
    weights: Float[np.ndarray, "vertices 4"]
    """Skinning weights on the figure's joints, sum 1."""
    quality: GarmentQuality


def make_garment(kind: str, figure: FigureLike, style: GarmentStyle, edge: float) -> Garment:
    """A garment of this kind and style for a figure, with edges of about ``edge`` [m]; deterministic.

    Raises:
        DrapeError: an unknown kind, an edge length out of range, or a mesh that is not fit for simulation.
    """
    known_kind(kind)
    if not EDGES[0] <= edge <= EDGES[1]:
        raise DrapeError(f"garment {kind}: edge is {edge} m; expected {EDGES[0]} to {EDGES[1]} m; choose one of those")
    body = measure_anatomy(figure)
    pattern = Pattern(kind, body, style, style.ease + SAGITTA * edge)
    vertices, faces = remesh(*_cut_cloth(pattern, figure, edge), edge)
    vertices = push_out(vertices, faces, figure)
    quality = measure_quality(vertices, faces, figure)
    check_quality(quality, kind, LOOPS[kind])
    bones, weights = garment_weights(vertices, faces, figure, body, joined_legs=kind in ("dress", "skirt"))
    pinned = _highest_loop(vertices, faces) if pattern.has_waistband else np.zeros(0, dtype=np.int64)
    return Garment(kind, style, vertices, faces, pinned, bones, weights, quality)


def _cut_cloth(pattern: Pattern, figure: FigureLike, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """The garment's surface, finer than wanted."""
    grid = Grid.covering(*pattern.box(), float(np.clip(FINER * edge, *SPACING)))
    field = pattern.field(grid.points(), body_distance(figure, grid))
    vertices, faces = zero_level(field, grid)
    return largest_component(*clip(vertices, faces, pattern.ends(vertices)))


def _highest_loop(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    loops = boundary_loops(faces)
    return np.sort(max(loops, key=lambda loop: vertices[loop, 2].mean())).astype(np.int64)
