"""The deformation features that an energy unit receives of its edge."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.geometry.edge_geometry import EdgeGeometry


class Deformation(nn.Module, ABC):
    """Features of an edge that do not change when the cloth is moved or rotated; ``size`` of them."""

    size: int

    def __init__(self):  # without arguments, which nn.Module does not say
        super().__init__()

    @abstractmethod
    def forward(self, geometry: EdgeGeometry) -> Float[Tensor, "... edges size"]:
        """The features, Δl in metres first."""


class Stretch(Deformation):
    """Δl alone: an energy of these features has no gradient from bending (the paper's ablation, appendix)."""

    size = 1

    def forward(self, geometry: EdgeGeometry) -> Float[Tensor, "... edges 1"]:
        return geometry.stretch[..., None]


class StretchHinge(Deformation):
    """(Δl, Δθ): the changes of length [m] and of the dihedral angle between the two faces of the edge [rad].

    A hinge couples four vertices, and feels a zigzag of single edges, which vertex normals do not. Δθ is 0 on
    boundaries.
    """

    size = 2

    def forward(self, geometry: EdgeGeometry) -> Float[Tensor, "... edges 2"]:
        return torch.stack([geometry.stretch, geometry.hinge_change], -2).mT


class StretchBending(Deformation):
    """(Δl, cos Δα, sin Δα, cos Δβ, sin Δβ) with Δl = l - l_rest [m] (paper, eq. 2)."""

    size = 5

    def forward(self, geometry: EdgeGeometry) -> Float[Tensor, "... edges 5"]:
        return torch.cat([geometry.stretch[..., None, :], geometry.turned.mT], -2).mT
