"""Hessians of points of a surface as pieces on its vertices, edges and faces."""

from __future__ import annotations

from functools import partial

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.energy.term import Stencils, array
from drape.energy.terms.point_kernel import add_blocks
from drape.geometry.surface_points import ChosenPoints
from drape.linalg.stencil_sum import Filled


def point_stencils(
    points: ChosenPoints, blocks: Float[Tensor, "rows 3 3"], rows: Int[Tensor, " rows"]
) -> list[Stencils | Filled]:
    """Pieces ``w_pk w_pl B_p`` of some ``rows`` of the points; edges and faces have all a piece, always.

    So the places of the entries in a sparse matrix stay the same, whichever points are in contact.
    """
    surface, chosen = points.surface, points.points[rows]
    pieces: list[Stencils | Filled] = []
    ends = [kind.first for kind in surface.kinds[1:]] + [len(surface.vertices)]
    for kind, end in zip(surface.kinds, ends, strict=True):
        some = ((chosen >= kind.first) & (chosen < end)).nonzero()[:, 0]
        size, point, block = kind.carriers.shape[1], chosen[some], blocks[some]
        if size == 1:
            pieces.append(Stencils(point[:, None], block[:, None, :, None, :]))
            continue
        weights, carrier = surface.weights[point, :size].to(block), kind.carrier[point - kind.first]
        if block.device.type == "cpu":
            given = {"carrier": carrier.numpy(), "weights": array(weights), "blocks": array(block)}
            pieces.append(Filled(kind.carriers, partial(add_blocks, **given)))
            continue
        each = torch.einsum("pa,pb,pij->paibj", weights, weights, block)
        total = block.new_zeros(len(kind.carriers), size, 3, size, 3)
        pieces.append(Stencils(kind.carriers, total.index_add(0, carrier, each)))
    return pieces
