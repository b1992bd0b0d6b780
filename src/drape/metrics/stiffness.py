"""Whether the learned energy found the one number of the fabric that is known: the constant of Blender's springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.metrics.fabric_metric import FabricMetric

BINS_PER_DECADE = 20
SMALLEST, DECADES = 1e-8, 9
"""Bins of |Δl| / l_rest: 1e-8 … 10; what lies outside goes to the first or last bin."""
CENTRAL = 0.9
"""Share of the edges, those of smallest |Δl| / l_rest, that the secant is taken over."""


class StretchStiffness(FabricMetric):
    """Slope of the tension ∂φp/∂Δl in Δl [N/m], and the constant of the springs that Blender used.

    * ``stretch_stiffness_N_per_m``: ∂²φp/∂Δl² at Δl = 0 and angles at rest, mean over edges.
    * ``stretch_secant_N_per_m``: least-squares slope of ∂φp/∂Δl against Δl over the deformations at t+1 of the data,
      as they are (angles too), for the ``CENTRAL`` share of edges with the smallest strain: what the cloth feels.
    * ``blender_stiffness_N_per_m``: ``tension / (dt² l̄)``, l̄ the mean rest length of all mesh edges. In Blender's
      own clock, where gravity of 9.81 m/s² adds 0.00981 m/frame², this reads 1000 · tension / l̄ (docs/sources.md,
      Blender's springs; 1000 is (31.6/s)²); the data rescale gravity so that a frame is dt = 1/fps, and forces scale
      with 1/dt².
    * ``stretch_stiffness_ratio`` and ``stretch_secant_ratio``: the first two divided by the third.

    Args:
        tension: Blender's tension stiffness of each fabric.
    """

    tension: Tensor
    meshes: Tensor
    at_rest: Tensor
    blender: Tensor
    moments: Tensor

    def __init__(self, fabrics: Sequence[str], tension: Mapping[str, float]):
        super().__init__(fabrics)
        missing = [name for name in fabrics if name not in tension]
        if missing:
            raise DrapeError(f"stretch stiffness: no tension stiffness of {missing}; known are {sorted(tension)}")
        self.register_buffer("tension", torch.tensor([float(tension[name]) for name in fabrics], dtype=torch.float64))
        for name in ("meshes", "at_rest", "blender"):
            self.add_sum(name)
        self.add_sum("moments", BINS_PER_DECADE * DECADES, 5)

    def update(self, step: StepEnergies) -> None:
        self._add_moments(step)
        window, mesh = step.window, step.window.mesh
        new = (self.meshes[window.fabric] == 0).double()
        if not bool(new.any()):
            return
        edges = mesh.sum_edges(torch.ones_like(mesh.rest_lengths))
        at_rest = mesh.sum_edges(stiffness(step, mesh.rest)) / edges
        mean_length = mesh.sum_edges(mesh.rest_lengths) / edges
        blender = self.tension[window.fabric] / (window.dt**2 * mean_length)
        self.meshes += self.per_fabric(window, new)
        self.at_rest += self.per_fabric(window, at_rest * new)
        self.blender += self.per_fabric(window, blender * new)

    def _add_moments(self, step: StepEnergies) -> None:
        window, mesh = step.window, step.window.mesh
        stretch, tension = (each["potential"][-1, :, 0].detach().double() for each in (step.inputs, step.slopes))
        strain = stretch.abs() / mesh.rest_lengths
        bins = self.moments.shape[1]
        place = (BINS_PER_DECADE * (strain.clamp(min=SMALLEST) / SMALLEST).log10()).long().clamp(max=bins - 1)
        terms = torch.stack([torch.ones_like(stretch), stretch, tension, stretch**2, stretch * tension], -1)
        index = window.fabric[mesh.mesh_of_edge] * bins + place
        self.moments += torch.zeros_like(self.moments).flatten(0, 1).index_add(0, index, terms).view_as(self.moments)

    def compute(self) -> dict[str, float]:
        seen = [i for i, count in enumerate(self.meshes.tolist()) if count]
        values = {
            "stretch_stiffness": self.at_rest / self.meshes,
            "stretch_secant": torch.stack([secant(moments) for moments in self.moments]),
        }
        blender = self.blender / self.meshes
        result = {f"blender_stiffness_N_per_m/{self.fabrics[i]}": blender[i].item() for i in seen}
        for name, slopes in values.items():
            result |= {f"{name}_N_per_m/{self.fabrics[i]}": slopes[i].item() for i in seen}
            result |= {f"{name}_ratio/{self.fabrics[i]}": (slopes / blender)[i].item() for i in seen}
        return result


def stiffness(step: StepEnergies, geometry: EdgeGeometry) -> Float[Tensor, " edges"]:
    """∂²φp/∂Δl² [N/m] of each edge of ``geometry``, the angles held."""
    with torch.enable_grad():
        units = step.energy.potential
        deformation = units.inputs(geometry).detach()
        stretch = deformation[:, :1].requires_grad_()
        energies = units.energies(torch.cat([stretch, deformation[:, 1:]], -1), step.attributes)
        (slope,) = torch.autograd.grad(energies.sum(), stretch, create_graph=True)
        if not slope.requires_grad:
            return torch.zeros_like(slope[:, 0])
        (second,) = torch.autograd.grad(slope.sum(), stretch)
    return second[:, 0].double()


def secant(moments: Float[Tensor, "bins 5"]) -> Float[Tensor, ""]:
    """Slope of y in x by least squares with intercept over the bins that hold the central share of the edges.

    Moments of each bin: count, Σx, Σy, Σx², Σxy.
    """
    counts = moments[:, 0].cumsum(0)
    central = counts - moments[:, 0] < CENTRAL * counts[-1]
    n, x, y, xx, xy = moments[central].sum(0)
    return (n * xy - x * y) / (n * xx - x * x)
