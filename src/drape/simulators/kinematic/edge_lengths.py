"""Cloth hardly stretches: positions moved so that edges come nearer to the lengths that they have at rest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from drape.compiled import compiled
from drape.geometry.edge_geometry import TINY
from drape.geometry.mesh_batch import MeshBatch

RADIUS = 0.97
"""Eigenvalues up to this one are damped alike; those beyond change more slowly."""


def nearer_to_rest(
    x: Float[Tensor, "vertices 3"], mesh: MeshBatch, free: Bool[Tensor, " vertices"], rounds: int
) -> Float[Tensor, "vertices 3"]:
    """``rounds`` of ``x_i += mean_j (1 - r_ij / |x_j - x_i|) (x_j - x_i)`` over the edges of each free vertex [m].

    Jacobi's iteration on ``Σ (|x_j - x_i| - r)²`` with the number of edges of each vertex for its diagonal, accelerated
    by Chebyshev's weights (Wang 2015, "A Chebyshev semi-iterative approach for accelerating projective and
    position-based dynamics"). By Gershgorin the linear part of Jacobi's has eigenvalues from -1 to 1, where Chebyshev's
    polynomials stay within -1 and 1, so it never grows. Sixteen rounds leave as much strain as 64 without the weights:
    about that of recorded garments. Differentiable.
    """
    share = (free / mesh.edges_at_vertex.clamp(min=1)).to(x)
    weights = [1.0]
    for k in range(rounds):
        weights.append(_next_weight(k, weights[-1]))
    form = _Compiled if x.device.type == "cpu" else _OnTensors
    return form.apply(x, mesh.edges, mesh.rest_lengths.to(x), share, weights[1:])


class _OnTensors(torch.autograd.Function):
    """On a device, with its derivative: half as many operations as differentiating each."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, edges: Tensor, rest: Tensor, share: Tensor, weights: list[float]) -> Tensor:
        first, second = edges.unbind(-1)
        ctx.given = (first, second, share[:, None], weights)
        ctx.rounds, before = [], x
        for weight in weights:
            arm = x.index_select(0, second) - x.index_select(0, first)
            inverse = (arm.square().sum(-1, keepdim=True) + TINY**2).rsqrt()
            relative = rest[:, None] * inverse
            change = torch.addcmul(arm, relative, arm, value=-1.0)
            moved = torch.zeros_like(x).index_add_(0, first, change).index_add_(0, second, change, alpha=-1.0)
            ctx.rounds.append((arm, inverse, relative))
            before, x = x, torch.lerp(before, torch.addcmul(x, share[:, None], moved), weight)
        return x.clone()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        first, second, share, weights = ctx.given
        of_after, of_x = gradient, torch.zeros_like(gradient)
        for weight, (arm, inverse, relative) in zip(reversed(weights), reversed(ctx.rounds), strict=True):
            of_before = (1.0 - weight) * of_after
            pull = share * of_after
            pull = pull.index_select(0, first) - pull.index_select(0, second)
            along = relative * inverse.square() * (pull * arm).sum(-1, keepdim=True)
            way = torch.addcmul(torch.addcmul(pull, relative, pull, value=-1.0), along, arm)
            of_x = torch.add(of_x, of_after, alpha=weight)
            of_x = of_x.index_add_(0, second, way, alpha=weight).index_add_(0, first, way, alpha=-weight)
            of_after, of_x = of_x, of_before
        return (of_after + of_x) if weights else gradient, None, None, None, None


class _Compiled(torch.autograd.Function):
    """The same on a CPU, in float64, and its derivative: a tenth of the time of hundreds of operations on tensors."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, edges: Tensor, rest: Tensor, share: Tensor, weights: list[float]) -> Tensor:
        given = (edges.numpy(), *(t.double().contiguous().numpy() for t in (rest, share)), np.array(weights))
        path = _relaxed(x.detach().double().contiguous().numpy(), *given)
        ctx.path, ctx.given = path, given
        return torch.from_numpy(path[-1].copy()).to(x.dtype)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        found = _pulled_back(gradient.double().contiguous().numpy(), ctx.path, *ctx.given)
        return torch.from_numpy(found).to(gradient.dtype), None, None, None, None


@compiled
def _relaxed(start, edges, rest, share, weights):
    """The positions before and after each round, ``(rounds + 1) vertices 3``."""
    path = np.empty((len(weights) + 1, *start.shape))
    path[0] = start
    moved = np.empty(start.shape)
    for k in range(len(weights)):
        before, x, after = path[max(k - 1, 0)], path[k], path[k + 1]
        moved[:] = 0.0
        for e in range(len(edges)):
            i, j = edges[e, 0], edges[e, 1]
            a, b, c = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            part = 1.0 - rest[e] / math.sqrt(a * a + b * b + c * c + TINY * TINY)
            for axis in range(3):
                way = part * (x[j, axis] - x[i, axis])
                moved[i, axis] += way
                moved[j, axis] -= way
        for i in range(len(x)):
            for axis in range(3):
                new = x[i, axis] + share[i] * moved[i, axis]
                after[i, axis] = before[i, axis] + weights[k] * (new - before[i, axis])
    return path


@compiled
def _pulled_back(gradient, path, edges, rest, share, weights):
    """The derivative by the start from that by the end: the rounds backwards."""
    of_after, of_x, of_before = gradient.copy(), np.zeros(gradient.shape), np.empty(gradient.shape)
    for k in range(len(weights) - 1, -1, -1):
        x, weight = path[k], weights[k]
        for i in range(len(x)):
            for axis in range(3):
                of_x[i, axis] += weight * of_after[i, axis]
                of_before[i, axis] = (1.0 - weight) * of_after[i, axis]
        for e in range(len(edges)):
            i, j = edges[e, 0], edges[e, 1]
            a, b, c = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            square = a * a + b * b + c * c + TINY * TINY
            relative = rest[e] / math.sqrt(square)
            u, v = weight * share[i], weight * share[j]
            p = u * of_after[i, 0] - v * of_after[j, 0]
            q = u * of_after[i, 1] - v * of_after[j, 1]
            r = u * of_after[i, 2] - v * of_after[j, 2]
            along = relative * (p * a + q * b + r * c) / square
            part = 1.0 - relative
            for axis, way in enumerate((part * p + along * a, part * q + along * b, part * r + along * c)):
                of_x[j, axis] += way
                of_x[i, axis] -= way
        if k == 0:
            of_x += of_before
        of_after, of_x, of_before = of_x, of_before, of_after
    return of_after


def _next_weight(k: int, weight: float) -> float:
    """Chebyshev's weight of round k from that of the one before."""
    if k < 2:
        return (1.0, 2.0 / (2.0 - RADIUS**2))[k]
    return 4.0 / (4.0 - RADIUS**2 * weight)
