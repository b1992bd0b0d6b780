"""A training sample: three consecutive frames of cloth, several of them as one big mesh."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from drape.data.sequence import GarmentSequence
from drape.geometry.mesh_batch import MeshBatch


@dataclass(frozen=True, eq=False)
class Window:
    """Frames t-1, t, t+1 of ``meshes`` cloths; positions in float64, because energies live in their differences."""

    mesh: MeshBatch
    x_prev: Float[Tensor, "vertices 3"]
    """Positions at t-1 [m]."""
    x: Float[Tensor, "vertices 3"]
    """Positions at t [m]."""
    x_next: Float[Tensor, "vertices 3"]
    """Positions at t+1 [m]."""
    mass: Float[Tensor, " vertices"]
    """Mass of each vertex [kg]."""
    free: Bool[Tensor, " vertices"]
    """False where a vertex is pinned."""
    attributes: Float[Tensor, "meshes attributes"]
    """The vector **a** of the fabric, scaled."""
    fabric: Int[Tensor, " meshes"]
    """Index of the fabric among the fabrics of the data."""
    gravity: Float[Tensor, "3"]
    """[m/s²]"""
    dt: float
    """Time step [s]."""

    @property
    def v(self) -> Float[Tensor, "vertices 3"]:
        """Velocities at t [m/s]: backward difference."""
        return (self.x - self.x_prev) / self.dt

    @property
    def v_next(self) -> Float[Tensor, "vertices 3"]:
        """Velocities at t+1 [m/s]: backward difference."""
        return (self.x_next - self.x) / self.dt

    @property
    def edge_attributes(self) -> Float[Tensor, "edges attributes"]:
        return self.attributes[self.mesh.mesh_of_edge]

    def to(self, device: torch.device | str, **_: object) -> Window:
        """The same window on another device; nobody waits for what is copied to a GPU."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "dt"}
        to_gpu = torch.device(device).type == "cuda"

        def moved(value: Tensor | MeshBatch) -> Tensor | MeshBatch:
            if to_gpu and isinstance(value, Tensor) and not value.is_cuda:
                return value.pin_memory().to(device, non_blocking=True)
            return value.to(device)

        there: dict[str, Any] = {name: moved(value) for name, value in values.items()}
        return replace(self, **there)

    @property
    def balance(self) -> Float[Tensor, " meshes"]:
        """ΔV, the change of elastic plus dissipated energy that the motion shows [J] (paper, eq. 6).

        ``-(T(t+1) - T(t)) - (V_g(t+1) - V_g(t))``, each difference taken vertex by vertex before it is summed.
        """
        step = self.x_next - self.x
        kinetic = 0.5 * ((self.v_next - self.v) * (self.v_next + self.v)).sum(-1)
        return -self.mesh.sum_vertices(self.mass * (kinetic - step @ self.gravity))

    @property
    def inertial_force(self) -> Float[Tensor, "vertices 3"]:
        """``m (x(t+1) - 2x(t) + x(t-1)) / dt² - m g`` [N]: balanced by internal and damping forces (paper, eq. 9)."""
        acceleration = ((self.x_next - self.x) - (self.x - self.x_prev)) / self.dt**2
        return self.mass[:, None] * (acceleration - self.gravity)


def mass_and_free(sequence: GarmentSequence) -> tuple[Float[Tensor, " vertices"], Bool[Tensor, " vertices"]]:
    """Mass of each vertex [kg], and whether it is not pinned."""
    free = torch.ones(sequence.mesh.num_vertices, dtype=torch.bool)
    free[torch.from_numpy(sequence.pinned)] = False
    return torch.from_numpy(sequence.mass), free
