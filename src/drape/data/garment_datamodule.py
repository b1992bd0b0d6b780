"""Rollouts of a data set of garments, for the training of simulators.

Apart from datamodule, as a sample is another one: bodies, and frames around t = 0 at the middle of each garment, where
an energy needs three frames of cloth alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import lightning
import numpy as np

from drape.data.garment_rollout import GarmentRollout, SingleRollout
from drape.data.loader import WindowLoader, share_of
from drape.data.recorded_scene import START
from drape.data.sequence_loader import SequenceLoader
from drape.data.trajectories import open_dressed
from drape.errors import DrapeError
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.mass import vertex_areas
from drape.scene.material import Material

STARTS = ("recorded", "carried")
SAMPLES = 256
"""Windows that the statistics look at, evenly spaced over the training split."""


class GarmentDataModule(lightning.LightningDataModule):
    """Rollouts of ``length`` steps from the sequences of an HDF5 file; only the current batch is ever in memory.

    Args:
        path: file written by ``generate.py data=garments`` or one of the converters.
        fabrics: names of the fabrics to use.
        start: where a rollout begins, and which targets it has: on the ``recorded`` garment, or on the garment as the
            body has ``carried`` it there by its skinning weights, with which no simulation is needed.
        length: steps of a rollout.
        batch_size: garments in a training batch.
        seed: of the order of the training rollouts.
        validation_sequences: sequences of the test split, evenly over its kinds, that are watched while training. They
            are watched only: the result of a training is its last step, never the best on them.

    Raises:
        DrapeError: file missing or faulty, a split without sequences of these fabrics, sequences that are too short,
            garments without what ``start`` needs.
    """

    def __init__(
        self,
        path: str,
        fabrics: Sequence[str],
        start: str,
        length: int,
        batch_size: int,
        seed: int | None,
        validation_sequences: int = 4,
    ):
        super().__init__()
        if start not in STARTS:
            raise DrapeError(f"datamodule.start: found {start!r}; expected {' or '.join(STARTS)}")
        self.file = open_dressed(path)
        self.fabrics, self.start, self.length = tuple(fabrics), start, length
        self.batch_size, self.seed = batch_size, seed
        self.file.check_fabrics(self.fabrics)
        self._sequence = lru_cache(maxsize=None)(self.file.sequence)
        self._batch = lru_cache(maxsize=128)(self._joined_meshes)
        self.train_sequences = self._usable("train")
        self._check(self.train_sequences, start)
        test = self._usable("test")
        self._check(test, "recorded")
        spaced = np.linspace(0, len(test) - 1, min(validation_sequences, len(test))).round().astype(int)
        self.validation_sequences = [test[k] for k in spaced]
        counts = [self._sequence(name).num_frames - length - 1 for name in self.train_sequences]
        short = [name for name, count in zip(self.train_sequences, counts, strict=True) if count < 1]
        if short:
            raise DrapeError(
                f"{path}: sequences/{short[0]}: has {self._sequence(short[0]).num_frames} frames; expected at least "
                f"{length + 2}, for two to start from and {length} steps; choose shorter rollouts"
            )
        self._first = np.cumsum([0, *counts])

    def _usable(self, split: str) -> list[str]:
        return [self.file.names[number] for number in self.file.numbers(split, self.fabrics)]

    def _check(self, names: Sequence[str], start: str) -> None:
        for name in names:
            sequence = self._sequence(name)
            if not (sequence.is_recorded if start == "recorded" else sequence.is_carried):
                missing = "recorded positions" if start == "recorded" else "skinning weights and transforms"
                raise DrapeError(
                    f"{self.file.path}: sequences/{name}: has no {missing} of the garment; expected some to start "
                    "from; choose another datamodule.start or another data set"
                )

    @property
    def materials(self) -> dict[str, Material]:
        """The fabrics in use, by name."""
        return {name: Material.from_settings(name, self.file.materials[name]) for name in self.fabrics}

    def statistics(self) -> dict[str, float]:
        """Root mean squares and means over evenly spaced windows of the training split, that networks are scaled by.

        ``vertex_speed`` [m/s] and ``vertex_acceleration`` [m/s²] of the vertices, ``edge_length`` [m] and
        ``vertex_area`` [m²] at rest, ``vertex_mass`` [kg].
        """
        chosen = np.unique(np.linspace(0, self._first[-1] - 1, SAMPLES).astype(np.int64))
        sums = np.zeros(2)
        for index in chosen:
            x, dt = self._single(int(index), 1).x, self.file.dt
            sums += [
                ((x[1] - x[0]) ** 2).sum(-1).mean() / dt**2,
                ((x[2] - 2 * x[1] + x[0]) ** 2).sum(-1).mean() / dt**4,
            ]
        meshes = [self._sequence(name).mesh for name in self.train_sequences]
        return {
            "vertex_speed": math.sqrt(sums[0] / len(chosen)),
            "vertex_acceleration": math.sqrt(sums[1] / len(chosen)),
            "edge_length": float(np.mean([mesh.rest_lengths.mean() for mesh in meshes])),
            "vertex_area": float(np.mean([vertex_areas(mesh).mean() for mesh in meshes])),
            "vertex_mass": float(np.mean([self._sequence(n).mass_per_vertex for n in self.train_sequences])),
        }

    def rollout(self, indices: np.ndarray) -> GarmentRollout:
        """The rollouts of the given numbers, counted through the training sequences, as one batch."""
        parts = [self._single(int(index), self.length) for index in indices]
        mesh = self._batch(tuple(part.sequence for part in parts))
        return GarmentRollout.joined(parts, mesh, self.file.gravity, self.file.dt)

    def _single(self, index: int, length: int) -> SingleRollout:
        which = int(np.searchsorted(self._first, index, side="right")) - 1
        sequence, first = self._sequence(self.train_sequences[which]), index - int(self._first[which])
        window = sequence.window(first, length + 2)
        x = window.positions if self.start == "recorded" else sequence.carried(first, length + 2)
        body, faces = window.body_positions, sequence.body_faces
        if x is None or body is None:
            raise DrapeError(f"{self.file.path}: sequences/{sequence.name}: expected a garment on a body; found less")
        free = np.ones(x.shape[1], dtype=bool)
        free[sequence.pinned] = False
        return SingleRollout(x, body, faces, free, sequence.fabric, sequence.name, first + START)

    def _joined_meshes(self, names: tuple[str, ...]) -> MeshBatch:
        return MeshBatch.from_meshes([self._sequence(name).mesh for name in names])

    def train_dataloader(self) -> WindowLoader:
        share, count = share_of(self.trainer), int(self._first[-1])
        return WindowLoader(self.rollout, count, self.batch_size, seed=self.seed, groups=self._groups(), **share)

    def _groups(self) -> list[list[np.ndarray]]:
        """The sequences of each batch, for a whole training: what their meshes have computed is computed once.

        Drawn by the seed; where sequences are left over, their group is filled with others.
        """
        count = len(self.train_sequences)
        order = np.random.default_rng(self.seed).permutation(count)
        groups = np.resize(order, (-(-count // self.batch_size), self.batch_size))
        return [[np.arange(*self._first[which : which + 2]) for which in group] for group in groups]

    def val_dataloader(self) -> SequenceLoader:
        """Whole sequences, to animate."""
        return SequenceLoader([self._sequence(name) for name in self.validation_sequences], self.trainer)
