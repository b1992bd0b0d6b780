"""A step that can be captured asks for no number; on a GPU, replayed it gives what it gives operator by operator."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from drape.energy.law.step_energies import StepEnergies
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.loss.contrastive import Contrastive
from drape.loss.energy_balance import EnergyBalance, EnergyBalancePerMass
from drape.loss.force_residual import ForceResidual
from drape.loss.term import LossTerm, loss_values
from drape.training.captured_step import CapturedStep
from tests.energies import make_energy, make_window

ON_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="CUDA graphs need a GPU")
PAPER = ("mlp", "speed", False)
OURS = ("hinge", "damping", True)
WAITS = {
    "aten._local_scalar_dense", "aten.nonzero", "aten.masked_select", "aten.bincount", "aten.unique_dim",
    "aten.lift_fresh", "aten.equal", "aten.is_nonzero",
}  # fmt: skip
"""What asks the device for a number, or brings one there that the program waits for."""


class NoWaiting(TorchDispatchMode):
    """Fails where an operator would make a GPU and its program wait for each other."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        name = str(function).removesuffix(".default")
        assert name not in WAITS, name
        if name.startswith(("aten.index.", "aten.index_put")):
            assert not any(index is not None and index.dtype == torch.bool for index in args[1]), f"{name}: a mask"
        return function(*args, **(kwargs or {}))


class Everywhere(Contrastive):
    """The contrastive loss as it is on a GPU."""

    def forward(self, step: StepEnergies) -> torch.Tensor:
        return self.rise_everywhere(step).clamp(max=0.0).square().sum() / step.window.mesh.num_meshes


def terms(kind: tuple, contrastive: type[Contrastive] = Contrastive) -> dict[str, LossTerm]:
    if kind == OURS:
        return {"energy_balance": EnergyBalancePerMass(1.0), "force_residual": ForceResidual(1.0, bend=1.0)}
    return {"energy_balance": EnergyBalance(1.0), "contrastive": contrastive(1e6, sigma=1e-4)}


@pytest.fixture
def mesh() -> MeshBatch:
    return MeshBatch.from_meshes([square_grid(1.0, 8), square_grid(1.0, 8)])


@pytest.mark.parametrize("kind", [PAPER, OURS])
def test_nothing_is_asked_of_the_device(kind, mesh):
    energy, window = make_energy(*kind[:2], timed=kind[2]), make_window(mesh)
    loss = terms(kind, Everywhere)
    loss_values(energy, loss, window)  # what a mesh computes once
    with NoWaiting():
        total = loss_values(energy, loss, window)["total"]
        slopes = torch.autograd.grad(total, list(energy.parameters()), allow_unused=True)
    assert sum(float(slope.abs().sum()) for slope in slopes if slope is not None) > 0


def test_the_draw_that_asks_is_found(mesh):
    energy, window = make_energy("mlp", "speed"), make_window(mesh)
    with pytest.raises(AssertionError, match=r"_local_scalar_dense|nonzero"), NoWaiting():
        loss_values(energy, terms(PAPER), window)


@pytest.mark.parametrize("inertia", ["predicted", "kinetic"])
def test_everywhere_is_the_same_loss(inertia, mesh, monkeypatch):
    """Value and slopes, of the same disturbances of the same vertices."""
    energy, window = make_energy("mlp", "speed"), make_window(mesh)
    noise = 1e-4 * torch.randn(mesh.num_vertices, 3, dtype=torch.float64)
    monkeypatch.setattr(Contrastive, "_noise", lambda _, __, vertices: noise[vertices])
    found = []
    for loss in (Contrastive(1.0, 1e-4, inertia=inertia), Everywhere(1.0, 1e-4, inertia=inertia)):
        torch.manual_seed(3)
        value = loss(StepEnergies(energy, window, training=True))
        found.append([value, *torch.autograd.grad(value, list(energy.parameters()), allow_unused=True)])
    assert found[0][0] > 0
    largest = max(float(slope.detach().abs().max()) for slope in found[0])
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-10 * largest)


def test_windows_of_the_same_mesh_share_it_elsewhere(mesh):
    windows = [make_window(mesh).to("meta") for _ in range(2)]
    assert windows[0].mesh is windows[1].mesh is not mesh
    assert make_window(mesh).to("cpu").mesh is mesh


@ON_GPU
@pytest.mark.parametrize("kind", [PAPER, OURS])
def test_replayed_and_eager_trainings_agree(kind, mesh):
    """Losses of 20 steps in double precision, with the optimiser in between, on windows that change."""
    windows = [make_window(mesh).to("cuda") for _ in range(5)]
    energy = make_energy(*kind[:2], timed=kind[2]).cuda()
    losses = []
    for captured in (False, True):
        own, loss = copy.deepcopy(energy), terms(kind)
        parameters = list(own.parameters())
        optimizer = torch.optim.Adam(parameters, lr=1e-3, fused=True)
        graph = CapturedStep(lambda window, own=own, loss=loss: loss_values(own, loss, window), parameters, windows[0])
        losses.append([])
        for number in range(20):
            torch.manual_seed(number)
            window = windows[number % 5]
            if captured:
                values = graph.replay(window)
            else:
                optimizer.zero_grad()
                values = loss_values(own, loss, window)
                values["total"].backward()
            losses[-1].append(torch.stack(list(values.values())).detach().clone())
            optimizer.step()
    eager, replayed = (torch.stack(values) for values in losses)
    assert (eager[0] != eager[-1]).all()
    torch.testing.assert_close(replayed, eager, rtol=1e-6, atol=0.0)


@ON_GPU
def test_other_meshes_and_time_steps_do_not_fit(mesh):
    energy, window = make_energy("mlp", "speed").cuda(), make_window(mesh).to("cuda")
    loss = terms(PAPER)
    graph = CapturedStep(lambda one: loss_values(energy, loss, one), list(energy.parameters()), window)
    assert graph.fits(make_window(mesh).to("cuda"))
    assert not graph.fits(replace(window, dt=0.5))
    assert not graph.fits(make_window(MeshBatch.from_meshes([square_grid(1.0, 7)])).to("cuda"))
