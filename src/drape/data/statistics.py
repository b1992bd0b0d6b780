"""Numbers of the training split that networks are scaled by; computed once, written into the resolved config."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drape.geometry.edge_geometry import EdgeGeometry

if TYPE_CHECKING:
    from drape.data.datamodule import TrajectoryDataModule

WINDOWS = 512
"""Number of training windows that are looked at, evenly spaced."""
BATCH = 16


def training_statistics(data: TrajectoryDataModule) -> dict[str, float]:
    """Statistics of evenly spaced windows of the training split.

    Root mean squares: ``stretch`` of Δl [m] and ``speed`` of edge midpoints [m/s]. ``stretch_typical`` is the median
    of |Δl| [m], ``hinge_typical`` that of |Δθ| of inner edges [rad], ``area`` the mean area at an edge [m²]. Energies:
    ``edge_energy``, the root mean square of ΔV of a cloth over the square root of the number of its edges [J];
    ``edge_energy_density``, the same over ``area`` [J/m²]; ``typical_work``, the mean internal force on a vertex times
    ``stretch_typical`` [J].
    """
    sums = dict.fromkeys(("stretch", "speed", "balance", "force", "median", "hinge", "area", "edges"), 0.0)
    seen = 0
    for window in data.spaced_windows(WINDOWS, BATCH):
        seen += window.mesh.num_meshes
        geometry, previous = EdgeGeometry(window.x_next, window.mesh), EdgeGeometry(window.x, window.mesh)
        stretch = geometry.length - window.mesh.rest_lengths
        means = {
            "stretch": stretch.square().mean(),
            "speed": (geometry.midpoint - previous.midpoint).square().sum(-1).mean() / window.dt**2,
            "balance": window.balance.square().mean(),
            "force": window.inertial_force[window.free].norm(dim=-1).mean(),
            "median": stretch.abs().median(),
            "hinge": geometry.hinge_change[~window.mesh.boundary].abs().median(),
            "area": geometry.area.mean(),
            "edges": window.mesh.num_edges / window.mesh.num_meshes,
        }
        for name, value in means.items():
            sums[name] += float(value) * window.mesh.num_meshes
    sums = {name: value / seen for name, value in sums.items()}
    edge_energy = math.sqrt(sums["balance"] / sums["edges"])
    return {
        "stretch": math.sqrt(sums["stretch"]),
        "stretch_typical": sums["median"],
        "hinge_typical": sums["hinge"],
        "speed": math.sqrt(sums["speed"]),
        "area": sums["area"],
        "edge_energy": edge_energy,
        "edge_energy_density": edge_energy / sums["area"],
        "typical_work": sums["force"] * sums["median"],
    }
