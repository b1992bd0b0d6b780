"""Which faces can be nearest to a point: a search among the centres of faces that misses none.

A face lies within its radius around its centre. If some face is at a distance u, then a face whose centre is farther
than u plus its radius is not the nearest. Faces are searched in classes of similar radius, so that a floor of two
triangles does not make the search among the small faces of a figure on it wider.
"""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from drape.scene.triangles import closest_on_triangles

SLACK = 1e-5
"""Share by which single precision may misjudge the distance to a centre."""
CHUNK = 2**26
"""Distances held at a time on a device."""

APART = 1e6
"""Distance between bodies of different cloths in the fourth coordinate [m]."""


class Centres(NamedTuple):
    """Centres and radii of the faces of all bodies; bodies of different cloths stand apart in a fourth coordinate."""

    place: Float[Tensor, "faces 4"]
    radius: Float[Tensor, " faces"]
    size: Tensor
    """Size class of each face: the exponent of its radius to base 2."""

    @classmethod
    def of(cls, corners: Float[Tensor, "faces 3 3"], mesh: Int[Tensor, " faces"]) -> Centres:
        """Of triangles with the numbers of the cloths whose obstacles they are."""
        centre = corners.mean(1)
        radius = (corners - centre[:, None]).norm(dim=-1).amax(-1)
        return cls(_apart(centre, mesh), radius, radius.log2().floor().long())


class Pairs(NamedTuple):
    """Pairs of a vertex and a face that may be its nearest."""

    vertex: Int[Tensor, " pairs"]
    face: Int[Tensor, " pairs"]
    radius: Float[Tensor, " pairs"]
    """Of the face [m]."""


def pairs_in_reach(
    points: Float[Tensor, "vertices 3"],
    mesh: Int[Tensor, " vertices"],
    corners: Float[Tensor, "faces 3 3"],
    centres: Centres,
    search_range: float,
) -> Pairs:
    """All pairs among which the nearest face of each point within ``search_range`` is found."""
    place = _apart(points, mesh)
    groups = [_Group(members, centres) for members in _classes(centres)]
    reach = points.new_full((len(points),), search_range)
    for group in groups:
        some, nearest = group.nearest(place, search_range)
        _, bound = closest_on_triangles(gathered(points, some), gathered(corners, nearest))
        reach[some] = torch.minimum(reach[some], bound)
    found = [group.pairs(place, reach) for group in groups]
    empty = torch.empty(0, dtype=torch.long, device=points.device)
    vertex, face = (torch.cat([empty, *(pair[end] for pair in found)]) for end in range(2))
    return Pairs(vertex, face, centres.radius[face])


def gathered(values: Float[Tensor, "all ..."], index: Int[Tensor, " chosen"]) -> Float[Tensor, "... chosen"]:
    """``values[index]`` with the chosen in the last place, contiguous."""
    flat = values.flatten(1).T.contiguous()
    return flat.index_select(1, index).view(*values.shape[1:], len(index))


def _apart(points: Float[Tensor, "points 3"], mesh: Int[Tensor, " points"]) -> Float[Tensor, "points 4"]:
    return torch.cat([points, APART * mesh[:, None].to(points.dtype)], -1)


def _classes(centres: Centres) -> list[Tensor]:
    return [(centres.size == size).nonzero()[:, 0] for size in centres.size.unique()]


class _Group:
    """Faces of similar radius."""

    def __init__(self, members: Int[Tensor, " members"], centres: Centres):
        self.members = members
        self.place = centres.place[members]
        self.radius = centres.radius[members]
        self.largest = float(self.radius.max()) * (1.0 + SLACK)
        on_cpu = self.place.device.type == "cpu"
        self.tree = cKDTree(self.place.numpy(), balanced_tree=False, compact_nodes=False) if on_cpu else None

    def nearest(self, place: Tensor, reach: float) -> tuple[Tensor, Tensor]:
        """Those of the points that have a face whose centre is near enough to matter, and the nearest such face."""
        bound = reach * (1.0 + SLACK) + self.largest
        if self.tree is not None:
            found = self.tree.query(place.numpy(), distance_upper_bound=bound, workers=torch.get_num_threads())
            distance, index = (torch.from_numpy(part) for part in found)
        else:
            parts = [self._distances(part).min(-1) for part in self._chunks(place)]
            distance, index = (torch.cat(part) for part in zip(*parts, strict=True))
        some = (distance <= bound).nonzero()[:, 0]
        return some, self.members[index[some]]

    def pairs(self, place: Tensor, reach: Tensor) -> tuple[Tensor, Tensor]:
        """All (point, face) with the centre within ``reach`` plus the radius of the face."""
        limit = reach * (1.0 + SLACK)
        row, member = self._within(place, limit + self.largest)
        distance = (place.index_select(0, row) - self.place.index_select(0, member)).norm(dim=-1)
        near = distance <= limit[row] + self.radius[member] * (1.0 + SLACK)
        return row[near], self.members[member[near]]

    def _within(self, place: Tensor, radius: Tensor) -> tuple[Tensor, Tensor]:
        """All (point, place in ``members``) no farther apart than ``radius``.

        k-d tree on the CPU; on a device all distances, a chunk at a time, so that the positions stay there.
        """
        if self.tree is not None:
            threads = torch.get_num_threads()
            found = self.tree.query_ball_point(place.numpy(), radius.numpy(), workers=threads, return_sorted=False)
            count = np.fromiter(map(len, found), np.int64, len(found))
            member = np.fromiter(chain.from_iterable(found), np.int64, count.sum())
            return torch.from_numpy(np.repeat(np.arange(len(found)), count)), torch.from_numpy(member)
        every = torch.arange(len(place), device=place.device)
        pairs = []
        for part in self._chunks(every):
            row, member = (self._distances(place[part]) <= radius[part, None]).nonzero(as_tuple=True)
            pairs.append((part[row], member))
        row, member = (torch.cat(part) for part in zip(*pairs, strict=True))
        return row, member

    def _chunks(self, values: Tensor) -> tuple[Tensor, ...]:
        return values.split(max(1, CHUNK // len(self.members)))

    def _distances(self, place: Tensor) -> Tensor:
        return torch.cdist(place, self.place, compute_mode="donot_use_mm_for_euclid_dist")
