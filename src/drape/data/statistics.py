"""Numbers of the training split that networks are scaled by; computed once, written into the resolved config."""

from __future__ import annotations

import math

import numpy as np
import torch

from drape.data.datamodule import TrajectoryDataModule
from drape.scene.geometry import EdgeGeometry

WINDOWS = 512
"""Number of training windows that are looked at, evenly spaced."""


def training_statistics(data: TrajectoryDataModule) -> dict[str, float]:
    """Root mean squares over evenly spaced windows of the training split.

    ``stretch`` of Δl [m], ``stretch_typical`` median of |Δl| [m], ``speed`` of edge midpoints [m/s], ``balance`` of ΔV
    of a cloth [J], ``edges`` and ``area`` number of edges [1] and area at an edge [m²].
    """
    total = len(data.train_sequences) * (data.file.num_frames - 2)
    chosen = np.unique(np.linspace(0, total - 1, min(WINDOWS, total)).astype(np.int64))
    squares = {"stretch": 0.0, "speed": 0.0, "balance": 0.0}
    medians, batches = [], np.array_split(chosen, math.ceil(len(chosen) / 16))
    for indices in batches:
        window = data.windows(data.train_sequences, indices)
        geometry, previous = EdgeGeometry(window.x_next, window.mesh), EdgeGeometry(window.x, window.mesh)
        stretch = geometry.length - window.mesh.rest_lengths
        speed = (geometry.midpoint - previous.midpoint).norm(dim=-1) / window.dt
        for name, value in {"stretch": stretch, "speed": speed, "balance": window.balance}.items():
            squares[name] += float(value.square().mean()) / len(batches)
        medians.append(float(stretch.abs().median()))
    mesh = data.file.mesh
    statistics = {name: math.sqrt(value) for name, value in squares.items()}
    statistics["stretch_typical"] = float(np.mean(medians))
    statistics["edges"] = mesh.num_edges
    statistics["area"] = float(EdgeGeometry(torch.from_numpy(mesh.rest_positions).double(), window.mesh_one).area.mean())
    return statistics
