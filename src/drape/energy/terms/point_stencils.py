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
    """Pieces ``w_pk w_pl B_p`` of some ``rows`` of the points; vertices, edges and faces have all a piece, always.

    So the places of the entries in a sparse matrix stay the same, whichever points are in contact.
    """
    surface, chosen = points.surface, points.points[rows]
    pieces: list[Stencils | Filled] = []
    for kind in surface.kinds:
        size = kind.carriers.shape[1]
        if blocks.device.type == "cpu":
            rows_of_kind = chosen.numpy(), kind.first, kind.carrier.numpy()
            add = partial(add_blocks, size, *rows_of_kind, array(surface.weights), array(blocks))
            pieces.append(Filled(kind.carriers, add))
            continue
        some = ((chosen >= kind.first) & (chosen < kind.first + len(kind.carrier))).nonzero()[:, 0]
        point, block = chosen[some], blocks[some]
        weights, carrier = surface.weights[point, :size].to(block), kind.carrier[point - kind.first]
        each = torch.einsum("pa,pb,pij->paibj", weights, weights, block)
        total = block.new_zeros(len(kind.carriers), size, 3, size, 3)
        pieces.append(Stencils(kind.carriers, total.index_add(0, carrier, each)))
    return pieces
