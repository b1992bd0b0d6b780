"""Numbers that say whether a garment's mesh is fit for simulation, and the refusal of one that is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.garment.boundary import boundary_loops
from drape.garment.clip import component_labels
from drape.garment.edges import edges_of
from drape.garment.figure_like import Body

WORST_TRIANGLE = 0.3
LARGEST_EDGE_CV = 0.16
SMALLEST_CLEARANCE = 0.006
"""[m]"""


@dataclass(frozen=True)
class GarmentQuality:
    """Lengths in metres; the quality of a triangle is 4√3 area / (sum of squared sides), 1 where it is equilateral."""

    vertices: int
    components: int
    loops: int
    euler: int
    """Euler characteristic: 2 - loops for a surface without handles."""
    edge_mean: float
    edge_cv: float
    """Standard deviation of the edge lengths over their mean."""
    triangle_min: float
    triangle_mean: float
    clearance: float
    """Smallest signed distance of a vertex to the body."""
    face_clearance: float
    """Smallest signed distance of a face's centre to the body."""


def triangle_quality(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " faces"]:
    """4√3 area / (sum of squared sides) of each face."""
    corners = vertices[faces]
    sides = np.roll(corners, -1, axis=1) - corners
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return 4.0 * np.sqrt(3.0) * area / (sides**2).sum((1, 2))


def measure_quality(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], body: Body
) -> GarmentQuality:
    """All numbers of a garment on the figure that it was made for."""
    edges, _ = edges_of(faces)
    lengths = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    quality = triangle_quality(vertices, faces)
    return GarmentQuality(
        vertices=len(vertices),
        components=component_labels(faces, len(vertices))[0],
        loops=len(boundary_loops(faces)),
        euler=len(vertices) - len(edges) + len(faces),
        edge_mean=float(lengths.mean()),
        edge_cv=float(lengths.std() / lengths.mean()),
        triangle_min=float(quality.min()),
        triangle_mean=float(quality.mean()),
        clearance=float(body.signed_distance(vertices).min()),
        face_clearance=float(body.signed_distance(vertices[faces].mean(1)).min()),
    )


def check_quality(quality: GarmentQuality, kind: str, loops: int) -> None:
    """Raises:
    DrapeError: what the mesh lacks, what was found and expected.
    """
    wanted = [
        (quality.components == 1, f"{quality.components} separate pieces; expected 1"),
        (quality.loops == loops, f"{quality.loops} boundary loops; expected {loops}"),
        (quality.euler == 2 - loops, f"Euler characteristic {quality.euler}; expected {2 - loops} (no handles)"),
        (
            quality.triangle_min > WORST_TRIANGLE,
            f"a triangle of quality {quality.triangle_min:.2f}; expected above {WORST_TRIANGLE}",
        ),
        (
            quality.edge_cv < LARGEST_EDGE_CV,
            f"edge lengths that vary by {quality.edge_cv:.3f} of their mean; expected below {LARGEST_EDGE_CV}",
        ),
        (
            quality.clearance >= SMALLEST_CLEARANCE,
            f"a vertex {1e3 * quality.clearance:.1f} mm from the body; expected {1e3 * SMALLEST_CLEARANCE:.0f} mm",
        ),
        (quality.face_clearance > 0.0, f"a face {-1e3 * quality.face_clearance:.1f} mm inside the body; expected none"),
    ]
    faults = [sentence for good, sentence in wanted if not good]
    if faults:
        raise DrapeError(f"garment {kind}: found {'; '.join(faults)}; choose another style, edge or figure")
