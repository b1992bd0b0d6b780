"""The figure of the paper that shows what an energy unit learned: φp over stretching and bending."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from drape.energy.law.deformation import StretchHinge
from drape.energy.law.units import PotentialUnits
from drape.report.figure_theme import save_figure

STRETCH = 5e-3
"""Δl of the map is -5…5 mm [m] (paper, figure 4)."""
ANGLE = np.pi / 2
"""α of the map, or Δθ of hinges, is -90…90 degrees [rad]. The paper does not say which of its two angles
it turned."""
POINTS = 81

EnergyOf = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]
"""``energy_of(Δl [m], Δα [rad], Δβ [rad], attributes)`` -> φp [J], all of shape (edges,) but the attributes."""


def energy_of(units: PotentialUnits) -> EnergyOf:
    """φp of learned units as a function of the deformation of an edge; of units with hinges, α stands for Δθ."""

    def energies(stretch: Tensor, alpha: Tensor, beta: Tensor, attributes: Tensor) -> Tensor:
        if isinstance(units.deformation, StretchHinge):
            return units.energies(torch.stack([stretch, alpha], -1), attributes)
        deformation = torch.stack([stretch, alpha.cos(), alpha.sin(), beta.cos(), beta.sin()], -1)
        return units.energies(deformation[:, : units.deformation.size], attributes)

    return energies


@torch.no_grad()
def sample_map(energy: EnergyOf, attributes: Float[Tensor, " attributes"]) -> Float[np.ndarray, "points points"]:
    """φp [J] relative to rest; rows are α, columns Δl, both from the lowest to the highest value, β = 0."""
    device = attributes.device
    axis = torch.linspace(-1.0, 1.0, POINTS, dtype=torch.float64, device=device)
    alpha, stretch = torch.meshgrid(ANGLE * axis, STRETCH * axis, indexing="ij")
    flat = stretch.flatten(), alpha.flatten(), torch.zeros_like(alpha).flatten()
    of_fabric = attributes.double().expand(POINTS**2, -1)
    at_rest = torch.zeros(1, dtype=torch.float64, device=device)
    rest = energy(at_rest, at_rest, at_rest, of_fabric[:1])
    return (energy(*flat, of_fabric) - rest).reshape(POINTS, POINTS).cpu().numpy()


def draw_energy_map(
    models: Mapping[str, EnergyOf], fabrics: Mapping[str, Float[Tensor, " attributes"]], path: Path | str
) -> Path:
    """One PNG, a row for each fabric and a column for each model; every panel with its own colour scale.

    The fabrics of a single model stand in a square. White is the energy at rest, red above, blue below: a sound law is
    white in the middle and red around it. Black lines are levels of equal energy.
    """
    panels = list(itertools.product(fabrics.items(), models.items()))
    columns = len(models) if len(models) > 1 else math.ceil(math.sqrt(len(fabrics)))
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(0.6 + 3.3 * columns, 0.5 + 2.7 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axis, ((fabric, attributes), (name, energy)) in zip(axes.flat, panels, strict=False):
        _draw_panel(figure, axis, sample_map(energy, attributes))
        axis.set_title(f"{fabric}: {name}", fontsize=9)
    for axis in axes.flat[len(panels) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("Δα or, of hinges, Δθ [degrees]")
    for axis in axes[-1]:
        axis.set_xlabel("Δl [mm]")
    figure.suptitle("Elastic energy φp of an edge relative to rest [J]", fontsize=10)
    return save_figure(figure, Path(path))


def _draw_panel(figure: Figure, axis: Axes, energies: Float[np.ndarray, "points points"]) -> None:
    stretch, angle = 1e3 * STRETCH, np.degrees(ANGLE)
    bound = float(np.abs(energies).max()) or 1.0
    extent = (-stretch, stretch, -angle, angle)
    look: dict = {"extent": extent, "origin": "lower"}
    image = axis.imshow(energies, aspect="auto", cmap="RdBu_r", vmin=-bound, vmax=bound, **look)
    if float(np.ptp(energies)) > 0:
        axis.contour(energies, levels=9, colors="black", linewidths=0.4, **look)
    axis.plot(0, 0, "k+", markersize=6)
    axis.set_yticks([-90, -45, 0, 45, 90])
    bar = figure.colorbar(image, ax=axis, shrink=0.9)
    bar.ax.tick_params(labelsize=7)
