"""Error and cost of animations compared with recorded ones: the trade between accuracy and time."""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from omegaconf import DictConfig
from tqdm import tqdm

from drape.benchmark.composed import Composed
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.data.recorded_scene import held_out
from drape.errors import DrapeError
from drape.metrics.position import distance_travelled, vertex_distance
from drape.report.last_frames import LastFrames, draw_last_frames
from drape.report.trade import draw_trade
from drape.scene.scene import Scene
from drape.scene.square_resampling import SquareResampling, resampled
from drape.simulators.simulator import Outcome, Simulator

RECORDED = "recorded"
"""As a resolution: the recorded mesh."""


class Variant(NamedTuple):
    """One way to animate a sequence."""

    energy: str
    precision: str
    iterations: int
    """At most, per time step."""
    steps: int
    """Time steps in each frame."""
    resolution: int | str
    """Vertices along a side of the square; ``recorded`` for the recorded mesh, whatever it is."""


class Animated(NamedTuple):
    """One sequence, animated."""

    error: float
    """Mean distance of a vertex to the recorded one, where the recording has its vertices [m]."""
    travelled: float
    """Mean distance of a recorded vertex to where it started [m]."""
    seconds: float
    """Per frame, mean."""
    evaluations: float
    """Evaluations of the incremental potential with its forces, per frame, mean."""
    residual: float
    """Unbalanced force per free vertex as a share of the weight, mean."""
    converged: float
    """Share of the frames."""
    last: Float[np.ndarray, "vertices 3"]
    """Positions at the end, where the recording has its vertices [m]."""


class HeldOut:
    """Test sequences of each of the config's fabrics, animated by each variant from their first two frames.

    Pictures: error against time, and the last frame of the last sequence of each fabric by each energy.

    Args:
        path: data file.
        sequences: of each fabric, the first of the test split.
        frames: to simulate.
        variants: named sets of values for the fields of :class:`Variant`; of each set all combinations.
        name: of the files.

    Raises:
        DrapeError: no sequences, or a set that lacks a field or has another one.
    """

    def __init__(
        self, path: str, sequences: int, frames: int, variants: Mapping[str, Mapping[str, Sequence]], name: str
    ):
        if sequences < 1:
            raise DrapeError(f"measure.sequences: found {sequences}; expected a whole number from 1 on")
        self.path = path
        self.sequences = sequences
        self.frames = frames
        self.name = name
        found = (v for name, values in variants.items() for v in combinations(name, values))
        self.variants = list(dict.fromkeys(found))

    def measure(self, config: DictConfig) -> Measured:
        """One row for each fabric and variant; for each sequence all variants have their turn."""
        circumstances, composed = Circumstances(), Composed(config)
        composed.check(variant.energy for variant in self.variants)
        fabrics, rows, ends = list(config.fabrics), [], []
        total = len(fabrics) * self.sequences * len(self.variants)
        self._warm_up(composed, fabrics[0], config.fabrics[fabrics[0]].name)
        with tqdm(total=total, desc="animating", unit=" sequences", file=sys.stderr) as bar:
            for fabric in fabrics:
                found: dict[Variant, list[Animated]] = {variant: [] for variant in self.variants}
                for number in range(self.sequences):
                    scene = held_out(self.path, config.fabrics[fabric].name, number, self.frames)
                    for variant in self.variants:
                        found[variant].append(self._animate(composed, scene, fabric, variant))
                        bar.update()
                rows += [summary(fabric, variant, animated) for variant, animated in found.items()]
                ends.append(LastFrames(scene, nearest(found)))
        title = (
            f"{self.path}: {self.sequences} test sequences of each fabric, {self.frames} frames from two recorded ones"
        )
        figures = {"": partial(draw_trade, rows), "_last_frames": partial(draw_last_frames, ends)}
        return Measured(self.name, title, rows, circumstances.text(), figures)

    def _warm_up(self, composed: Composed, fabric: str, name: str) -> None:
        """Let what is compiled when it is first used be compiled before anything is timed."""
        scene = held_out(self.path, name, 0, 1)
        for variant in {(v.energy, v.precision): v for v in self.variants}.values():
            self._animate(composed, scene, fabric, variant)

    def _animate(self, composed: Composed, recorded: Scene, fabric: str, variant: Variant) -> Animated:
        scene = recorded if variant.resolution == RECORDED else resampled(recorded, int(variant.resolution))
        settings = {name: getattr(variant, name) for name in ("precision", "iterations", "steps")}
        simulator = composed.simulator(scene, variant.energy, fabric, **settings)
        return animate(simulator, scene, recorded.reference)


