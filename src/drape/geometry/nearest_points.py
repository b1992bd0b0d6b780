"""Nearest points of the same cloth: a few for each point, none beyond a reach."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from drape.geometry.mesh_distances import mesh_distances

APART = 1e6
"""Distance between points of different cloths in the fourth coordinate [m]."""


class NearestPoints(NamedTuple):
    """For each point the targets nearest to it, the nearest first."""

    targets: Int[Tensor, "points nearest"]
    """0 where there are fewer."""
    found: Bool[Tensor, "points nearest"]

    @classmethod
    def find(
        cls,
        points: Float[Tensor, "points 3"],
        mesh_of_point: Int[Tensor, " points"],
        targets: Float[Tensor, "targets 3"],
        mesh_of_target: Int[Tensor, " targets"],
        nearest: int,
        reach: float,
    ) -> NearestPoints:
        """At most ``nearest`` targets of the same mesh, at most ``reach`` [m] away; no graph.

        k-d tree on the CPU; on a device all distances, so that the points stay there.
        """
        nearest = min(nearest, len(targets))
        if not nearest:
            none = mesh_of_point.new_zeros(len(points), 0)
            return cls(none, none.bool())
        with torch.no_grad():
            if points.device.type == "cpu":
                apart = _apart(points, mesh_of_point), _apart(targets, mesh_of_target)
                distance, index = _from_tree(*apart, nearest, reach)
            else:
                distance, index = _from_distances(points, mesh_of_point, targets, mesh_of_target, nearest)
            found = distance <= reach
            return cls(index.masked_fill(~found, 0), found)

    def pairs(self, wanted: Bool[Tensor, "points nearest"]) -> Int[Tensor, "2 pairs"]:
        """(point, target) of the ``wanted`` ones."""
        point, place = wanted.nonzero(as_tuple=True)
        return torch.stack([point, self.targets[point, place]])


def _apart(points: Tensor, mesh: Tensor) -> Tensor:
    points = points.double()
    return torch.cat([points, APART * mesh[:, None].to(points.dtype)], -1)


def _from_tree(points: Tensor, targets: Tensor, nearest: int, reach: float) -> tuple[Tensor, Tensor]:
    tree = cKDTree(targets.numpy(), balanced_tree=False, compact_nodes=False)
    bound, workers = reach * (1.0 + 1e-9), torch.get_num_threads()
    columns = list(range(1, nearest + 1))
    distance, index = tree.query(points.numpy(), columns, distance_upper_bound=bound, workers=workers)
    return torch.from_numpy(distance), torch.from_numpy(index)


def _from_distances(
    points: Tensor, mesh_of_point: Tensor, targets: Tensor, mesh_of_target: Tensor, nearest: int
) -> tuple[Tensor, Tensor]:
    distance = points.new_full((len(points), nearest), torch.inf, dtype=torch.float64)
    index = mesh_of_point.new_zeros(len(points), nearest)
    for point, is_there, target, apart in mesh_distances(points, mesh_of_point, targets, mesh_of_target):
        found, column = apart.topk(min(nearest, apart.shape[-1]), largest=False)
        chosen = target[:, None].expand(-1, apart.shape[1], -1).gather(-1, column)
        distance[point[is_there], : found.shape[-1]] = found[is_there]
        index[point[is_there], : found.shape[-1]] = chosen[is_there]
    return distance, index
