"""A recorded square of cloth, meshed coarser or finer."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from drape.errors import DrapeError
from drape.geometry.grid import PATTERNS, square_grid
from drape.geometry.mesh import ClothMesh
from drape.scene.pins import Pins
from drape.scene.scene import Scene
from drape.scene.state import State


class SquareResampling:
    """Positions of a grid of ``source``² vertices -> those of ``target``² vertices on the same square.

    Cubic splines along both sides; exact where both have a vertex, so corners stay corners.
    """

    def __init__(self, source: int, target: int):
        ends = np.linspace(0.0, 1.0, source)
        spline = make_interp_spline(ends, np.eye(source), k=min(3, source - 1))
        self.weights: Float[np.ndarray, "target source"] = spline(np.linspace(0.0, 1.0, target))

    def __call__(self, x: Float[np.ndarray, "source_vertices 3"]) -> Float[np.ndarray, "target_vertices 3"]:
        count = self.weights.shape[1]
        grid = np.asarray(x, np.float64).reshape(count, count, 3)
        return np.einsum("ai,bj,ijc->abc", self.weights, self.weights, grid, optimize=True).reshape(-1, 3)


def resampled(scene: Scene, resolution: int) -> Scene:
    """The same square, hanging by two corners, with ``resolution``² vertices; the cloth as a whole weighs the same.

    Its vertices weigh the same among each other, as Blender's do. There is no ``reference`` any more.

    Raises:
        DrapeError: the mesh of the scene is not that of :func:`square_grid`, or it does not hang.
    """
    count = round(scene.mesh.num_vertices**0.5)
    if resolution == count:
        return scene
    pattern = _pattern(scene, count)
    if scene.pins is None:
        raise DrapeError(f"scene {scene.name}: found no pinned vertex; expected a square that hangs by two corners")
    mesh = square_grid(float(np.ptp(scene.mesh.rest_positions[:, 0])), resolution, pattern)
    change = SquareResampling(count, resolution)
    x = change(scene.initial.x)
    rows, columns = np.divmod(scene.pins.vertices, count)
    corners = rows // (count - 1) * (resolution - 1) * resolution + columns // (count - 1) * (resolution - 1)
    return dataclasses.replace(
        scene,
        mesh=mesh,
        initial=State(x, change(scene.initial.v)),
        mass=np.full(mesh.num_vertices, scene.mass.sum() / mesh.num_vertices),
        pins=Pins.fixed(corners, x),
        reference=None,
    )


def _pattern(scene: Scene, count: int) -> str:
    for pattern in PATTERNS:
        if _same(scene.mesh, square_grid(1.0, max(count, 2), pattern)) and _at_corners(scene.pins, count):
            return pattern
    raise DrapeError(
        f"scene {scene.name}: found {scene.mesh.num_vertices} vertices and {len(scene.mesh.faces)} faces; expected a "
        "square grid that is pinned at corners, as only that can be meshed anew; keep its own resolution"
    )


def _same(mesh: ClothMesh, grid: ClothMesh) -> bool:
    return mesh.faces.shape == grid.faces.shape and bool((mesh.faces == grid.faces).all())


def _at_corners(pins: Pins | None, count: int) -> bool:
    ends = (0, count - 1)
    return pins is not None and bool(np.isin(np.divmod(pins.vertices, count), ends).all())
