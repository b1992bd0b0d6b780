"""Animate recorded garments and compare: sequence after sequence, each kept as it is done."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from tqdm import tqdm

from drape.data.animation_hdf5 import AnimationFile, AnimationHeader
from drape.data.animation_writer import AnimationWriter
from drape.data.recorded_scene import START, recorded_scene
from drape.data.sequence import GarmentSequence
from drape.evaluation.method import Method
from drape.evaluation.scored_sequence import ScoredSequence, read_by_frame, write_rows
from drape.metrics.garment_scores import AnimatedGarment, frame_scores
from drape.scene.scene import Scene
from drape.simulators.rollout import COLUMNS, frames
from drape.simulators.simulator import Outcome

SEQUENCES = "sequences"
"""Folder of the animations."""


def evaluate(method: Method, chosen: dict[str, int], folder: Path) -> list[ScoredSequence]:
    """Animate the sequences (name -> frames) and score them; those that are done in ``folder`` are not done again.

    Each has its frames in ``sequences/<name>.h5`` and its scores in ``sequences/<name>.csv``; an interrupted one goes
    on where it stopped.

    Raises:
        DrapeError: the energies do not know a fabric, or the folder holds sequences of another configuration.
    """
    method.prepare([method.file.sequence(name) for name in chosen])
    scored: list[ScoredSequence] = []
    with tqdm(total=len(chosen), desc="evaluating", unit=" sequences", file=sys.stderr) as bar:
        for name, count in chosen.items():
            sequence = method.file.sequence(name)
            scene = recorded_scene(sequence, count, method.areal_density)
            path = folder / SEQUENCES / f"{name}.h5"
            _animate(method, sequence, scene, path, bar)
            scored.append(_score(sequence, scene, path))
            bar.update()
    return scored


def _animate(method: Method, sequence: GarmentSequence, scene: Scene, path: Path, bar: tqdm) -> None:
    header = AnimationHeader.of_scene(scene, COLUMNS, OmegaConf.to_yaml(method.settings(sequence)))
    with AnimationWriter(path, header) as writer:
        if writer.num_frames == header.frames:
            return
        path.with_suffix(".csv").unlink(missing_ok=True)
        seconds = []
        for took in frames(method.simulator(sequence, scene), scene, writer):
            seconds.append(took)
            shown = f"{scene.name}: frame {writer.num_frames - 1} of {scene.frames}, {1e3 * np.median(seconds):.0f} ms"
            bar.set_postfix_str(f"{shown}/frame", refresh=False)
            bar.update(0)  # draws at most ten times a second


def _score(sequence: GarmentSequence, scene: Scene, path: Path) -> ScoredSequence:
    kept = path.with_suffix(".csv")
    with AnimationFile(path) as file:
        numbers, x = file.numbers(), file.trajectory().x
    by_frame = read_by_frame(kept, scene.frames)
    if by_frame is None:
        twin = None if sequence.twin is None else sequence.twin[START:]
        by_frame = frame_scores(AnimatedGarment(x, scene, twin))
    scored = ScoredSequence(
        name=sequence.name,
        kind=sequence.kind,
        fabric=sequence.fabric,
        motion=sequence.motion,
        num_vertices=scene.mesh.num_vertices,
        by_frame=by_frame,
        ms_per_frame=1e3 * float(np.median(numbers["seconds"][1:])),
        converged_percent=100 * float(np.mean(numbers["outcome"][1:] == list(Outcome).index(Outcome.CONVERGED))),
    )
    write_rows(kept, list(scored.frame_rows()))
    return scored
