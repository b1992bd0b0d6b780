"""Triangles to pixels with a depth buffer, in numpy: a frame of a garment in a tenth of a second, without Blender."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.scene.camera import Camera

BACKGROUND = 0.97
LIGHT = np.array([-0.45, 0.60, 0.66])
"""Direction of the light: right, up, towards the viewer."""
BACK_SHADE = 0.65
"""Brightness of the back of a face, relative to its front."""
MOST_PIXELS = 4_000_000
"""Pixels of bounding boxes that are looked at together."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh of one colour (sRGB, 0 to 1)."""

    positions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    colour: tuple[float, float, float]


def draw(surfaces: list[Surface], camera: Camera, width: int, height: int) -> Float[np.ndarray, "height width 3"]:
    """A picture (0 to 1) of ``surfaces``, smoothly shaded on both sides, nearer ones in front; 4 samples a pixel."""
    shape = 2 * height, 2 * width
    picture = np.full((*shape, 3), BACKGROUND, np.float32)
    nearness = np.zeros(shape)  # 1 / distance [1/m], which is linear across the picture of a plane
    for surface in surfaces:
        projected = camera.project(surface.positions)
        across = (projected[:, 0] + 1.0) * width - 0.5
        down = (1.0 - projected[:, 1]) * height - 0.5
        normals = _vertex_normals(surface) @ camera.axes
        visible = (projected[surface.faces, 2] > 0.0).all(axis=1)
        screen = np.column_stack([across, down, 1.0 / projected[:, 2]])
        for faces in _portions(surface.faces[visible], screen, shape):
            _fill(picture, nearness, faces, screen, normals, np.array(surface.colour))
    return picture.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))


def _vertex_normals(surface: Surface) -> np.ndarray:
    """Normals of the vertices, weighted by the areas of their faces; not of unit length."""
    corners = surface.positions[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = [np.bincount(surface.faces.ravel(), np.repeat(normals[:, k], 3), len(surface.positions)) for k in range(3)]
    total = np.stack(total, axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)


def _boxes(corners: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """First pixel and size (across, down) of the bounding box of each triangle within the picture."""
    limit = np.array(shape[::-1])
    low = np.clip(np.ceil(corners[..., :2].min(axis=1)), 0, limit).astype(np.int64)
    high = np.clip(np.floor(corners[..., :2].max(axis=1)) + 1, 0, limit).astype(np.int64)
    return low, np.maximum(high - low, 0)


def _portions(faces: np.ndarray, screen: np.ndarray, shape: tuple[int, int]) -> list[np.ndarray]:
    """The faces that are in the picture, in portions that fit into memory."""
    pixels = _boxes(screen[faces], shape)[1].prod(axis=1)
    faces, pixels = faces[pixels > 0], pixels[pixels > 0]
    portion = (np.cumsum(pixels) - pixels) // MOST_PIXELS
    return np.split(faces, np.flatnonzero(np.diff(portion)) + 1) if len(faces) else []


def _fill(
    picture: np.ndarray,
    nearness: np.ndarray,
    faces: np.ndarray,
    screen: np.ndarray,
    normals: np.ndarray,
    colour: np.ndarray,
) -> None:
    """Draw ``faces`` where they are nearer than what is in ``picture``."""
    corners = screen[faces]
    low, size = _boxes(corners, nearness.shape)
    pixels = size.prod(axis=1)
    owner = np.repeat(np.arange(len(faces)), pixels)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(pixels) - pixels, pixels)
    across = low[owner, 0] + place % size[owner, 0]
    down = low[owner, 1] + place // size[owner, 0]
    a, b, c = (corners[:, k, :2] for k in range(3))
    double_area = _cross(b - a, c - a)
    double_area = np.where(np.abs(double_area) < 1e-12, np.inf, double_area)[owner]
    point = np.column_stack([across, down])
    second = _cross(point - a[owner], (c - a)[owner]) / double_area
    third = _cross((b - a)[owner], point - a[owner]) / double_area
    first = 1.0 - second - third
    inside = (first >= -1e-9) & (second >= -1e-9) & (third >= -1e-9) & np.isfinite(double_area)
    owner, across, down = owner[inside], across[inside], down[inside]
    weights = np.stack([first, second, third], axis=1)[inside]
    near = (weights * corners[owner, :, 2]).sum(axis=1)
    order = np.argsort(near, kind="stable")  # the nearest is written last and stays
    order = order[near[order] > nearness[down[order], across[order]]]
    owner, across, down, weights = owner[order], across[order], down[order], weights[order]
    nearness[down, across] = near[order]
    normal = (weights[:, :, None] * normals[faces[owner]]).sum(axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    picture[down, across] = np.clip(_shade(normal)[:, None] * colour, 0.0, 1.0)


def _shade(normal: np.ndarray) -> np.ndarray:
    """Brightness of a surface that is lit from the viewer's side, whichever side it shows."""
    front = normal[:, 2] >= 0.0
    lit = np.maximum(np.where(front, 1.0, -1.0) * (normal @ LIGHT), 0.0)
    return (0.45 + 0.75 * lit) * np.where(front, 1.0, BACK_SHADE)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
