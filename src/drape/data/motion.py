"""Statistics of a trajectory that need no fabric: speeds, edge strains, external energy (numpy)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.geometry.mesh import ClothMesh


def speeds(positions: Float[np.ndarray, "frames vertices 3"], dt: float) -> Float[np.ndarray, "frames-1 vertices"]:
    """``|x^t - x^{t-1}| / dt`` [m/s], from the second frame on."""
    return np.linalg.norm(np.diff(positions.astype(np.float64), axis=0), axis=-1) / dt


def edge_strain(
    positions: Float[np.ndarray, "frames vertices 3"], mesh: ClothMesh
) -> Float[np.ndarray, "frames edges"]:
    """Length of each edge over its rest length, minus 1."""
    ends = positions.astype(np.float64)[:, mesh.edges]
    return np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=-1) / mesh.rest_lengths - 1.0


def external_energy_per_mass(
    positions: Float[np.ndarray, "frames vertices 3"],
    dt: float,
    gravity: Float[np.ndarray, " 3"],
    mass: Float[np.ndarray, " vertices"] | None = None,
) -> Float[np.ndarray, " frames-1"]:
    """Kinetic and gravitational energy ``mean over the mass of ½|v|² - g·x`` [J/kg], from the second frame on.

    Without ``mass`` all vertices have the same (Blender's cloth); v by backward differences.
    """
    kinetic = 0.5 * speeds(positions, dt) ** 2
    return np.average(kinetic - positions[1:].astype(np.float64) @ gravity, axis=1, weights=mass)
