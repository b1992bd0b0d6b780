"""The vertex-wise contrastive loss of EUNet: no small displacement of a vertex may lower the total energy."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.step_energies import StepEnergies
from drape.geometry.edge_geometry import EdgeGeometry
from drape.loss.disturbance import ROUNDS, affected_edges, causes, chosen_vertices, disturbed_vertices
from drape.loss.term import LossTerm

ROWS = 512
"""Affected edges are evaluated in multiples of so many: a product of a new size costs half a millisecond by oneDNN."""


class Contrastive(LossTerm):
    """``Σ_i min(E(x_i + δ) - E(x_i), 0)²`` [J²] over disturbed vertices i, averaged over the batch (paper, eq. 16).

    E is the incremental potential of the vertex, ``K + V_g + Σ φ`` over the edges that it changes. The standard
    deviation of δ is drawn for each mesh from σ/10, 2σ/10, …, σ with σ = ``sigma`` [m]. ``inertia`` chooses K:
    ``predicted`` is ``m|x - x̂|²/2dt²`` with ``x̂ = x + dt v`` (paper, eq. 10), ``kinetic`` is ``m|x - x(t)|²/2dt²``
    (docs/sources.md, The official configuration of EUNet). All differences are taken term by term in float64.
    """

    def __init__(
        self, weight: float, sigma: float, levels: int = 10, inertia: Literal["predicted", "kinetic"] = "predicted"
    ):
        super().__init__(weight)
        if inertia not in ("predicted", "kinetic"):
            raise ValueError(f"contrastive loss: inertia is {inertia!r}; expected 'predicted' or 'kinetic'")
        self.sigma = sigma
        self.levels = levels
        self.inertia = inertia

    def forward(self, step: StepEnergies) -> Float[Tensor, ""]:
        if step.window.x.is_cuda:
            rise = self.rise_everywhere(step)
        else:
            _, rise = self.rise(step)
        return rise.clamp(max=0.0).square().sum() / step.window.mesh.num_meshes

    def rise(self, step: StepEnergies) -> tuple[Int[Tensor, " disturbed"], Float[Tensor, " disturbed"]]:
        """A fresh draw of disturbed vertices i, and ``E(x_i + δ) - E(x_i)`` [J] of each with a δ of its own."""
        window, mesh = step.window, step.window.mesh
        vertices = disturbed_vertices(mesh, window.free)
        noise = self._noise(window, vertices)
        edges, cause = affected_edges(mesh, vertices)
        change = self._change(step, window.x_next.index_add(0, vertices, noise), _filled_up(edges))[: len(edges)]
        own = self._inertia_and_gravity(step, vertices, noise)
        return vertices, own.index_add(0, cause, change)

    def rise_everywhere(self, step: StepEnergies) -> Float[Tensor, " vertices"]:
        """The same of every vertex, 0 of those that the draw leaves out.

        All edges are evaluated, affected or not, so that the sizes of all arrays are known beforehand: a GPU is not
        asked how many there are, and the step can be captured as a graph.
        """
        window, mesh = step.window, step.window.mesh
        chosen = chosen_vertices(mesh, window.free, rounds=ROUNDS)
        every = torch.arange(mesh.num_vertices, device=chosen.device)
        noise = self._noise(window, every) * chosen[:, None]
        cause = causes(mesh, torch.where(chosen, every, -1))
        change = self._change(step, window.x_next + noise, slice(None)).masked_fill(cause < 0, 0.0)
        own = self._inertia_and_gravity(step, every, noise)
        return own.index_add(0, cause.clamp(min=0), change)

    def _noise(self, window: Window, vertices: Int[Tensor, " disturbed"]) -> Float[Tensor, "disturbed 3"]:
        mesh = window.mesh
        level = torch.randint(1, self.levels + 1, (mesh.num_meshes,), device=vertices.device)
        spread = self.sigma * level / self.levels
        noise = torch.randn(len(vertices), 3, dtype=window.x.dtype, device=vertices.device)
        return noise * spread[mesh.mesh_of_vertex[vertices], None]

    def _change(
        self, step: StepEnergies, x: Float[Tensor, "vertices 3"], edges: Int[Tensor, " affected"] | slice
    ) -> Float[Tensor, " affected"]:
        """Gain of the energies of ``edges`` where x_next becomes ``x`` [J]."""
        inputs = step.energy.inputs(EdgeGeometry(x, step.window.mesh), step.current, step.window.dt)
        inputs = {name: value[edges] for name, value in inputs.items()}
        energies = step.energy.energies(inputs, step.attributes[edges])
        return energies.total - step.next.total[edges]

    def _inertia_and_gravity(self, step: StepEnergies, vertices: Tensor, noise: Tensor) -> Tensor:
        window = step.window
        start = window.x[vertices]
        if self.inertia == "predicted":
            start = start + window.dt * window.v[vertices]
        offset = window.x_next[vertices] - start
        kinetic = (noise * (2.0 * offset + noise)).sum(-1) / (2.0 * window.dt**2)
        return window.mass[vertices] * (kinetic - noise @ window.gravity)


def _filled_up(edges: Int[Tensor, " affected"]) -> Int[Tensor, " rows"]:
    """With edge 0 as often again as it takes for a multiple of :data:`ROWS`."""
    return torch.nn.functional.pad(edges, (0, -len(edges) % ROWS))
