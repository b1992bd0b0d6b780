"""Input features of a graph network: nodes and edges, seen from the garment, in numbers around one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from drape.energy.step import Step
from drape.errors import DrapeError
from drape.geometry.edge_geometry import TINY, safe_norm
from drape.geometry.fixed_size import counted
from drape.nets.mesh_graph_net import EdgeSet
from drape.simulators.kinematic.body_points import BodyPoints
from drape.simulators.neural.heading import Heading

STANDARD_GRAVITY = 9.81
"""[m/s²]"""
FREE, PINNED, BODY = range(3)
"""The types of nodes."""
OWN = 13
"""Features of a vertex before its attributes."""
STRAIN = 0.02
"""Strain of an edge that counts as one; that of recorded garments is of this size."""


class Graph(NamedTuple):
    """Inputs of a graph network."""

    nodes: Float[Tensor, "nodes features"]
    """Those of the cloth first."""
    edges: dict[str, EdgeSet]
    points: BodyPoints | None
    """Of the edges from the body, in their order; None without obstacle."""


@dataclass(frozen=True)
class GraphInputs:
    """The features of nodes and edges. Differences are taken in the precision of the step; vectors are scaled alike.

    * Nodes: velocity, normal; of the cloth also the acceleration that would let it go with the body, 0 beyond
      ``reach``, log(mass), acceleration by gravity and external force, attributes (0 for the body); type; deepest
      coarse level. At a pinned vertex the velocity is the one prescribed for the step.
    * Edges of the mesh and of its coarse levels, both ways: receiver minus sender at t, at t + dt without forces, and
      at rest; its direction at t + dt times its strain there; length at rest; strains at t and t + dt; attributes.
    * Edges from the body, one for each vertex inside it or within ``reach``: the vertex minus its closest point of the
      body at t and, without forces, at t + dt, with norms; the normal of the body there; signed distance; height over
      the plane of the face at t + dt, and how far it is short of ``thickness``, as a share. Without obstacle there are
      none and nothing is searched.

    Strains ε count as ``asinh(ε / 0.02)``.
    """

    attributes: int
    coarse_levels: int
    reach: float
    thickness: float
    speed: float
    acceleration: float
    edge_length: float
    mass: float

    @property
    def size_node(self) -> int:
        """Number of features of a node."""
        return OWN + self.attributes + 3 + (self.coarse_levels + 1 if self.coarse_levels else 0)

    @property
    def sizes_edge(self) -> dict[str, int]:
        """Number of features of an edge of each set."""
        names = ["mesh", *(f"coarse_{level}" for level in range(1, self.coarse_levels + 1))]
        return {name: 15 + self.attributes for name in names} | {"body": 14}

    def of(self, step: Step, heading: Heading) -> Graph:
        """In the frames ``heading``.

        Raises:
            DrapeError: a step with another number of attributes.
        """
        if step.attributes.shape[1] != self.attributes:
            raise DrapeError(
                f"graph network: the step has {step.attributes.shape[1]} material attributes, the network was made for "
                f"{self.attributes}; set its attributes to the number that the fabric has"
            )
        mesh = step.mesh
        level, sets = None, {"mesh": mesh.edges}
        if self.coarse_levels:
            hierarchy = mesh.coarse_levels(self.coarse_levels)
            level = hierarchy.level
            sets |= {f"coarse_{number}": ends for number, ends in enumerate(hierarchy.edges, 1)}
        points = None if step.obstacle is None else BodyPoints.of(step, self.reach)
        nodes = self._cloth_nodes(step, heading, level, points)
        edges = {name: self._cloth_edges(step, heading, ends) for name, ends in sets.items()}
        if points is not None:
            nodes = torch.cat([nodes, self._body_nodes(points, step, heading)])
            edges["body"] = self._body_edges(points, step, heading, level)
        return Graph(nodes, edges, points)

    def _cloth_nodes(self, step: Step, heading: Heading, level: Tensor | None, points: BodyPoints | None) -> Tensor:
        mesh_of = step.mesh.mesh_of_vertex
        drive = step.gravity.expand_as(step.x)
        if step.external_force is not None:
            drive = drive + step.external_force / step.mass[:, None]
        along = torch.zeros_like(step.x)
        if points is not None:
            behind = (points.velocity - step.v[points.vertices]) / (step.dt * self.acceleration)
            along = along.index_copy(0, points.vertices, counted(behind, points.there))
        vectors = torch.stack([step.v / self.speed, step.geometry.vertex_normals, along, drive / STANDARD_GRAVITY], 1)
        velocity, normal, along, drive = heading.inward(vectors, mesh_of[:, None].expand(-1, 4)).unbind(1)
        kind = _columns(torch.where(step.free, FREE, PINNED), 3)
        mass = (step.mass / self.mass).log()[:, None]
        features = [velocity, normal, along, mass, drive, step.attributes[mesh_of], kind]
        if level is not None:
            features.append(_columns(level, self.coarse_levels + 1))
        return torch.cat([f.to(step.x.dtype) for f in features], -1)

    def _body_nodes(self, points: BodyPoints, step: Step, heading: Heading) -> Tensor:
        vectors = torch.stack([points.velocity / self.speed, points.normal], 1)
        mesh_of = step.mesh.mesh_of_vertex[points.vertices]
        nodes = step.x.new_zeros(len(points.vertices), self.size_node)
        nodes[:, :6] = heading.inward(vectors, mesh_of[:, None].expand(-1, 2)).flatten(1)
        nodes[:, OWN + self.attributes + BODY] = 1.0
        return nodes

    def _cloth_edges(self, step: Step, heading: Heading, ends: Int[Tensor, "pairs 2"]) -> EdgeSet:
        first, second = ends.unbind(-1)
        mesh_of = step.mesh.mesh_of_vertex[first]
        places = (step.x, step.inertial, step.mesh.rest_positions.to(step.x.dtype))
        *moving, rest = (place.index_select(0, second) - place.index_select(0, first) for place in places)
        turned = heading.inward(torch.stack(moving, 1), mesh_of[:, None].expand(-1, 2))
        arms = torch.cat([turned, rest[:, None]], 1) / self.edge_length
        lengths = safe_norm(arms, TINY)
        strains = torch.asinh((lengths[:, :2] / lengths[:, 2:] - 1.0) / STRAIN)
        pull = strains[:, 1:] * arms[:, 1] / lengths[:, 1:2]
        vectors = torch.cat([arms.flatten(1), pull], -1)
        same_both_ways = torch.cat([lengths[:, 2:], strains, step.attributes[mesh_of].to(arms.dtype)], -1)
        there, back = (torch.cat([v, same_both_ways], -1) for v in (vectors, -vectors))
        return EdgeSet(torch.cat([first, second]), torch.cat([second, first]), torch.cat([there, back]))

    def _body_edges(self, points: BodyPoints, step: Step, heading: Heading, level: Tensor | None) -> EdgeSet:
        vertices = points.vertices
        arms = torch.stack([step.x[vertices] - points.x, step.inertial[vertices] - points.x_next], 1)
        height = (arms[:, 1] * points.normal).sum(-1, keepdim=True)
        short = (1.0 - height / self.thickness).clamp(min=0.0)
        vectors = torch.stack([arms[:, 0] / self.reach, arms[:, 1] / self.reach, points.normal], 1)
        vectors = heading.inward(vectors, step.mesh.mesh_of_vertex[vertices][:, None].expand(-1, 3))
        numbers = [safe_norm(vectors[:, :2], TINY), points.distance[:, None] / self.reach, height / self.reach, short]
        senders = step.mesh.num_vertices + torch.arange(len(vertices), device=vertices.device)
        features = counted(torch.cat([vectors.flatten(1), *numbers], -1), points.there)
        return EdgeSet(senders, vertices, features, None if level is None else level[vertices], points.there)


def _columns(number: Int[Tensor, " rows"], count: int) -> Bool[Tensor, "rows count"]:
    """One-hot; the library's asks whether all numbers are in range."""
    return number[:, None] == torch.arange(count, device=number.device)
