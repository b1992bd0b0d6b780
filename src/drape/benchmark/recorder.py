"""At which frames the forces of a recording act, and how much of its damping is that of its solver."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from omegaconf import DictConfig
from tqdm import tqdm

from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.blender_clock import steps_run
from drape.data.datamodule import TrajectoryDataModule
from drape.data.trajectories import open_trajectories
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES

BATCH = 50


class Recorder:
    """Weights in time of springs and hinges, and those of backward Euler, for each file and fabric.

    The spring-hinge law is fitted to the recording; its springs at t-1, t and t+1 as shares of their sum are the
    weights. A solver that takes q steps a frame, each with the linearised force of springs at its end (as Baraff and
    Witkin, 1998, without the part that turns them), shows an axial damper of about ``k dt/q²`` that no fabric has. What
    needs q is NaN where a file does not say it.

    Args:
        paths: data files of trajectories.
        windows: of each fabric, that are fitted.

    Raises:
        DrapeError: no files.
    """

    def __init__(self, paths: Sequence[str], windows: int):
        if not paths:
            raise DrapeError("measure.paths: found none; expected data files that src/generate.py has made")
        self.paths, self.windows = list(paths), windows

    def measure(self, config: DictConfig) -> Measured:
        """One row for each file and fabric."""
        circumstances = Circumstances()
        paths = tqdm(self.paths, desc="fitting", unit=" files", file=sys.stderr)
        rows = [row for path in paths for row in self._of(path)]
        title = f"At which frames forces act, by a fit of {self.windows} windows of each fabric"
        return Measured("recorder", title, rows, circumstances.text())

    def _of(self, path: str) -> Iterator[Row]:
        fabrics = open_trajectories(path).fabrics
        for fabric in fabrics:
            data = TrajectoryDataModule(path, [fabric], 1, BATCH, dict.fromkeys(ATTRIBUTES, 1.0), seed=None)
            law = SpringHingeLaw.fit(data.windows_apart(self.windows, BATCH, ()), len(fabrics))
            number = fabrics.index(fabric)
            found = law.coefficients[number].tolist()
            (k, b), springs, hinges, (damper, drag) = law.stiffness[number].tolist(), found[:3], found[3:6], found[6:]
            quality: Any = data.file.materials[fabric].get("quality")
            steps = steps_run(int(quality)) if quality else math.nan
            yield {
                "file": path,
                "fabric": fabric,
                "steps": steps,
                "k_N_per_m": k,
                **{f"spring_{frame}": value / k for frame, value in zip(FRAMES, springs, strict=True)},
                "b_J": b,
                **{f"hinge_{frame}": value / b for frame, value in zip(FRAMES, hinges, strict=True)},
                **{f"euler_{frame}": value for frame, value in zip(FRAMES, backward_euler(steps), strict=True)},
                "damper_kg_per_s": damper,
                "of_steps_kg_per_s": k * float(data.file.dt) / steps**2,
                "drag_kg_per_s": drag,
            }


FRAMES = ("before", "now", "next")


def backward_euler(steps: int | float) -> tuple[float, float, float]:
    """Weights at t-1, t, t+1 of so many backward Euler steps a frame; see :class:`drape.energy.law.timing.Timing`."""
    before, after = ((steps - sign) * (steps - 2 * sign) / (6 * steps**2) for sign in (1, -1))
    return before, 1.0 - before - after, after
