"""Jaggedness of hems: saw teeth of single edges, which a law that hardly feels them lets grow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from drape.geometry.mesh import ClothMesh


def hem_corners(mesh: ClothMesh) -> Int[np.ndarray, "corners 3"]:
    """Vertices (before, here, after) along the boundary: wherever two boundary edges meet."""
    ends = mesh.edges[mesh.boundary]
    both = np.concatenate([ends, ends[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    here, first, count = np.unique(both[:, 0], return_index=True, return_counts=True)
    here, first = here[count == 2], first[count == 2]
    return np.stack([both[first, 1], here, both[first + 1, 1]], axis=1)


def hem_angle(x: Float[np.ndarray, "frames vertices 3"], mesh: ClothMesh) -> Float[np.ndarray, " frames"]:
    """Root mean square of the angle between neighbouring boundary edges [rad], 0 where a hem is straight.

    NaN of a cloth without a boundary.
    """
    before, here, after = hem_corners(mesh).T
    if not len(here):
        return np.full(len(x), np.nan)
    along, onward = x[:, here] - x[:, before], x[:, after] - x[:, here]
    sine = np.linalg.norm(np.cross(along, onward), axis=-1)
    return np.sqrt((np.arctan2(sine, (along * onward).sum(-1)) ** 2).mean(axis=1))
