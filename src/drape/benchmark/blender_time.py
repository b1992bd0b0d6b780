"""Time that Blender's own cloth takes for a frame of recorded garments."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import yaml
from omegaconf import DictConfig
from tqdm import tqdm

from drape.benchmark.measured import Circumstances, Measured, Row
from drape.blender.cloth_on_body import ClothOnBody
from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import recorded_scene
from drape.data.sequence import GarmentSequence
from drape.errors import DrapeError
from drape.scene.state import State


class BlenderTime:
    """Blender simulates test sequences once more, with the settings that they were made with, and is timed.

    They start at rest from the first frame of an evaluation, as Blender's cloth cannot start in motion; what a frame
    costs hardly depends on that. How far off two simulations by Blender are of each other: ``evaluate.py
    simulator=twin``.

    Args:
        paths: of the garments.
        sequences: of the test split of each, the first so many.
        frames: of each sequence.

    Raises:
        DrapeError: no file, no sequence or no frame.
    """

    def __init__(self, paths: Sequence[str], sequences: int, frames: int):
        if not paths or sequences < 1 or frames < 1:
            raise DrapeError(
                f"measure: found {len(paths)} paths, {sequences} sequences and {frames} frames; expected one or more "
                "of each"
            )
        self.paths, self.sequences, self.frames = list(paths), sequences, frames

    def measure(self, config: DictConfig) -> Measured:
        """One row for each sequence.

        Raises:
            DrapeError: Blender is missing, or data that it did not make.
        """
        circumstances, files = Circumstances(), [GarmentFile(path) for path in self.paths]
        chosen = [(sequence, _contact(file)) for file in files for sequence in self._chosen(file)]
        bar = tqdm(chosen, desc="simulating", unit=" sequences", file=sys.stderr)
        rows = [self._row(sequence, contact) for sequence, contact in bar]
        title = f"Blender's cloth, {self.frames} frames of each of {len(rows)} sequences: median time per frame"
        return Measured("blender_time", title, rows, circumstances.text())

    def _chosen(self, file: GarmentFile) -> list[GarmentSequence]:
        return [file.sequence(name) for name in file.split("test")[: self.sequences]]

    def _row(self, sequence: GarmentSequence, contact: Mapping[str, float]) -> Row:
        file, scene = sequence.file, recorded_scene(sequence, self.frames)
        steps = int(sequence.quality["solver_steps"])
        still = replace(scene, initial=State(scene.initial.x, np.zeros_like(scene.initial.x)))
        settings = {name: value for name, value in file.materials[sequence.fabric].items() if name != "mass_per_vertex"}
        blender = ClothOnBody(settings | {"quality": steps}, contact)
        try:
            blender(still)
        finally:
            blender.close()
        return {
            "file": str(file.path),
            "sequence": sequence.name,
            "garment": sequence.kind,
            "fabric": sequence.fabric,
            "vertices": scene.mesh.num_vertices,
            "steps_per_frame": steps,
            "ms_per_frame": 1e3 * statistics.median(blender.seconds),
        }


def _contact(file: GarmentFile) -> dict[str, float]:
    """Settings of Blender's contact that the garments were made with."""
    made = yaml.safe_load(file.attribute("config")) or {}
    contact = made.get("data", {}).get("contact")
    if contact is None or not file.made_by_blender:
        raise DrapeError(
            f"{file.path}: found no garments that Blender has simulated; expected those of src/generate.py "
            "data=garments"
        )
    return contact
