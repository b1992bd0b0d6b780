"""Display of a stored animation: upright, in the colour of its fabric, in the picture from beginning to end."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from jaxtyping import Float

from drape.data.animation_hdf5 import AnimationFile
from drape.errors import DrapeError
from drape.reading.mesh_record import FileForm
from drape.scene.camera import Camera

COLOURS = {"silk": "#a85f80", "leather": "#7a4a2c", "denim": "#35548c", "cotton": "#c4993a"}
"""Of fabrics by name, sRGB."""
OTHER_COLOUR = "#478577"


def fabric_colour(fabric: str) -> tuple[float, float, float]:
    """Red, green, blue (sRGB, 0 to 1)."""
    text = COLOURS.get(fabric, OTHER_COLOUR)
    red, green, blue = (int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def upright(gravity: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation R (p -> R p) after which gravity pulls along -z: axes change places; I where gravity is zero."""
    axis = int(np.argmax(np.abs(gravity)))
    if gravity[axis] == 0.0:
        return np.eye(3)
    up, right = np.zeros(3), np.zeros(3)
    up[axis] = -np.sign(gravity[axis])
    right[1 if axis == 0 else 0] = 1.0
    return np.stack([right, np.cross(up, right), up])


def _spread(x: np.ndarray, form: FileForm | None) -> np.ndarray:
    return x if form is None else form.spread(x)


class Look:
    """The frames of an animation as they are shown: z is up."""

    def __init__(self, file: AnimationFile) -> None:
        self.file = file
        self._rotation = upright(file.header.gravity)

    @property
    def colour(self) -> tuple[float, float, float]:
        return fabric_colour(self.file.header.fabric)

    @property
    def has_body(self) -> bool:
        return self.file.header.obstacle is not None

    def cloth(self, frame: int, form: FileForm | None = None) -> Float[np.ndarray, "vertices 3"]:
        """Positions of the cloth [m]; with a ``form`` of the vertices of its file."""
        return _spread(self.file.x(frame), form) @ self._rotation.T

    def body(self, frame: int, form: FileForm | None = None) -> Float[np.ndarray, "body_vertices 3"]:
        """Positions of the body [m], in the same way.

        Raises:
            DrapeError: there is none.
        """
        obstacle = self.file.header.obstacle
        if obstacle is None:
            raise DrapeError(f"{self.file.path}: body: found none; expected one, as it is to be shown")
        return _spread(obstacle.at(frame), form) @ self._rotation.T

    def camera(self, aspect: float) -> Camera:
        """A camera that sees the cloth and what is near of the body in all frames."""
        return Camera.framing((self._shown(frame) for frame in range(self.file.num_frames)), aspect)

    @cached_property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest coordinates [m] of all that the camera must see."""
        shown = [self._shown(frame) for frame in range(self.file.num_frames)]
        return np.stack([np.min([p.min(0) for p in shown], axis=0), np.max([p.max(0) for p in shown], axis=0)])

    def _shown(self, frame: int) -> Float[np.ndarray, "points 3"]:
        """The cloth, and the points of the body that are nearer than the cloth is large (a floor may be wide)."""
        cloth = self.cloth(frame)
        if not self.has_body:
            return cloth
        body, low, high = self.body(frame), cloth.min(0), cloth.max(0)
        reach = np.linalg.norm(high - low)
        near = ((body > low - reach) & (body < high + reach)).all(axis=1)
        return np.concatenate([cloth, body[near]])
