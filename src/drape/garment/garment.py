"""A garment around a figure in its rest pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.garment.anatomy import measure_anatomy
from drape.garment.boundary import boundary_loops
from drape.garment.clearance import push_out
from drape.garment.clip import clip, largest_component
from drape.garment.cloth_field import Grid, body_distance, zero_level
from drape.garment.figure_like import Body, FigureLike
from drape.garment.kinds import LOOPS, Pattern
from drape.garment.layer import Layer
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
    worn: Layer = field(repr=False)
    """The body with this garment on it: what the next garment is made around."""


def make_garment(
    kind: str, figure: FigureLike, style: GarmentStyle, edge: float, under: Garment | None = None
) -> Garment:
    """A garment of this kind and style for a figure, with edges of about ``edge`` [m]; deterministic.

    ``under``: what is worn below it; all distances are then kept from that garment as they are from the body.

    Raises:
        DrapeError: an unknown kind, an edge length out of range, or a mesh that is not fit for simulation.
    """
    known_kind(kind)
    if not EDGES[0] <= edge <= EDGES[1]:
        raise DrapeError(f"garment {kind}: edge is {edge} m; expected {EDGES[0]} to {EDGES[1]} m; choose one of those")
    body, inner = measure_anatomy(figure), figure if under is None else under.worn
    pattern = Pattern(kind, body, style, style.ease + SAGITTA * edge)
    vertices, faces = remesh(*_cut_cloth(pattern, inner, edge), edge)
    vertices = push_out(vertices, faces, inner)
    quality = measure_quality(vertices, faces, inner)
    check_quality(quality, kind, LOOPS[kind])
    bones, weights = garment_weights(vertices, faces, figure, body, joined_legs=kind in ("dress", "skirt"))
    pinned = _highest_loop(vertices, faces) if pattern.has_waistband else np.zeros(0, dtype=np.int64)
    return Garment(kind, style, vertices, faces, pinned, bones, weights, quality, Layer(inner, pattern))


def _cut_cloth(pattern: Pattern, inner: Body, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """The garment's surface, finer than wanted."""
    grid = Grid.covering(*pattern.box(), float(np.clip(FINER * edge, *SPACING)))
    field = pattern.field(grid.points(), body_distance(inner, grid))
    vertices, faces = zero_level(field, grid)
    return largest_component(*clip(vertices, faces, pattern.ends(vertices)))


def _highest_loop(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    loops = boundary_loops(faces)
    return np.sort(max(loops, key=lambda loop: vertices[loop, 2].mean())).astype(np.int64)
