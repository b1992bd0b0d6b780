"""A body that the cloth cannot enter: any triangle mesh that may move."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.scene.frozen_array import frozen_floats, frozen_indices

SMALLEST, LARGEST = 1e-6, 1e6
"""Between which any body is [m]."""


@dataclass(frozen=True, eq=False)
class Obstacle:
    """One triangle mesh and where its vertices are in every frame of a scene; faces wind outwards.

    Frame k is at time ``k * dt`` of the scene; a single frame is a body that stands still. The mesh need not be closed,
    nor manifold.

    Raises:
        DrapeError: no face, an index out of range, another shape, a position that is not finite.
    """

    faces: Int[np.ndarray, "faces 3"]
    positions: Float[np.ndarray, "frames body_vertices 3"]
    """[m]"""

    def __post_init__(self) -> None:
        faces = frozen_indices(self.faces, (None, 3), "body: faces")
        positions = frozen_floats(self.positions, (None, None, 3), "body: positions")
        size = np.ptp(positions[0], axis=0).max()
        if not (size > SMALLEST and np.abs(positions).max() < LARGEST):
            raise DrapeError(
                f"body: found a size of {size:g} m; expected more than {SMALLEST:g} m, and places within {LARGEST:g} m"
            )
        if faces.max() >= positions.shape[1]:
            raise DrapeError(
                f"body: faces: found vertex {faces.max()}; expected 0..{positions.shape[1] - 1}, as the body has "
                f"{positions.shape[1]} vertices; faces and positions must come from the same mesh"
            )
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "positions", positions)

    @property
    def num_frames(self) -> int:
        return len(self.positions)

    @property
    def is_static(self) -> bool:
        """It has one frame, which holds at all times."""
        return self.num_frames == 1

    @cached_property
    def welded_faces(self) -> Int[np.ndarray, "faces 3"]:
        """The faces with one vertex in the place of all that coincide in every frame.

        Files often give each face corners of its own, as for shading; which faces share an edge is lost then.
        """
        count = self.positions.shape[1]
        _, first, which = np.unique(self.positions[0], axis=0, return_index=True, return_inverse=True)
        same = first[which.reshape(-1)]
        together = (self.positions == self.positions[:, same]).all(axis=(0, 2))
        return np.where(together, same, np.arange(count))[self.faces]

    def at(self, frame: int) -> Float[np.ndarray, "body_vertices 3"]:
        """Positions at time ``frame * dt`` [m].

        Raises:
            DrapeError: a frame that a moving body does not have.
        """
        if self.is_static:
            return self.positions[0]
        if not 0 <= frame < self.num_frames:
            raise DrapeError(
                f"body: asked for frame {frame}; expected 0..{self.num_frames - 1}; simulate fewer frames, or give a "
                "longer motion"
            )
        return self.positions[frame]
