"""Gauss-Newton Hessian of a barrier between triangles: one gradient of a distance for each pair of primitives."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter

import ipctk
import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from drape.contact.barrier import push_slope

Block = tuple[Int[np.ndarray, "pairs ends"], Float[np.ndarray, "pairs ends"], Float[np.ndarray, " pairs"]]


def gauss_newton(
    near: ipctk.NormalCollisions,
    mesh: ipctk.CollisionMesh,
    points: Float[np.ndarray, "points 3"],
    free: int,
    reach: float,
    stiffness: float,
) -> sparse.csr_array:
    """``Σ E''(d) ∇d ∇dᵀ`` [N/m] in the coordinates of the first ``free`` points; all of it, positive semi-definite.

    What is left out, ``E'(d) ∇²d``, is mostly negative, and a projection would drop that too. In a fold it costs less
    than half of ipctk's projected Hessian, whose time goes into eigenvalues.
    """
    values, columns, lengths = [], [], []
    for ids, shares, weight in _blocks(near, mesh, points):
        arm = np.einsum("pk,pki->pi", shares, points[ids])
        distance = np.linalg.norm(arm, axis=1)
        root = np.sqrt(weight * -push_slope(np.minimum(distance / reach, 1.0)) * stiffness / reach)
        rows = shares[:, :, None] * (arm * (root / distance)[:, None])[:, None]
        used = ids < free
        values.append(rows[used].ravel())
        columns.append((3 * ids[used][:, None] + np.arange(3)).ravel())
        lengths.append(3 * used.sum(axis=1))
    if not values:
        return sparse.csr_array((3 * free, 3 * free))
    starts = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
    shape = (len(starts) - 1, 3 * free)
    jacobian = sparse.csr_array((np.concatenate(values), np.concatenate(columns), starts), shape=shape)
    return (jacobian.T.tocsr() @ jacobian).tocsr()


def _blocks(
    near: ipctk.NormalCollisions, mesh: ipctk.CollisionMesh, x: Float[np.ndarray, "points 3"]
) -> Iterator[Block]:
    """Points of the pairs of a kind, their shares c in ``d = |Σ c x|``, and the weight [m²] with the mollifier."""
    edges, faces = mesh.edges, mesh.faces
    if pairs := near.vv_collisions:
        first, second, weight = _columns(pairs, "vertex0_id", "vertex1_id", "weight")
        yield np.stack([first, second], 1), np.tile([1.0, -1.0], (len(first), 1)), weight
    if pairs := near.ev_collisions:
        edge, vertex, weight = _columns(pairs, "edge_id", "vertex_id", "weight")
        ids = np.column_stack([vertex, edges[edge]])
        p, a, b = np.moveaxis(x[ids], 1, 0)
        u = _dot(p - a, b - a) / _dot(b - a, b - a)
        yield ids, np.stack([np.ones(len(u)), u - 1.0, -u], 1), weight
    if pairs := near.fv_collisions:
        face, vertex, weight = _columns(pairs, "face_id", "vertex_id", "weight")
        ids = np.column_stack([vertex, faces[face]])
        p, a, b, c = np.moveaxis(x[ids], 1, 0)
        normal = np.cross(b - a, c - a)
        double = _dot(normal, normal)
        v, w = _dot(np.cross(p - a, c - a), normal) / double, _dot(np.cross(b - a, p - a), normal) / double
        yield ids, np.stack([np.ones(len(v)), v + w - 1.0, -v, -w], 1), weight
    if pairs := near.ee_collisions:
        first, second, weight, threshold = _columns(pairs, "edge0_id", "edge1_id", "weight", "eps_x")
        ids = np.column_stack([edges[first], edges[second]])
        s, t, across = _closest_on_segments(*np.moveaxis(x[ids], 1, 0))
        c = np.minimum(across / threshold, 1.0)
        yield ids, np.stack([1.0 - s, s, t - 1.0, -t], 1), weight * c * (2.0 - c)


def _columns(pairs: list, *names: str) -> list[np.ndarray]:
    table = np.array(list(map(attrgetter(*names), pairs))).T
    named = zip(names, table, strict=True)
    return [values.astype(np.int64) if name.endswith("_id") else values for name, values in named]


def _dot(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, " pairs"]:
    return np.einsum("pi,pi->p", a, b)


def _closest_on_segments(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> tuple[Float[np.ndarray, " pairs"], Float[np.ndarray, " pairs"], Float[np.ndarray, " pairs"]]:
    """Nearest points of segments ab and cd, as shares of each, and ``|e₁ × e₂|²`` [m⁴] (Ericson 2005, 5.1.9)."""
    first, second, gap = b - a, d - c, a - c
    aa, ee, ab = _dot(first, first), _dot(second, second), _dot(first, second)
    f, g = _dot(first, gap), _dot(second, gap)
    across = aa * ee - ab**2
    s = np.clip(np.divide(ab * g - f * ee, across, out=np.full(len(aa), 0.5), where=across > 1e-14 * aa * ee), 0.0, 1.0)
    t = np.clip((ab * s + g) / ee, 0.0, 1.0)
    return np.clip((ab * t - f) / aa, 0.0, 1.0), t, np.maximum(across, 0.0)
