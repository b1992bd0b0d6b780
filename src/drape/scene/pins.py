"""Vertices whose positions are given: held in place, or led along a path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.scene.frozen_array import frozen_floats, frozen_indices


@dataclass(frozen=True, eq=False)
class Pins:
    """Pinned vertices and where they are in every frame; frame k is at time ``k * dt`` of the scene.

    A single frame of targets holds them in place.

    Raises:
        DrapeError: no vertex, a vertex twice, another shape, a target that is not finite.
    """

    vertices: Int[np.ndarray, " pinned"]
    targets: Float[np.ndarray, "frames pinned 3"]
    """[m]"""

    def __post_init__(self) -> None:
        vertices = frozen_indices(self.vertices, (None,), "pins: vertices")
        targets = frozen_floats(self.targets, (None, len(vertices), 3), "pins: targets")
        first, repeats = np.unique(vertices, return_counts=True)
        if (repeats > 1).any():
            raise DrapeError(f"pins: vertices: found {first[repeats > 1][0]} twice; expected every vertex once")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "targets", targets)

    @classmethod
    def fixed(cls, vertices: object, x: Float[np.ndarray, "vertices 3"]) -> Pins:
        """Hold ``vertices`` where they are in ``x`` (``vertices 3`` of the whole cloth, [m]).

        Raises:
            DrapeError: a vertex that the cloth does not have, or see :class:`Pins`.
        """
        vertices = frozen_indices(vertices, (None,), "pins: vertices")
        if vertices.max() >= len(x):
            raise DrapeError(
                f"pins: vertices: found {vertices.max()}; expected 0..{len(x) - 1}, as the cloth has {len(x)} vertices"
            )
        return cls(vertices, x[vertices][None])

    @property
    def num_frames(self) -> int:
        return len(self.targets)

    @property
    def is_static(self) -> bool:
        """The targets have one frame, which holds at all times."""
        return self.num_frames == 1

    def at(self, frame: int) -> Float[np.ndarray, "pinned 3"]:
        """Targets at time ``frame * dt`` [m].

        Raises:
            DrapeError: a frame that moving pins do not have.
        """
        if self.is_static:
            return self.targets[0]
        if not 0 <= frame < self.num_frames:
            raise DrapeError(
                f"pins: asked for frame {frame}; expected 0..{self.num_frames - 1}; simulate fewer frames, or give "
                "targets for more"
            )
        return self.targets[frame]


def pinned_vertices(
    pins: Sequence[int] | Mapping[str, float] | None,
    x: Float[np.ndarray, "vertices 3"],
    gravity: Float[np.ndarray, "3"],
    become: Int[np.ndarray, " file_vertices"],
) -> Int[np.ndarray, " pinned"] | None:
    """Vertex indices, or None where nothing is pinned.

    ``pins``: indices as in the file, of which ``become`` says the vertex that each one is now, -1 for those of no face;
    ``{top: d}`` for all vertices within ``d`` [m] below the highest (up is against gravity, or +z
    without gravity); None or an empty list for none.

    Raises:
        DrapeError: an unknown rule, a depth that is negative, an index that the cloth does not have.
    """
    if pins is None or len(pins) == 0:
        return None
    if isinstance(pins, Mapping):
        depth = pins.get("top")
        if len(pins) != 1 or not isinstance(depth, int | float) or not depth >= 0:
            raise DrapeError(
                f"scene.pins: found {dict(pins)}; expected a list of vertex indices, or {{top: metres}} for all "
                "vertices that lie within so many metres below the highest"
            )
        up = -gravity / np.linalg.norm(gravity) if np.any(gravity) else np.array([0.0, 0.0, 1.0])
        height = x @ up
        return np.flatnonzero(height >= height.max() - depth)
    listed = frozen_indices(pins, (None,), "scene.pins")
    if listed.max() >= len(become):
        raise DrapeError(
            f"scene.pins: found vertex {listed.max()}; expected 0..{len(become) - 1}, as the cloth has {len(become)} "
            "vertices"
        )
    vertices = become[listed]
    if (vertices < 0).any():
        raise DrapeError(f"scene.pins: found vertex {listed[vertices < 0][0]}, which belongs to no face; leave it out")
    _, first = np.unique(vertices, return_index=True)
    return vertices if len(set(listed.tolist())) < len(listed) else vertices[np.sort(first)]
