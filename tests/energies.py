"""The family of energies that the contracts run on, and windows to run them with."""

from __future__ import annotations

from functools import partial

import torch

from drape.data.windows import Window
from drape.energy.deformation import Stretch, StretchBending
from drape.energy.dissipation_rate import RateDissipation
from drape.energy.dissipation_speed import SpeedDissipation
from drape.energy.eunet import EUNet
from drape.energy.potential_mlp import MLPPotential
from drape.energy.potential_stable import StablePotential
from drape.nets.mlp import EnergyNet
from drape.scene.mesh_batch import MeshBatch
from tests.conftest import bent

NET = partial(EnergyNet, width=16, blocks=1, layers_per_block=2)

POTENTIALS = {
    "mlp": lambda deformation: MLPPotential(deformation, NET, stretch_scale=0.01, energy_scale=0.1),
    "stable": lambda deformation: StablePotential(deformation, 16, stretch_scale=0.01, energy_scale=0.1),
}
DISSIPATIONS = {
    "none": lambda _: None,
    "speed": lambda _: SpeedDissipation(NET, speed_scale=1.0, energy_scale=0.1),
    "rate": lambda deformation: RateDissipation(deformation, 16, 0.01, 1.0, 0.02, 0.1),
}
DEFORMATIONS = {"stretch": Stretch, "stretch_bending": StretchBending}
ENERGIES = [(p, d, f) for p in POTENTIALS for d in DISSIPATIONS for f in DEFORMATIONS]


def make_energy(potential: str, dissipation: str, deformation: str = "stretch_bending") -> EUNet:
    """A member of the family in float64, with all parameters random, so that no part of it is silent."""
    seen = DEFORMATIONS[deformation]()
    energy = EUNet(POTENTIALS[potential](seen), DISSIPATIONS[dissipation](seen)).double()
    with torch.no_grad():
        for parameter in energy.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return energy


def make_window(mesh: MeshBatch, dt: float = 1.0 / 30.0) -> Window:
    """A cloth in smooth motion, the first row pinned."""
    rest = mesh.rest_positions
    motion = 0.02 * torch.stack([rest[:, 1], rest[:, 0] * rest[:, 1], torch.cos(2 * rest[:, 0])], -1)
    x = bent(rest)
    return Window(
        mesh=mesh,
        x_prev=x - motion,
        x=x,
        x_next=x + 1.1 * motion + 1e-3 * torch.randn_like(x),
        mass=torch.linspace(0.1, 0.3, mesh.num_vertices, dtype=torch.float64),
        free=torch.arange(mesh.num_vertices) > 2,
        attributes=torch.rand(mesh.num_meshes, 5, dtype=torch.float64),
        fabric=torch.arange(mesh.num_meshes) % 4,
        gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64),
        dt=dt,
    )
