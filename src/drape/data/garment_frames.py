"""Frames of recorded garments drawn from a data set, several garments of different meshes in a batch."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.data.hdf5 import GarmentFile
from drape.data.windows import Window, mass_and_free
from drape.errors import DrapeError
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import attribute_vector


@dataclass(frozen=True, eq=False)
class GarmentFrames:
    """A window of several garments, and their bodies over the same step."""

    window: Window
    """Masses as recorded."""
    body_faces: Int[Tensor, "body_faces 3"]
    body: Float[Tensor, "body_vertices 3"]
    """Bodies at t [m]."""
    body_next: Float[Tensor, "body_vertices 3"]
    """Bodies at t+1 [m]."""
    mesh_of_face: Int[Tensor, " body_faces"]
    """The garment of the batch that the face is the body of."""


class SampledGarmentFrames:
    """An iterable over ``count`` windows of a split in batches: drawn without repetition, the same for the same seed.

    Args:
        file: the recorded garments.
        split: ``train`` or ``test``.
        count: windows to draw; all of them where there are fewer.
        batch_size: garments in a batch.
        attribute_scales: divisors of the five attributes of a fabric.
        seed: of the draw.

    Raises:
        DrapeError: no recorded garment of three frames in the split.
    """

    def __init__(
        self,
        file: GarmentFile,
        split: str,
        count: int,
        batch_size: int,
        attribute_scales: Mapping[str, float],
        seed: int,
    ):
        self.file = file
        self.batch_size = batch_size
        sequences = [file.sequence(name) for name in file.split(split)]
        self.sequences = [s for s in sequences if s.is_recorded and s.num_frames >= 3]
        if not self.sequences:
            raise DrapeError(
                f"{file.path}: split {split}: found no recorded garment of three frames or more; expected some to "
                "learn from; choose a data set that has them"
            )
        vectors = [attribute_vector(file.materials[name], attribute_scales) for name in file.fabrics]
        self._attributes = torch.tensor(vectors, dtype=torch.float64)
        counts = np.array([s.num_frames - 2 for s in self.sequences])
        owner = np.repeat(np.arange(len(counts)), counts)
        start = np.concatenate([np.arange(c) for c in counts])
        order = np.random.default_rng(seed).permutation(len(owner))[:count]
        self._drawn = np.stack([owner, start], 1)[order]

    def __len__(self) -> int:
        return -(-len(self._drawn) // self.batch_size)

    def __iter__(self) -> Iterator[GarmentFrames]:
        for first in range(0, len(self._drawn), self.batch_size):
            yield self._batch(self._drawn[first : first + self.batch_size])

    def _batch(self, drawn: Int[np.ndarray, "meshes 2"]) -> GarmentFrames:
        sequences = [self.sequences[owner] for owner, _ in drawn]
        windows = [self.sequences[owner].window(int(start), 3) for owner, start in drawn]
        mesh = MeshBatch.from_meshes([s.mesh for s in sequences])
        x_prev, x, x_next = (_joined([w.positions[k] for w in windows]) for k in range(3))
        fabric = torch.tensor([self.file.fabrics.index(s.fabric) for s in sequences])
        mass, free = zip(*(mass_and_free(s) for s in sequences), strict=True)
        window = Window(
            mesh=mesh,
            x_prev=x_prev,
            x=x,
            x_next=x_next,
            mass=torch.cat(mass),
            free=torch.cat(free),
            attributes=self._attributes[fabric],
            fabric=fabric,
            gravity=torch.from_numpy(self.file.gravity),
            dt=float(self.file.dt),
        )
        offsets = np.cumsum([0] + [w.body_positions.shape[1] for w in windows[:-1]])
        faces = [s.body_faces + offset for s, offset in zip(sequences, offsets, strict=True)]
        body, body_next = (_joined([w.body_positions[k] for w in windows]) for k in (1, 2))
        numbers = [np.full(len(f), number) for number, f in enumerate(faces)]
        return GarmentFrames(window, _joined(faces), body, body_next, _joined(numbers))


def _joined(arrays: list[np.ndarray]) -> Tensor:
    return torch.from_numpy(np.concatenate(arrays))
