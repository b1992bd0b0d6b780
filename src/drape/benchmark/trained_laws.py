"""Accuracy of the laws of trained runs against one value of their configs: data, noise, width, ..."""

from __future__ import annotations

import glob
import statistics
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import torch
from jaxtyping import Float
from omegaconf import DictConfig, OmegaConf
from torch import Tensor
from tqdm import tqdm

from drape.benchmark.held_out import Animated, animate
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.datamodule import TrajectoryDataModule
from drape.data.observation import Observation
from drape.data.recorded_scene import held_out
from drape.data.windows import Window
from drape.energy.fabric import Fabric, of_law
from drape.energy.incremental_potential import IncrementalPotential
from drape.energy.law.baked.baking import Resolution, bake
from drape.energy.law.checkpoint import load_energy
from drape.energy.law.eunet import EUNet
from drape.energy.law.hinge_law import NetworkHinges
from drape.energy.law.load_law import load_law
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError
from drape.report.trained_laws import draw_trained_laws
from drape.scene.material import Material
from drape.scene.scene import Scene
from drape.simulators.choice import simulator_of

CHECKPOINT = "checkpoints/last.ckpt"
BATCH = 16
LEARNED = "learned"
"""The law that was trained; the others are fitted to the windows that it was trained on."""


class Run(NamedTuple):
    """One training."""

    checkpoint: Path
    value: float
    """Of the key in its config that runs are compared by."""
    seed: int
    data: TrajectoryDataModule
    """As the training has seen it."""


