"""The family of energies that the contracts run on, and windows to run them with."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from drape.data.windows import Window
from drape.energy.law.checkpoint import describe
from drape.energy.law.damping import Damping
from drape.energy.law.deformation import Stretch, StretchBending, StretchHinge
from drape.energy.law.dissipation_speed import SpeedDissipation
from drape.energy.law.eunet import EUNet
from drape.energy.law.potential_hinge import HingePotential
from drape.energy.law.potential_mlp import MLPPotential
from drape.energy.law.timing import Timing
from drape.geometry.mesh_batch import MeshBatch
from drape.nets.mlp import EnergyNet
from drape.scene.material import ATTRIBUTES
from tests.conftest import bent

NET = partial(EnergyNet, width=16, blocks=1, layers_per_block=2)

PAPER = {
    "_target_": "drape.energy.law.eunet.EUNet",
    "potential": {
        "_target_": "drape.energy.law.potential_mlp.MLPPotential",
        "deformation": {"_target_": "drape.energy.law.deformation.StretchBending"},
        "net": {"_target_": "drape.nets.mlp.EnergyNet", "_partial_": True} | NET.keywords,
        "stretch_scale": 0.01, "energy_scale": 0.1,
    },
}  # fmt: skip
"""The config of ``make_energy("mlp", "none")``."""


class SettledPotential(MLPPotential):
    """``energy_scale d² (1 + net²)``, the paper's network and the distance d of what it sees from rest."""

    def energies(self, inputs: Tensor, attributes: Tensor) -> Tensor:
        stretch = (inputs[:, :1] / self.stretch_scale).square().sum(-1)
        distance = stretch + 2.0 * (1.0 - inputs[:, 1::2]).sum(-1)
        factor = 1.0 + (super().energies(inputs, attributes) / self.energy_scale).square()
        return self.energy_scale * distance * factor


POTENTIALS = {
    "mlp": lambda deformation: MLPPotential(deformation, NET, stretch_scale=0.01, energy_scale=0.1),
    "hinge": lambda deformation: HingePotential(deformation, 16, stretch_scale=0.01, angle_scale=0.2, energy_scale=0.1),
    "settled": lambda deformation: SettledPotential(deformation, NET, stretch_scale=0.01, energy_scale=0.1),
}
"""The last is none of the program's: the paper's form, for tests of what holds at the rest of a law that has one."""
DISSIPATIONS = {
    "none": lambda: None,
    "speed": lambda: SpeedDissipation(NET, speed_scale=1.0, energy_scale=0.1),
    "damping": lambda: Damping(16, stretch_scale=0.01, speed_scale=1.0, energy_scale=0.1),
}
DEFORMATIONS = {"stretch": Stretch, "stretch_bending": StretchBending, "stretch_hinge": StretchHinge}
SEEN = {
    "mlp": ["stretch_bending", "stretch"],
    "hinge": ["stretch_hinge", "stretch"],
    "settled": ["stretch_bending", "stretch"],
}
"""What the units of each potential see of an edge, first what they do unless told otherwise."""
ENERGIES = [(p, d, f) for p in ("mlp", "hinge") for d in DISSIPATIONS for f in SEEN[p]]


def make_energy(potential: str, dissipation: str, deformation: str | None = None, *, timed: bool = False) -> EUNet:
    """A member of the family in float64, with all parameters random, so that no part of it is silent."""
    seen = DEFORMATIONS[deformation or SEEN[potential][0]]()
    timing = Timing(seen, 16) if timed else None
    energy = EUNet(POTENTIALS[potential](seen), DISSIPATIONS[dissipation](), timing).double()
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


def write_checkpoint(path: Path, energy: EUNet, model: dict, mesh: MeshBatch) -> Path:
    """A checkpoint of silk, as a training writes it, of an energy whose config is ``model``; attributes are tenths."""
    datamodule = {"attribute_scales": dict.fromkeys(ATTRIBUTES, 10.0)}
    config = {"model": model, "material": {"silk": {}}, "datamodule": datamodule}
    state = {f"energy.{key}": value for key, value in energy.state_dict().items()}
    torch.save({"state_dict": state, "drape": describe(config, energy, make_window(mesh))}, path)
    return path
