"""Several cloth meshes as one big mesh: the topology tensors that every energy and loss works on."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy import sparse
from torch import Tensor

from drape.geometry.coarse_levels import CoarseLevels
from drape.geometry.corners import Corners
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.mesh import ClothMesh
from drape.geometry.patches import Patches
from drape.geometry.rest_shape import RestFaces, RestHinges

Kept = TypeVar("Kept")


@dataclass(frozen=True, eq=False)
class MeshBatch:
    """Meshes concatenated with vertex, face and edge offsets; ``mesh_of_*`` says whose a vertex or an edge is."""

    rest_positions: Float[Tensor, "vertices 3"]
    """Rest positions [m], float64."""
    faces: Int[Tensor, "faces 3"]
    edges: Int[Tensor, "edges 2"]
    edge_faces: Int[Tensor, "edges 2"]
    boundary: Bool[Tensor, " edges"]
    rest_lengths: Float[Tensor, " edges"]
    """Rest length of each edge [m]."""
    mesh_of_vertex: Int[Tensor, " vertices"]
    mesh_of_edge: Int[Tensor, " edges"]
    length_scale: Float[Tensor, ""]
    """Mean rest length of all edges [m]: what is small compared with it counts as degenerate."""
    num_meshes: int

    @classmethod
    def from_meshes(cls, meshes: Sequence[ClothMesh]) -> MeshBatch:
        """Concatenate ``meshes`` on the CPU, geometry in float64."""
        vertex_offset = np.cumsum([0] + [m.num_vertices for m in meshes])
        face_offset = np.cumsum([0] + [m.num_faces for m in meshes])

        def joined(arrays: list[np.ndarray]) -> Tensor:
            return torch.from_numpy(np.concatenate(arrays))

        rest_lengths = joined([m.rest_lengths for m in meshes])
        return cls(
            rest_positions=joined([m.rest_positions.astype(np.float64) for m in meshes]),
            faces=joined([m.faces + o for m, o in zip(meshes, vertex_offset, strict=False)]),
            edges=joined([m.edges + o for m, o in zip(meshes, vertex_offset, strict=False)]),
            edge_faces=joined([m.edge_faces + o for m, o in zip(meshes, face_offset, strict=False)]),
            boundary=joined([m.boundary for m in meshes]),
            rest_lengths=rest_lengths,
            mesh_of_vertex=joined([np.full(m.num_vertices, i) for i, m in enumerate(meshes)]),
            mesh_of_edge=joined([np.full(m.num_edges, i) for i, m in enumerate(meshes)]),
            length_scale=rest_lengths.mean(),
            num_meshes=len(meshes),
        )

    @property
    def num_vertices(self) -> int:
        return len(self.rest_positions)

    @property
    def num_edges(self) -> int:
        return len(self.edges)

    @cached_property
    def rest(self) -> EdgeGeometry:
        """Lengths and angles of the rest positions."""
        return EdgeGeometry(self.rest_positions, self)

    @cached_property
    def rest_faces(self) -> RestFaces:
        """Shapes of the faces at rest, float64."""
        return RestFaces.of(self.rest_positions, self.faces)

    @cached_property
    def rest_hinges(self) -> RestHinges:
        """Shapes of the interior edges at rest, float64."""
        interior = ~self.boundary
        return RestHinges.of(self.rest_positions, self.faces, self.edges[interior], self.edge_faces[interior])

    @cached_property
    def edge_corners(self) -> Corners:
        """The ends of the edges, for work component by component."""
        return Corners.of(self.edges)

    @cached_property
    def edges_at_vertex(self) -> Int[Tensor, " vertices"]:
        """Number of the edges of each vertex."""
        return self.edges.flatten().bincount(minlength=self.num_vertices)

    @cached_property
    def face_corners(self) -> Corners:
        """The corners of the faces, for work component by component."""
        return Corners.of(self.faces)

    @cached_property
    def rest_angles(self) -> Float[Tensor, "2 edges"]:
        """Twist α and bend β of the edges at rest [rad]."""
        return torch.stack([torch.atan2(pair[:, 1], pair[:, 0]) for pair in (self.rest.twist, self.rest.bend)])

    def pairs_within(self, hops: int) -> Int[Tensor, "2 pairs"]:
        """All ordered pairs of different vertices at most ``hops`` edges apart; computed once for each ``hops``."""
        return self.once(("pairs", hops), lambda: self._pairs_within(hops))

    def _pairs_within(self, hops: int) -> Int[Tensor, "2 pairs"]:
        ends = self.edges.cpu().numpy()
        shape = (self.num_vertices, self.num_vertices)
        step = sparse.coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape)
        step = (step + step.T + sparse.eye_array(self.num_vertices, dtype=bool)).tocsr()
        reach = step
        for _ in range(hops - 1):
            reach = reach @ step
        first, second = reach.nonzero()
        pairs = torch.from_numpy(np.stack([first, second])[:, first != second].astype(np.int64))
        return pairs.to(self.edges.device)

    def patches(self, size: float) -> Patches:
        """Patches of about ``size`` [m] along each side; computed once for each ``size``."""
        return self.once(("patches", size), lambda: self._made_patches(size))

    def _made_patches(self, size: float) -> Patches:
        tensors = (self.rest_positions, self.edges, self.mesh_of_vertex)
        rest, edges, owners = (tensor.cpu().numpy() for tensor in tensors)
        return Patches.of_batch(rest, edges, owners, size).to(self.edges.device)

    def coarse_levels(self, count: int) -> CoarseLevels:
        """HOOD's first ``count`` coarse levels of the edges; computed once for each ``count``."""
        return self.once(("coarse", count), lambda: CoarseLevels.of(self.edges, self.num_vertices, count))

    def to(self, device: torch.device | str) -> MeshBatch:
        """The same batch on another device; moved once, so that what it has computed there is computed once."""
        device = torch.device(device)
        return self if device == self.edges.device else self.once(device, lambda: self._moved(device))

    def _moved(self, device: torch.device) -> MeshBatch:
        tensors = {f.name: getattr(self, f.name) for f in fields(self)}
        moved: dict[str, Any] = {k: v.to(device) for k, v in tensors.items() if isinstance(v, Tensor)}
        return replace(self, **moved)

    def once(self, key: Hashable, make: Callable[[], Kept]) -> Kept:
        """The result of ``make``, made once for this batch and kept as long as it is."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    @cached_property
    def _kept(self) -> dict[Hashable, Any]:
        return {}

    def sum_edges(self, per_edge: Float[Tensor, "... edges"]) -> Float[Tensor, "... meshes"]:
        """Sum a quantity of the edges over each mesh, in float64."""
        per_edge = per_edge.double()
        total = per_edge.new_zeros(*per_edge.shape[:-1], self.num_meshes)
        return total.index_add(-1, self.mesh_of_edge, per_edge)

    def sum_vertices(self, per_vertex: Float[Tensor, " vertices"]) -> Float[Tensor, " meshes"]:
        """Sum a quantity of the vertices over each mesh, in float64."""
        per_vertex = per_vertex.double()
        if self.num_meshes == 1:
            return per_vertex.sum()[None]
        return per_vertex.new_zeros(self.num_meshes).index_add(-1, self.mesh_of_vertex, per_vertex)
