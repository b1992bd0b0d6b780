"""At which frames the forces of a recording act, and how much of its damping is that of its solver."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from omegaconf import DictConfig
from tqdm import tqdm

from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.blender_clock import steps_run
from drape.data.datamodule import TrajectoryDataModule
from drape.data.hdf5 import TrajectoryFile
from drape.energy.spring_hinge import COEFFICIENTS, SpringHingeLaw
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES

BATCH = 50


class Recorder:
    """Weights in time of springs and hinges, beside those of backward Euler, for each file and fabric.

    The spring-hinge law is fitted to the recording; its springs at t-1, t and t+1 as shares of their sum are the
    weights. A solver that takes q steps a frame, each with the linearised force of springs at its end (as Baraff and
    Witkin, 1998, without the part that turns them), shows an axial damper of about ``k dt/q²`` that no fabric has.

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
        fabrics = TrajectoryFile(Path(path)).fabrics
        for fabric in fabrics:
            data = TrajectoryDataModule(path, [fabric], 1, BATCH, dict.fromkeys(ATTRIBUTES, 1.0), seed=None)
            law = SpringHingeLaw.fit(data.windows_apart(self.windows, BATCH, ()), len(fabrics))
            found = dict(zip(COEFFICIENTS, law.coefficients[fabrics.index(fabric)].tolist(), strict=True))
            springs, hinges = list(found.values())[:3], list(found.values())[3:6]
            steps = steps_run(int(data.file.materials[fabric]["quality"]))
            yield {
                "file": path,
                "fabric": fabric,
                "steps": steps,
                "k_N_per_m": sum(springs),
                **{f"spring_{frame}": value / sum(springs) for frame, value in zip(FRAMES, springs, strict=True)},
                "b_J": sum(hinges),
                **{f"hinge_{frame}": value / sum(hinges) for frame, value in zip(FRAMES, hinges, strict=True)},
                **{f"euler_{frame}": value for frame, value in zip(FRAMES, backward_euler(steps), strict=True)},
                "damper_kg_per_s": found["damper_kg_per_s"],
                "of_steps_kg_per_s": sum(springs) * float(data.file.dt) / steps**2,
                "drag_kg_per_s": found["drag_kg_per_s"],
            }


FRAMES = ("before", "now", "next")


def backward_euler(steps: int) -> tuple[float, float, float]:
    """Weights at t-1, t, t+1 of so many backward Euler steps a frame; see :class:`drape.energy.timing.Timing`."""
    before, after = ((steps - sign) * (steps - 2 * sign) / (6 * steps**2) for sign in (1, -1))
    return before, 1.0 - before - after, after
