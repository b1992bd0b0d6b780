"""Cards of fabrics in the terms of textile data sheets: measured by the solver, with published ranges."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Mapping, Sequence

from omegaconf import DictConfig
from tqdm import tqdm

from drape import config as conf
from drape.benchmark.bending_test import Bent, bending_test
from drape.benchmark.composed import Composed
from drape.benchmark.drape_test import Draped, drape_test
from drape.benchmark.falling_test import falling_speed
from drape.benchmark.measured import Circumstances, Measured, Row
from drape.benchmark.sample import Sample
from drape.benchmark.tensile_test import TensileTest
from drape.errors import DrapeError
from drape.report.fabric_cards import Compared, Pictured, draw_cards
from drape.report.table import number
from drape.scene.scene import Scene
from drape.simulators.simulator import Simulator
from drape.simulators.solver.balance import mean_weight

LAW = "law"
"""Name of the energy of the config that cards are of."""
NONE_FOUND = "none found"
"""Entry of a card for a property of a fabric for which no published value was found that can be checked."""


class FabricCard:
    """One card for each fabric, of the config's energy ``law`` at the areal density of the config's scene.

    Args:
        fabrics: names out of the config's ``fabrics``.
        cells: edges along a strip that bends (``bent``), from clamp to clamp of a sheet that is pulled (``pulled``).
        rings: of vertices of a disc that drapes.
        diameters: of these discs [m].
        loads: at which extension is taken [N/m].
        residual: unbalanced force at which a step is done, mean over the vertices, as a share of their weight.
        published: by fabric and property, least and largest value, and a key of ``sources``.
        sources: what is cited, by key.

    Raises:
        DrapeError: an odd number of cells to be pulled, a source that is not there.
    """

    def __init__(
        self,
        fabrics: Sequence[str],
        cells: Mapping[str, int],
        rings: int,
        diameters: Sequence[float],
        loads: Sequence[float],
        residual: float,
        published: Mapping[str, Mapping[str, Sequence]],
        sources: Mapping[str, str],
    ):
        if cells["pulled"] % 2:
            raise DrapeError(f"measure.cells.pulled: found {cells['pulled']}; expected an even number")
        for _, _, source in (each for ranges in published.values() for each in ranges.values()):
            if source not in sources:
                raise DrapeError(
                    f"measure.published: found the source {source!r}; expected one of measure.sources: "
                    f"{', '.join(sources)}"
                )
        self.fabrics, self.cells, self.rings, self.diameters = fabrics, cells, rings, diameters
        self.loads, self.residual, self.published, self.sources = loads, residual, published, sources

    def measure(self, config: DictConfig) -> Measured:
        """Of the law of ``config`` and each fabric.

        Raises:
            DrapeError: a fabric that the config does not have, or see the tests.
        """
        circumstances, composed, rows, pictured = Circumstances(), Composed(config), [], []
        composed.check([LAW])
        for fabric in tqdm(self.fabrics, desc="testing", unit=" fabrics", file=sys.stderr):
            if fabric not in config.fabrics:
                raise DrapeError(f"measure.fabrics: found {fabric!r}; expected some of {', '.join(config.fabrics)}")
            sample = self._sample(composed, fabric)
            bent = bending_test(sample, self.cells["bent"])
            discs = [drape_test(sample, diameter, self.rings) for diameter in self.diameters]
            ranges = self.published.get(fabric, {})
            values = self._values(sample, bent, discs)
            looked_for = bool(ranges)
            rows += [row(fabric, name, v, ranges.get(name), looked_for=looked_for) for name, v in values.items()]
            known = [(name, *each[:2]) for name, each in ranges.items() if name in values]
            compared = [Compared(name, values[name], float(low), float(high)) for name, low, high in known]
            pictured.append(Pictured(fabric, bent.profile, discs[-1].x, discs[-1].faces, compared))
        cited = [f"{key}: {text}" for key, text in self.sources.items()]
        note = "; ".join([*cited, circumstances.text()])
        title = "Fabrics in the terms of textile data sheets, by the solver, beside what is published"
        return Measured("fabric_cards", title, rows, note, {"": functools.partial(draw_cards, pictured)})

    def _sample(self, composed: Composed, fabric: str) -> Sample:
        config = composed.with_fabric(fabric)

        def solver(scene: Scene) -> Simulator:
            return composed.simulator(scene, LAW, fabric, tolerance=self.residual * mean_weight(scene))

        density = float(config.scene.mass.areal_density)
        return Sample(conf.instantiate(config.fabric), density, composed.law(LAW, fabric), solver)

    def _values(self, sample: Sample, bent: Bent, discs: Sequence[Draped]) -> dict[str, float | int]:
        """Property, with its unit -> value."""
        pulled = TensileTest(sample, self.cells["pulled"]).run(self.loads)
        sizes = [f"{100 * diameter:g} cm" for diameter in self.diameters]
        return {
            "areal density, g/m2": 1e3 * sample.areal_density,
            "bending length, cm": 1e2 * bent.bending_length,
            "flexural rigidity, uN m": 1e6 * bent.flexural_rigidity,
            **{f"drape coefficient of {size}, %": 1e2 * d.coefficient for size, d in zip(sizes, discs, strict=True)},
            **{f"folds of {size}": d.folds for size, d in zip(sizes, discs, strict=True)},
            "tensile stiffness, N/m": pulled.stiffness,
            **{f"extension at {p:g} N/m, %": 1e2 * e for p, e in zip(self.loads, pulled.extensions, strict=True)},
            "damping time of stretching, ms": 1e3 * pulled.damping_time,
            "final speed of a falling sheet, m/s": falling_speed(sample),
        }


def row(fabric: str, name: str, value: float | int, known: Sequence | None, *, looked_for: bool = False) -> Row:
    """A row of the table: a value with what is ``known``, its least and largest value and their source.

    Where nothing is known, ``none found`` if it was ``looked_for``.
    """
    if known is None:
        published = NONE_FOUND if looked_for else ""
        return {"fabric": fabric, "property": name, "law": value, "published": published, "judgement": "", "source": ""}
    low, high, source = float(known[0]), float(known[1]), known[2]
    published = f"{low:g} to {high:g}" if low < high else f"{low:g}"
    judgement = beside(value, low, high)
    return {
        "fabric": fabric, "property": name, "law": value, "published": published, "judgement": judgement,
        "source": source,
    }  # fmt: skip


def beside(value: float | int, low: float, high: float) -> str:
    """A value compared with a range, in words."""
    if low <= value <= high:
        return "within"
    if not math.isfinite(value):
        return "never reached"
    return f"{number(value / high)} x the largest" if value > high else f"{number(value / low)} x the least"
