"""Input features of LayersNet: patches, faces of the body and vertices, seen from the garment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.step import Step
from drape.errors import DrapeError
from drape.geometry.edge_geometry import TINY, safe_norm
from drape.geometry.fixed_size import counted
from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.nearest_points import NearestPoints
from drape.geometry.patches import Patches
from drape.nets.layers_transformer import Interactions
from drape.simulators.neural.heading import Heading


class BodySenders(NamedTuple):
    """The faces of the body that patches hear, and who hears them."""

    features: Float[Tensor, "senders features"]
    frames: Float[Tensor, "senders 3 3"]
    """(tangent, tangent, normal) at t."""
    pairs: Int[Tensor, "2 pairs"]
    """(patch, sender)."""


@dataclass(frozen=True)
class LayersInputs:
    """The features. Differences are taken in the precision of the step; vectors are scaled alike.

    * A vertex: velocity (at a pinned one that prescribed for the step), normal, acceleration by gravity and external
      force, log(mass), 1 where pinned, attributes.
    * A vertex near the body: also whether, signed distance at t, and from the face nearest to it, as that is at t + dt:
      its axes, and where the vertex would be without forces, as seen from its closest point, with the height of that.
    * A patch: the mean of its vertices, and its centre now and at rest from that of the cloth.
    * A vertex as a patch sees it: position now and at rest and velocity from those of the patch, difference of the
      two distances.
    * A sender, the centre of a face of the body: position from the centre of the cloth, velocity over the step, axes.

    Args:
        attributes: number of attributes of a fabric.
        patch_size: [m]
        patch_reach: how near other patches must be to be heard [m]; the unit of positions.
        world_neighbours: how many of them at most.
        body_reach: how near the centre of a face of the body must be to be heard by a patch [m].
        body_neighbours: how many of them at most.
        felt_reach: how near the body must be to be felt by a vertex [m].
        speed: unit of velocities [m/s].
        acceleration: unit of accelerations [m/s²].
        edge_length: unit of the distances of vertices from patches and body [m].
        mass: unit of masses [kg].
    """

    attributes: int
    patch_size: float
    patch_reach: float
    world_neighbours: int
    body_reach: float
    body_neighbours: int
    felt_reach: float
    speed: float
    acceleration: float
    edge_length: float
    mass: float

    @property
    def size_vertex(self) -> int:
        """Number of features of a vertex."""
        return self._size_cloth + 15

    @property
    def size_patch(self) -> int:
        """Number of features of a patch."""
        return self._size_cloth + 6

    @property
    def _size_cloth(self) -> int:
        return 11 + self.attributes

    size_relative = 10
    size_body = 15

    def of_vertices(self, step: Step, heading: Heading) -> Float[Tensor, "vertices size_cloth"]:
        """Features of vertices without the body.

        Raises:
            DrapeError: a step with another number of material attributes.
        """
        if step.attributes.shape[1] != self.attributes:
            raise DrapeError(
                f"LayersNet: the step has {step.attributes.shape[1]} material attributes, the network was made for "
                f"{self.attributes}; set its attributes to the number that the fabric has"
            )
        mesh_of = step.mesh.mesh_of_vertex
        drive = step.gravity.expand_as(step.x)
        if step.external_force is not None:
            drive = drive + step.external_force / step.mass[:, None]
        vectors = torch.stack([step.v / self.speed, step.geometry.vertex_normals, drive / self.acceleration], 1)
        vectors = _inward(heading, vectors, mesh_of)
        mass, pinned = (step.mass / self.mass).log()[:, None], (~step.free)[:, None]
        return _joined(step, vectors.flatten(1), mass, pinned, step.attributes[mesh_of])

    def near_body(self, step: Step, heading: Heading) -> Float[Tensor, "vertices 15"]:
        """Features of the body near vertices; 0 far from it, and without obstacle, when nothing is searched."""
        felt = step.x.new_zeros(step.mesh.num_vertices, 15)
        if step.obstacle is None:
            return felt
        near = step.near_vertices(self.felt_reach)
        axes = torch.cat([near.end.tangents, near.end.normal[:, None]], 1)
        arm = (step.inertial[near.points] - near.end.point) / self.edge_length
        mesh_of = step.mesh.mesh_of_vertex[near.points]
        vectors = _inward(heading, torch.cat([axes, arm[:, None]], 1), mesh_of)
        height = (arm * near.end.normal).sum(-1, keepdim=True)
        distance = near.distance[:, None] / self.edge_length
        rows = _joined(step, torch.ones_like(distance), distance, height, vectors.flatten(1))
        return felt.index_copy(0, near.points, counted(rows, near.there))

    def of_patches(
        self, vertices: Float[Tensor, "vertices size_cloth"], patches: Patches, step: Step, heading: Heading
    ) -> Float[Tensor, "patches size_patch"]:
        """Features of patches; ``vertices`` from :meth:`of_vertices`."""
        mesh_of = patches.mesh_of_patch
        rest = step.mesh.rest_positions
        places = [patches.mean(_from_middle(p, step.mesh)) / self.patch_reach for p in (step.x, rest)]
        return _joined(step, patches.mean(vertices), heading.inward(places[0], mesh_of), places[1])

    def of_candidates(self, patches: Patches, step: Step, heading: Heading) -> Float[Tensor, "asked 10"]:
        """The vertices as their candidate patches see them."""
        vertex, patch = patches.candidates

        def offset(of_vertices: Tensor, unit: float) -> Tensor:
            return (of_vertices.index_select(0, vertex) - patches.mean(of_vertices).index_select(0, patch)) / unit

        now, rest = (offset(p, self.edge_length) for p in (_from_middle(step.x, step.mesh), step.mesh.rest_positions))
        vectors = torch.stack([now, offset(step.v, self.speed)], 1)
        vectors = _inward(heading, vectors, step.mesh.mesh_of_vertex[vertex])
        stretch = (safe_norm(now, TINY) - safe_norm(rest, TINY))[:, None]
        return _joined(step, vectors.flatten(1), rest, stretch)

    def of_bodies(self, patches: Patches, step: Step, heading: Heading) -> BodySenders:
        """The faces of the body near patches; none without obstacle, when nothing is searched."""
        if step.obstacle is None:
            none = step.x.new_zeros(0, self.size_body)
            return BodySenders(none, none.new_zeros(0, 3, 3), patches.neighbours[:, :0])
        body, mesh_of = step.obstacle, step.obstacle.mesh_of_face
        middle = _middle(step.x, step.mesh)
        centre = body.x[body.faces].mean(1) - middle[mesh_of]
        place = patches.mean(_from_middle(step.x, step.mesh))
        search = (place, patches.mesh_of_patch, centre, mesh_of, self.body_neighbours, self.body_reach)
        found = NearestPoints.find(*search)
        receiver, face = found.pairs(found.found)
        heard, sender = face.unique(return_inverse=True)
        corners, mesh_of = body.x[body.faces[heard]], mesh_of[heard]
        velocity = ((body.x_next - body.x) / step.dt)[body.faces[heard]].mean(1)
        vectors = torch.stack([centre[heard] / self.patch_reach, velocity / self.speed], 1)
        vectors = _inward(heading, torch.cat([vectors, _axes(corners)], 1), mesh_of)
        return BodySenders(_joined(step, vectors.flatten(1)), vectors[:, 2:], torch.stack([receiver, sender]))

    def interactions(self, patches: Patches, body: BodySenders, step: Step) -> Interactions:
        """Edges of attention: a patch itself and those beside it; others near in space; the body."""
        count = patches.num_patches
        itself = torch.arange(count, device=step.x.device).expand(2, -1)
        beside = torch.cat([itself, patches.neighbours], 1)
        most = int(patches.neighbours[0].bincount(minlength=count).max()) + 1
        place, mesh_of = patches.mean(_from_middle(step.x, step.mesh)), patches.mesh_of_patch
        near = NearestPoints.find(place, mesh_of, place, mesh_of, self.world_neighbours + most, self.patch_reach)
        taken = torch.isin(near.targets + count * itself[0][:, None], beside[1] + count * beside[0])
        wanted = near.found & ~taken
        wanted &= wanted.cumsum(1) <= self.world_neighbours
        return Interactions(mesh=beside, world=near.pairs(wanted), body=body.pairs)


def _joined(step: Step, *parts: Tensor) -> Tensor:
    return torch.cat([part.to(step.x.dtype) for part in parts], -1)


def _inward(heading: Heading, vectors: Float[Tensor, "rows several 3"], mesh_of: Int[Tensor, " rows"]) -> Tensor:
    return heading.inward(vectors, mesh_of[:, None].expand(-1, vectors.shape[1]))


def _middle(points: Float[Tensor, "vertices 3"], mesh: MeshBatch) -> Float[Tensor, "meshes 3"]:
    total = points.new_zeros(mesh.num_meshes, 3).index_add(0, mesh.mesh_of_vertex, points)
    return total / mesh.mesh_of_vertex.bincount(minlength=mesh.num_meshes)[:, None]


def _from_middle(points: Float[Tensor, "vertices 3"], mesh: MeshBatch) -> Float[Tensor, "vertices 3"]:
    """Positions from the mean of their cloth [m]."""
    return points - _middle(points, mesh)[mesh.mesh_of_vertex]


def _axes(corners: Float[Tensor, "faces 3 3"]) -> Float[Tensor, "faces 3 3"]:
    """(tangent, tangent, normal) of faces in rows; 0 where a face has no area."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = torch.nn.functional.normalize(torch.linalg.cross(first, second), dim=-1, eps=1e-30)
    tangent = torch.nn.functional.normalize(first, dim=-1, eps=1e-30)
    return torch.stack([tangent, torch.linalg.cross(normal, tangent), normal], 1)