class TrainedLaws:
    """Force residual and error of animated test sequences, for each run, law and fabric; laws on hinges only.

    Args:
        runs: folders, or patterns of folders; every run below them counts, finished or not.
        against: key of their configs, with a number behind it, e.g. ``scale.train_sequences``.
        laws: ``learned``, and names of fitted ones.
        fits: name -> frames to the instruments of :meth:`SpringHingeLaw.fit`.
        windows: of the training split, that laws are fitted to.
        test_windows: of the test split, evenly spaced, that force residuals are means over.
        sequences: of each fabric, the first of the test split, that are animated.
        frames: to animate.
        table: of the splines that the learned law is animated with.

    Raises:
        DrapeError: no run, one without the key, a law that is not named.
    """

    def __init__(
        self, runs: Sequence[str], against: str, laws: Sequence[str], fits: Mapping[str, Sequence[int]], windows: int,
        test_windows: int, sequences: int, frames: int, table: Resolution,
    ):  # fmt: skip
        unknown = [law for law in laws if law not in (LEARNED, *fits)]
        if unknown:
            raise DrapeError(f"measure.laws: found {unknown[0]}; expected some of {', '.join((LEARNED, *fits))}")
        self.patterns, self.against, self.laws, self.fits = list(runs), against, list(laws), fits
        self.windows, self.test_windows = windows, test_windows
        self.sequences, self.frames, self.table = sequences, frames, table

    def measure(self, config: DictConfig) -> Measured:
        """One row for each run, law and fabric."""
        circumstances = Circumstances()
        rows: list[Row] = []
        runs = sorted(self._runs(), key=lambda run: (run.value, run.seed))
        for run in tqdm(runs, desc="laws", unit=" runs", file=sys.stderr):
            for law in self.laws:
                rows += self._rows(run, law, config)
        title = (
            f"Laws of {len(runs)} trainings: force residual on the test split, and error of {self.sequences} test "
            f"sequences of each fabric, animated for {self.frames} frames from two recorded ones"
        )
        name = self.against.rpartition(".")[2]
        return Measured(name, title, rows, circumstances.text(), {"": partial(draw_trained_laws, rows, name)})

    def _runs(self) -> Iterator[Run]:
        folders = [folder for pattern in self.patterns for folder in glob.glob(pattern)]
        found = sorted({path for folder in folders for path in Path(folder).rglob(CHECKPOINT)})
        if not found:
            raise DrapeError(f"measure.runs: found no {CHECKPOINT} below {', '.join(self.patterns)}; train first")
        for path in found:
            config = cast(DictConfig, OmegaConf.load(path.parents[1] / "config.yaml"))
            value = OmegaConf.select(config, self.against)
            if not isinstance(value, int | float):
                raise DrapeError(f"{path.parents[1]}: {self.against}: found {value}; expected a number to compare by")
            yield Run(path, float(value), config.seed, seen_by(config))

    def _rows(self, run: Run, law: str, config: DictConfig) -> Iterator[Row]:
        residuals, fabrics = self._learned(run) if law == LEARNED else self._fitted(run, self.fits[law])
        for fabric, terms in fabrics:
            scenes = (held_out(str(run.data.file.path), fabric, k, self.frames) for k in range(self.sequences))
            found = [self._animate(scene, terms, config) for scene in scenes]
            yield {
                "value": run.value,
                "seed": run.seed,
                "law": law,
                "fabric": fabric,
                "force_residual_N": residuals[fabric],
                "error_percent": 100 * sum(each.error for each in found) / sum(each.travelled for each in found),
                "converged_percent": 100 * statistics.fmean(each.converged for each in found),
            }

    def _learned(self, run: Run) -> tuple[dict[str, float], Iterator[tuple[str, Fabric]]]:
        energy = load_energy(run.checkpoint)
        residuals = self._residuals(run.data, partial(_force_residual, energy))
        baked = (bake(_hinges(run, m), self.table, fabric=m) for m in _materials(run.data))
        return residuals, ((law.fabric.name, of_law(law)) for law in baked)

    def _fitted(self, run: Run, apart: Sequence[int]) -> tuple[dict[str, float], Iterator[tuple[str, Fabric]]]:
        data = run.data
        fit = SpringHingeLaw.fit(data.windows_apart(self.windows, BATCH, apart), len(data.file.fabrics))
        dt = data.observation.stride * float(data.file.dt)
        baked = (fit.of_fabric(data.file.fabrics.index(m.name), m, data.face_area, dt) for m in _materials(data))
        return self._residuals(data, fit.force_residual), ((law.fabric.name, of_law(law)) for law in baked)

    def _residuals(
        self, data: TrajectoryDataModule, residual: Callable[[Window], Float[Tensor, "vertices 3"]]
    ) -> dict[str, float]:
        """Mean force residual on the free vertices of evenly spaced windows of the test split, for each fabric [N]."""
        found: dict[str, list[Tensor]] = {fabric: [] for fabric in data.fabrics}
        for window in data.test_windows(self.test_windows, BATCH):
            size, fabric = residual(window).norm(dim=-1), window.fabric[window.mesh.mesh_of_vertex]
            for name in data.fabrics:
                found[name].append(size[window.free & (fabric == data.file.fabrics.index(name))])
        return {name: float(torch.cat(sizes).mean()) for name, sizes in found.items()}

    def _animate(self, scene: Scene, fabric: Fabric, config: DictConfig) -> Animated:
        potential = IncrementalPotential.for_scene(scene, fabric.terms)
        return animate(simulator_of(config.simulator, potential, scene, fabric.attributes), scene, scene.reference)


def seen_by(config: DictConfig) -> TrajectoryDataModule:
    """The data that a training has seen."""
    values: Any = OmegaConf.to_container(config.datamodule, resolve=True)
    observation = {key: value for key, value in values.pop("observation").items() if key != "_target_"}
    del values["_target_"]
    return TrajectoryDataModule(fabrics=list(config.material), observation=Observation(**observation), **values)


def _hinges(run: Run, material: Material) -> NetworkHinges:
    law, _ = load_law(str(run.checkpoint), material)
    if not isinstance(law, NetworkHinges):
        raise DrapeError(f"{run.checkpoint}: found a law of twist and bend; expected one of model=eunet_hinge")
    return law


def _materials(data: TrajectoryDataModule) -> list[Material]:
    return [Material.from_settings(name, data.file.materials[name]) for name in data.fabrics]


def _force_residual(energy: EUNet, window: Window) -> Float[Tensor, "vertices 3"]:
    return StepEnergies(energy, window, training=False).force_residual.detach()
