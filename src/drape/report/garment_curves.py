"""Figure of the errors of animated garments over time, with the noise floor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from drape.evaluation.scored_sequence import ScoredSequence, by_frame, mean_by_frame
from drape.report.garment_tables import arranged


def draw_garment_curves(scored: Sequence[ScoredSequence], path: Path | str) -> Path:
    """One PNG: mean error [mm] over the sequences of each kind against the frame, all in black, the noise floor dotted.

    The grey band is from the 10th to the 90th percentile over all sequences.
    """
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axis = figure.subplots()
    for kind in arranged(each.kind for each in scored):
        _draw(axis, mean_by_frame([each for each in scored if each.kind == kind], "error_mm"), label=kind, linewidth=1)
    _draw(axis, mean_by_frame(scored, "error_mm"), label="overall", color="black", linewidth=2)
    if len(scored) > 2:
        low, high = np.nanpercentile(by_frame(scored, "error_mm"), [10, 90], axis=0)
        axis.fill_between(np.arange(1, len(low) + 1), low, high, color="black", alpha=0.1, linewidth=0)
    floor = mean_by_frame(scored, "floor_mm")
    if np.isfinite(floor).any():
        _draw(axis, floor, label="noise floor", color="black", linestyle=":")
    axis.set(xlabel="frame", ylabel="mean vertex error [mm]", yscale="log")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.grid(alpha=0.3, linewidth=0.4)
    axis.legend(fontsize=8)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    return path


def _draw(axis: Axes, curve: Float[np.ndarray, " frames"], **style: Any) -> None:
    axis.plot(np.arange(1, len(curve) + 1), curve, **style)