def nearest(found: Mapping[Variant, Sequence[Animated]]) -> dict[str, Float[np.ndarray, "vertices 3"]]:
    """For each energy the end of the last sequence by that of its variants which comes nearest to all recorded ones."""
    error = {variant: sum(each.error for each in animated) for variant, animated in found.items()}
    farthest_first = sorted(found, key=lambda variant: (np.isfinite(error[variant]), -error[variant]))
    ends = {variant.energy: found[variant][-1].last for variant in farthest_first}
    return {variant.energy: ends[variant.energy] for variant in found}


def combinations(name: str, values: Mapping[str, Sequence]) -> list[Variant]:
    """All variants of the set of values ``name``.

    Raises:
        DrapeError: it lacks a field of :class:`Variant`, or has another one.
    """
    if set(values) != set(Variant._fields):
        raise DrapeError(
            f"conf: measure.variants.{name}: found {', '.join(values)}; expected {', '.join(Variant._fields)}, each a "
            "list of what to try"
        )
    return [Variant(*each) for each in itertools.product(*(values[name] for name in Variant._fields))]


def animate(simulator: Simulator, scene: Scene, reference: np.ndarray | None) -> Animated:
    """Animate ``scene`` and compare with ``reference``, frames of a square that may have another resolution.

    Raises:
        DrapeError: there is nothing to compare with.
    """
    if reference is None:
        raise DrapeError(f"scene {scene.name}: found no recorded frames; expected some to compare with")
    vertices, recorded = (round(count**0.5) for count in (scene.mesh.num_vertices, reference.shape[1]))
    shown = SquareResampling(vertices, recorded) if vertices != recorded else None
    weight = float(np.linalg.norm(scene.gravity) * scene.mass.mean())
    state, x, results, seconds = scene.initial, [], [], []
    for frame in range(scene.frames):
        began = time.perf_counter()
        results.append(simulator.step(state, frame))
        seconds.append(time.perf_counter() - began)
        state = results[-1].state
        x.append(state.x if shown is None else shown(state.x))
    return Animated(
        error=vertex_distance(np.stack(x), reference[1:]),
        travelled=distance_travelled(reference),
        seconds=float(np.mean(seconds)),
        evaluations=float(np.mean([result.iterations for result in results])),
        residual=float(np.mean([result.residual for result in results])) / weight,
        converged=float(np.mean([result.outcome is Outcome.CONVERGED for result in results])),
        last=x[-1],
    )


def summary(fabric: str, variant: Variant, animated: Sequence[Animated]) -> Row:
    """Means over sequences, of the time the median; the share is that of the means."""
    of = {name: [getattr(each, name) for each in animated] for name in Animated._fields if name != "last"}
    mean = {name: float(np.mean(values)) for name, values in of.items()}
    return {
        "fabric": fabric,
        **variant._asdict(),
        "error_mm": 1e3 * mean["error"],
        "travelled_mm": 1e3 * mean["travelled"],
        "error_percent": 100 * mean["error"] / mean["travelled"],
        "error_percent_std": 100 * float(np.std(of["error"])) / mean["travelled"],
        "ms_per_frame": 1e3 * float(np.median(of["seconds"])),
        "evaluations_per_frame": mean["evaluations"],
        "residual_percent_of_weight": 100 * mean["residual"],
        "converged_percent": 100 * mean["converged"],
    }
