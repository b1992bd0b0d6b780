"""Triangles to pixels with a depth buffer, a frame of a garment in milliseconds, without Blender."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.scene.camera import Camera
from drape.scene.compiled import compiled

BACKGROUND = 0.97
LIGHT = np.array([-0.45, 0.60, 0.66])
"""Direction of the light: right, up, towards the viewer."""
BACK_SHADE = 0.65
"""Brightness of the back of a face, relative to its front."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh of one colour, or of one for each vertex (sRGB, 0 to 1)."""

    positions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    colour: tuple[float, float, float] | Float[np.ndarray, "vertices 3"]


def draw(surfaces: list[Surface], camera: Camera, width: int, height: int) -> Float[np.ndarray, "height width 3"]:
    """A picture (0 to 1) of ``surfaces``, smoothly shaded on both sides, nearer ones in front; 4 samples a pixel."""
    return _samples(surfaces, camera, width, height)[0].mean(axis=(1, 3))


def cut_out(surfaces: list[Surface], camera: Camera, width: int, height: int) -> Float[np.ndarray, "height width 4"]:
    """As :func:`draw`, with opacity as the fourth channel: nothing where there is no surface."""
    samples, covered = _samples(surfaces, camera, width, height)
    opacity = covered.mean(axis=(1, 3))[..., None]
    colour = np.where(covered[..., None], samples, 0.0).mean(axis=(1, 3)) / np.maximum(opacity, 0.25)
    return np.concatenate([colour, opacity], axis=2)


def _samples(surfaces: list[Surface], camera: Camera, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Colours of the samples (height, 2, width, 2, 3), and whether a surface is there."""
    shape = 2 * height, 2 * width
    picture = np.full((*shape, 3), BACKGROUND, np.float32)
    nearness = np.zeros(shape)  # 1 / distance [1/m], which is linear across the picture of a plane
    for surface in surfaces:
        projected = camera.project(surface.positions)
        across = (projected[:, 0] + 1.0) * width - 0.5
        down = (1.0 - projected[:, 1]) * height - 0.5
        normals = _vertex_normals(surface) @ camera.axes
        screen = np.column_stack([across, down, 1.0 / projected[:, 2]])
        visible = (projected[:, 2] > 0.0) & np.isfinite(screen).all(axis=1)
        _fill(
            picture,
            nearness,
            surface.faces[visible[surface.faces].all(axis=1)],
            screen,
            normals,
            np.asarray(surface.colour),
        )
    samples = height, 2, width, 2
    return picture.reshape(*samples, 3), (nearness > 0.0).reshape(samples)


def _vertex_normals(surface: Surface) -> np.ndarray:
    """Normals of the vertices, weighted by the areas of their faces; not of unit length."""
    corners = surface.positions[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = [np.bincount(surface.faces.ravel(), np.repeat(normals[:, k], 3), len(surface.positions)) for k in range(3)]
    total = np.stack(sums, axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)


def _fill(
    picture: np.ndarray,
    nearness: np.ndarray,
    faces: np.ndarray,
    screen: np.ndarray,
    normals: np.ndarray,
    colour: np.ndarray,
) -> None:
    """Draw ``faces`` where they are nearer than what is in ``picture``."""
    face_of = np.full(nearness.shape, -1)
    weights = np.zeros((*nearness.shape, 3))
    _nearest_faces(faces, screen, nearness, face_of, weights)
    drawn = face_of >= 0
    corners, weights = faces[face_of[drawn]], weights[drawn]
    normal = np.einsum("nk,nkc->nc", weights, normals[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    if colour.ndim == 2:
        colour = np.einsum("nk,nkc->nc", weights, colour[corners])
    picture[drawn] = np.clip(_shade(normal)[:, None] * colour, 0.0, 1.0)


@compiled
def _nearest_faces(faces, screen, nearness, face_of, weights) -> None:
    """For each sample the nearest face that covers it, if it is nearer than ``nearness``, and its barycentric weights.

    ``screen``: across and down [samples], 1 / distance. Compiled: a loop over the samples of each face's bounding box.
    """
    height, width = nearness.shape
    for f in range(len(faces)):
        a, b, c = screen[faces[f, 0]], screen[faces[f, 1]], screen[faces[f, 2]]
        double_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(double_area) < 1e-12:
            continue
        left, right = max(0.0, np.ceil(min(a[0], b[0], c[0]))), min(width - 1.0, np.floor(max(a[0], b[0], c[0])))
        top, bottom = max(0.0, np.ceil(min(a[1], b[1], c[1]))), min(height - 1.0, np.floor(max(a[1], b[1], c[1])))
        if left > right or top > bottom:
            continue
        for down in range(int(top), int(bottom) + 1):
            for across in range(int(left), int(right) + 1):
                x, y = across - a[0], down - a[1]
                second = (x * (c[1] - a[1]) - y * (c[0] - a[0])) / double_area
                third = ((b[0] - a[0]) * y - (b[1] - a[1]) * x) / double_area
                first = 1.0 - second - third
                if first < -1e-9 or second < -1e-9 or third < -1e-9:
                    continue
                near = first * a[2] + second * b[2] + third * c[2]
                if near > nearness[down, across]:
                    nearness[down, across], face_of[down, across] = near, f
                    weights[down, across] = first, second, third


def _shade(normal: np.ndarray) -> np.ndarray:
    """Brightness of a surface that is lit from the viewer's side, whichever side it shows."""
    front = normal[:, 2] >= 0.0
    lit = np.maximum(np.where(front, 1.0, -1.0) * (normal @ LIGHT), 0.0)
    return (0.45 + 0.75 * lit) * np.where(front, 1.0, BACK_SHADE)
