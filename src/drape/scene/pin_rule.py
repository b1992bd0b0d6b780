"""Pinned vertices of a garment: a list, or a rule that needs no counting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.scene.frozen_array import frozen_indices


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
