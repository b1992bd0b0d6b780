"""A training sample of a simulator: consecutive frames of garments on their bodies, several as one big mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from drape.geometry.mesh_batch import MeshBatch


@dataclass(frozen=True, eq=False)
class GarmentRollout:
    """Frames t-1, t, ..., t+length of ``meshes`` garments; each relative to the middle of its garment at t, float64."""

    mesh: MeshBatch
    x: Float[Tensor, "frames vertices 3"]
    """The garments [m]: recorded, or as the bodies carry them."""
    body: Float[Tensor, "frames body_vertices 3"]
    """The bodies [m]."""
    body_faces: Int[Tensor, "body_faces 3"]
    mesh_of_face: Int[Tensor, " body_faces"]
    """Whose body a face belongs to."""
    free: Bool[Tensor, " vertices"]
    """False where a vertex is led along ``x``."""
    gravity: Float[Tensor, "3"]
    """[m/s²]"""
    dt: float
    """Time step [s]."""
    fabrics: tuple[str, ...]
    """Of each garment, as recorded."""
    names: tuple[str, ...]
    """Names of the samples, for messages."""

    @property
    def length(self) -> int:
        """Steps that can be taken from t on."""
        return len(self.x) - 2

    def from_rest(self) -> GarmentRollout:
        """The same, with a first step in which nothing moves; the last frame falls off."""
        x, body = (torch.cat([each[:2], each[1:-1]]) for each in (self.x, self.body))
        return replace(self, x=x, body=body)

    def to(self, device: torch.device | str, **_: object) -> GarmentRollout:
        """The same rollout on another device."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        moved: dict[str, Any] = {k: v.to(device) for k, v in values.items() if isinstance(v, Tensor | MeshBatch)}
        return replace(self, **moved)

    @classmethod
    def joined(cls, parts: Sequence[SingleRollout], mesh: MeshBatch, gravity: np.ndarray, dt: float) -> GarmentRollout:
        """Several garments as one; ``mesh`` are theirs."""
        offsets = np.cumsum([0] + [part.body.shape[1] for part in parts])
        middles = [part.x[1].mean(axis=0) for part in parts]
        return cls(
            mesh=mesh,
            x=_tensor([part.x - middle for part, middle in zip(parts, middles, strict=True)], axis=1),
            body=_tensor([part.body - middle for part, middle in zip(parts, middles, strict=True)], axis=1),
            body_faces=_tensor([part.body_faces + offsets[k] for k, part in enumerate(parts)]),
            mesh_of_face=_tensor([np.full(len(part.body_faces), k) for k, part in enumerate(parts)]),
            free=_tensor([part.free for part in parts]),
            gravity=torch.tensor(gravity),
            dt=float(dt),
            fabrics=tuple(part.fabric for part in parts),
            names=tuple(f"{part.sequence} frame {part.frame}" for part in parts),
        )


@dataclass(frozen=True, eq=False)
class SingleRollout:
    """As :class:`GarmentRollout`, one garment, where it is in the world; as read from a file."""

    x: Float[np.ndarray, "frames vertices 3"]
    body: Float[np.ndarray, "frames body_vertices 3"]
    body_faces: Int[np.ndarray, "body_faces 3"]
    free: Bool[np.ndarray, " vertices"]
    fabric: str
    sequence: str
    """Its name."""
    frame: int
    """The frame t of the sequence."""


def _tensor(arrays: list[np.ndarray], axis: int = 0) -> Tensor:
    return torch.from_numpy(np.concatenate(arrays, axis=axis))
