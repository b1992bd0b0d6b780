"""Windows of a data set of trajectories for training and test."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache, lru_cache, partial
from pathlib import Path

import lightning
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.data.loader import WindowLoader, share_of
from drape.data.observation import AS_RECORDED, Observation
from drape.data.statistics import training_statistics
from drape.data.trajectories import open_trajectories
from drape.data.windows import Window, mass_and_free
from drape.errors import DrapeError
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import attribute_vector


class TrajectoryDataModule(lightning.LightningDataModule):
    """Triplets of consecutive frames from an HDF5 file; nothing but the current batch is ever in memory.

    Args:
        path: file written by ``generate.py``.
        fabrics: names of the fabrics to use.
        batch_size: windows in a training batch.
        eval_batch_size: windows in a batch of validation and test.
        attribute_scales: divisors of the five attributes of a fabric.
        seed: of the order of the training windows; None for the order of the file, the same in every epoch.
        train_sequences: use only the first so many training sequences; all by default.
        validation_sequences: number of test sequences, evenly over the fabrics, that are watched while training. They
            are watched only: the result of a training is its last step, never the best on them.
        observation: how the recording is seen; the test split is without noise.

    Raises:
        DrapeError: file missing or faulty, a fabric that it does not have, a split without sequences or windows.
    """

    def __init__(
        self,
        path: str,
        fabrics: Sequence[str],
        batch_size: int,
        eval_batch_size: int,
        attribute_scales: Mapping[str, float],
        seed: int | None,
        train_sequences: int | None = None,
        validation_sequences: int = 16,
        observation: Observation = AS_RECORDED,
    ):
        super().__init__()
        self.file = open_trajectories(Path(path))
        self.fabrics = tuple(fabrics)
        self.batch_size = batch_size
        self.eval_batch_size = eval_batch_size
        self.seed = seed
        self.file.check_fabrics(self.fabrics)
        frames = np.array([sequence.num_frames for sequence in self.file.sequences])
        self.observation = observation
        self._windows_of = frames - 2 * observation.stride
        if self._windows_of.min() < 1:
            raise DrapeError(
                f"{path}: {frames.min()} frames in a sequence; a window needs {2 * observation.stride + 1}"
            )
        self._fabric = np.array([self.file.fabrics.index(sequence.fabric) for sequence in self.file.sequences])
        self.train_sequences = self._sequences("train")[:train_sequences]
        self.test_sequences = self._sequences("test")
        self.validation_sequences = self.test_sequences[:validation_sequences]
        materials = self.file.materials
        vectors = [attribute_vector(materials[name], attribute_scales) for name in self.file.fabrics]
        self._attributes = torch.tensor(vectors, dtype=torch.float64)
        self._is_training = np.isin(np.arange(len(frames)), self._sequences("train"))
        self._mass_and_free = cache(lambda number: mass_and_free(self.file.sequences[number]))
        self._mesh_batch = lru_cache(maxsize=16)(lambda *meshes: MeshBatch.from_meshes(meshes))

    def _sequences(self, split: str) -> np.ndarray:
        return np.array(self.file.numbers(split, self.fabrics))

    def attributes_of(self, fabric: str) -> Float[Tensor, " attributes"]:
        """The vector **a** of one fabric of the file, as the networks see it (float64)."""
        return self._attributes[self.file.fabrics.index(fabric)]

    @property
    def face_area(self) -> float:
        """Mean area of the faces of the meshes of the training split [m²]."""
        meshes = dict.fromkeys(self.file.sequences[number].mesh for number in self.train_sequences)
        return float(MeshBatch.from_meshes(list(meshes)).rest_faces.area.mean())

    def statistics(self) -> dict[str, float]:
        """See :func:`training_statistics`."""
        return training_statistics(self)

    def windows(self, sequences: np.ndarray, indices: np.ndarray) -> Window:
        """The windows of the given numbers, counted through ``sequences``, as one batch."""
        ends = np.cumsum(self._windows_of[sequences])
        which = np.searchsorted(ends, indices, side="right")
        numbers, starts = sequences[which], indices - np.concatenate([[0], ends])[which]
        x_prev, x, x_next = torch.from_numpy(self._observed(numbers, starts))
        fabric = torch.from_numpy(self._fabric[numbers])
        mass, free = zip(*(self._mass_and_free(int(number)) for number in numbers), strict=True)
        return Window(
            mesh=self._mesh_batch(*(self.file.sequences[number].mesh for number in numbers)),
            x_prev=x_prev,
            x=x,
            x_next=x_next,
            mass=torch.cat(mass),
            free=torch.cat(free),
            attributes=self._attributes[fabric],
            fabric=fabric,
            gravity=torch.from_numpy(self.file.gravity),
            dt=self.observation.stride * float(self.file.dt),
        )

    def _observed(
        self, sequences: Int[np.ndarray, " windows"], starts: Int[np.ndarray, " windows"]
    ) -> Float[np.ndarray, "3 vertices 3"]:
        """Positions [m] at t-1, t and t+1; those of the training split as the observation has them."""
        frames = starts + self.observation.stride * np.arange(3)[:, None]
        x = self.file.windows(sequences, frames).astype(np.float64)
        if self.observation.noise == 0:
            return x
        counts = [self.file.sequences[number].mesh.num_vertices for number in sequences]
        return x + np.stack([
            np.concatenate([
                self._is_training[number] * self.observation.disturbance(int(number), int(frame), count)
                for number, frame, count in zip(sequences, row, counts, strict=True)
            ])
            for row in frames
        ])  # fmt: skip

    def spaced_windows(self, count: int, batch_size: int) -> Iterator[Window]:
        """At most ``count`` windows of the training split, evenly spaced, in batches of about ``batch_size``."""
        for window, *_ in self.windows_apart(count, batch_size, ()):
            yield window

    def windows_apart(self, count: int, batch_size: int, apart: Sequence[int]) -> Iterator[tuple[Window, ...]]:
        """As :meth:`spaced_windows`; each with those of the same sequences so many frames earlier and later.

        Raises:
            DrapeError: sequences too short for that.
        """
        shifts = [0, *(by * sign for by in apart for sign in (-1, 1))]
        room = self._windows_of[self.train_sequences]
        if room.max() <= 2 * max(shifts):
            raise DrapeError(
                f"{self.file.path}: found {room.max() + 2 * self.observation.stride} frames a sequence; windows with "
                f"others {max(shifts)} frames before and after need {2 * (max(shifts) + self.observation.stride) + 1}"
            )
        first = np.cumsum(room) - room
        every = [begin + np.arange(max(shifts), own - max(shifts)) for begin, own in zip(first, room, strict=True)]
        for indices in _spaced(np.concatenate(every), count, batch_size):
            yield tuple(self.windows(self.train_sequences, indices + shift) for shift in shifts)

    def test_windows(self, count: int, batch_size: int) -> Iterator[Window]:
        """At most ``count`` windows of the test split, evenly spaced, in batches of about ``batch_size``."""
        for indices in _spaced(np.arange(self._windows_of[self.test_sequences].sum()), count, batch_size):
            yield self.windows(self.test_sequences, indices)

    def loader(
        self, sequences: np.ndarray, batch_size: int, *, seed: int | None = None, rank: int = 0, world_size: int = 1
    ) -> WindowLoader[Window]:
        """All windows of ``sequences`` in batches; the rest as in :class:`WindowLoader`."""
        count = int(self._windows_of[sequences].sum())
        build = partial(self.windows, sequences)
        return WindowLoader(build, count, batch_size, seed=seed, rank=rank, world_size=world_size)

    def train_dataloader(self) -> WindowLoader:
        return self.loader(self.train_sequences, self.batch_size, seed=self.seed, **share_of(self.trainer))

    def val_dataloader(self) -> WindowLoader:
        return self.loader(self.validation_sequences, self.eval_batch_size, **share_of(self.trainer))

    def test_dataloader(self) -> WindowLoader:
        return self.loader(self.test_sequences, self.eval_batch_size, **share_of(self.trainer))


def _spaced(indices: np.ndarray, count: int, batch_size: int) -> list[np.ndarray]:
    chosen = indices[np.unique(np.linspace(0, len(indices) - 1, min(count, len(indices))).astype(np.int64))]
    return np.array_split(chosen, -(-len(chosen) // batch_size))
