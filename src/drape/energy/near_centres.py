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

from drape.energy.mesh_distances import mesh_distances
from drape.scene.triangles import closest_on_triangles

SLACK = 1e-5
"""Share by which rounding may misjudge the distance to a centre."""
APART = 1e6
"""Distance between bodies of different cloths in the fourth coordinate [m]."""


class Centres(NamedTuple):
    """Centres and radii of the faces of all bodies."""

    place: Float[Tensor, "faces 3"]
    mesh: Int[Tensor, " faces"]
    """The cloth whose obstacle a face is of."""
    radius: Float[Tensor, " faces"]
    size: Tensor
    """Size class of each face: the exponent of its radius to base 2."""

    @classmethod
    def of(cls, corners: Float[Tensor, "faces 3 3"], mesh: Int[Tensor, " faces"]) -> Centres:
        """Of triangles with the numbers of the cloths whose obstacles they are."""
        centre = corners.mean(1)
        radius = (corners - centre[:, None]).norm(dim=-1).amax(-1)
        return cls(centre, mesh, radius, radius.log2().floor().long())


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
    """All pairs among which the nearest face of each point within ``search_range`` is found.

    k-d trees on the CPU; on a device all distances, so that the positions stay there.
    """
    if not len(points) or not len(corners):
        vertex = face = torch.empty(0, dtype=torch.long, device=points.device)
    elif points.device.type == "cpu":
        vertex, face = _from_trees(points, mesh, corners, centres, search_range)
    else:
        vertex, face = _from_distances(points, mesh, centres, search_range)
    return Pairs(vertex, face, centres.radius[face])


def _from_distances(points: Tensor, mesh: Tensor, centres: Centres, search_range: float) -> tuple[Tensor, Tensor]:
    """The centre of a face is on it, so that the nearest face is no farther away than the nearest centre."""
    pairs = []
    for point, is_there, face, distance in mesh_distances(points, mesh, centres.place, centres.mesh):
        reach = distance.amin(-1, keepdim=True).clamp(max=search_range)
        near = distance <= (reach + centres.radius[face][:, None]) * (1.0 + SLACK)
        of_mesh, row, column = (near & is_there[..., None]).nonzero(as_tuple=True)
        pairs.append((point[of_mesh, row], face[of_mesh, column]))
    vertex, face = (torch.cat(part) for part in zip(*pairs, strict=True))
    return vertex, face


def _from_trees(
    points: Tensor, mesh: Tensor, corners: Tensor, centres: Centres, search_range: float
) -> tuple[Tensor, Tensor]:
    """Points of different cloths stand apart in a fourth coordinate."""
    place = _apart(points, mesh)
    groups = [_Group(members, centres) for members in _classes(centres)]
    reach = points.new_full((len(points),), search_range)
    for group in groups:
        some, nearest = group.nearest(place, search_range)
        _, bound = closest_on_triangles(gathered(points, some), gathered(corners, nearest))
        reach[some] = torch.minimum(reach[some], bound)
    found = [group.pairs(place, reach) for group in groups]
    vertex, face = (torch.cat([pair[end] for pair in found]) for end in range(2))
    return vertex, face


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
        self.place = _apart(centres.place[members], centres.mesh[members])
        self.radius = centres.radius[members]
        self.largest = float(self.radius.max()) * (1.0 + SLACK)
        self.tree = cKDTree(self.place.numpy(), balanced_tree=False, compact_nodes=False)

    def nearest(self, place: Tensor, reach: float) -> tuple[Tensor, Tensor]:
        """Those of the points that have a face whose centre is near enough to matter, and the nearest such face."""
        bound = reach * (1.0 + SLACK) + self.largest
        found = self.tree.query(place.numpy(), distance_upper_bound=bound, workers=torch.get_num_threads())
        distance, index = (torch.from_numpy(part) for part in found)
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
        """All (point, place in ``members``) no farther apart than ``radius``."""
        threads = torch.get_num_threads()
        found = self.tree.query_ball_point(place.numpy(), radius.numpy(), workers=threads, return_sorted=False)
        count = np.fromiter(map(len, found), np.int64, len(found))
        member = np.fromiter(chain.from_iterable(found), np.int64, count.sum())
        return torch.from_numpy(np.repeat(np.arange(len(found)), count)), torch.from_numpy(member)
