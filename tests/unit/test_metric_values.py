"""Values of the metrics that can be worked out by hand."""

from dataclasses import replace

import pytest
import torch

from drape.data.windows import Window
from drape.energy.law.deformation import StretchBending
from drape.energy.law.eunet import EUNet
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.law.step_energies import StepEnergies
from drape.energy.law.units import PotentialUnits
from drape.errors import DrapeError
from drape.geometry.edge_geometry import EdgeGeometry
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.metrics.contrastive import ContrastiveViolations
from drape.metrics.energy_error import EnergyError
from drape.metrics.force import ForceResidual, InertialForce, SpringHingeResidual
from drape.metrics.rest_state import RestState
from drape.metrics.stiffness import StretchStiffness, secant

FABRICS = ("silk", "denim")
STIFFNESS = {"silk": 300.0, "denim": 2000.0}
DT = 1 / 30


class Springs(PotentialUnits):
    """``φp = offset + k (Δl - shift)² / 2`` with k the first attribute [N/m]."""

    def __init__(self, offset: float = 0.0, shift: float = 0.0):
        super().__init__(StretchBending())
        self.offset, self.shift = offset, shift

    def energies(self, inputs, attributes):
        return self.offset + 0.5 * attributes[:, 0] * (inputs[:, 0] - self.shift) ** 2


def window(fabrics: list[int], seed: int = 0) -> Window:
    generator = torch.Generator().manual_seed(seed)
    mesh = MeshBatch.from_meshes([square_grid(1.0, 5)] * len(fabrics))
    frames = [
        mesh.rest_positions + 0.02 * torch.randn(mesh.num_vertices, 3, generator=generator, dtype=torch.float64)
        for _ in range(3)
    ]
    free = torch.ones(25, dtype=torch.bool)
    free[[0, 4]] = False
    attributes = torch.zeros(len(fabrics), 5, dtype=torch.float64)
    attributes[:, 0] = torch.tensor([STIFFNESS[FABRICS[k]] for k in fabrics])
    return Window(
        mesh=mesh,
        x_prev=frames[0],
        x=frames[1],
        x_next=frames[2],
        mass=torch.full((mesh.num_vertices,), 0.3, dtype=torch.float64),
        free=free.repeat(len(fabrics)),
        attributes=attributes,
        fabric=torch.tensor(fabrics),
        gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64),
        dt=DT,
    )


def step(moving: Window, **springs: float) -> StepEnergies:
    return StepEnergies(EUNet(Springs(**springs)), moving, training=False)


def at_rest(moving: Window) -> Window:
    rest = moving.mesh.rest_positions
    return replace(moving, x_prev=rest, x=rest, x_next=rest)


def test_energy_error_of_cloth_that_falls_or_does_not():
    """At rest twice: no change. Falling rigidly: Φ stays, and the motion loses what docs/sources.md says."""
    still = at_rest(window([0, 1]))
    fallen = still.mesh.rest_positions + 0.5 * still.gravity * DT**2
    falling = replace(still, x=fallen, x_next=still.mesh.rest_positions + 2.0 * still.gravity * DT**2)
    label = 25 * 0.3 * 9.81**2 * DT**2 / 2
    metric = EnergyError(FABRICS)
    metric.update(step(still))
    metric.update(step(falling))
    result = metric.compute()
    assert result["energy_error_J2/silk"] == pytest.approx(label**2 / 2, rel=1e-9)
    assert result["energy_error_J2_std/silk"] == pytest.approx(label**2 / 2, rel=1e-9)
    assert result["energy_error_J2/overall"] == pytest.approx(label**2 / 2, rel=1e-9)


def test_energy_error_is_the_loss_of_the_paper():
    moving = window([0, 1, 1])
    k = moving.attributes[:, 0]
    stretch = [EdgeGeometry(x, moving.mesh).length - moving.mesh.rest_lengths for x in (moving.x, moving.x_next)]
    squares = [moving.mesh.sum_edges(edges.square()) for edges in stretch]
    change = 0.5 * k * (squares[1] - squares[0])
    error = (change - moving.balance).square()
    metric = EnergyError(FABRICS)
    metric.update(step(moving))
    result = metric.compute()
    assert result["energy_error_J2/silk"] == pytest.approx(error[0].item())
    assert result["energy_error_J2/denim"] == pytest.approx(error[1:].mean().item())
    assert result["energy_error_J2_std/overall"] == pytest.approx(error.std(correction=0).item())


def test_forces_of_cloth_at_rest_are_its_weight():
    still = at_rest(window([0, 1]))
    for metric in (ForceResidual(FABRICS), InertialForce(FABRICS)):
        metric.update(step(still))
        for value in metric.compute().values():
            assert value == pytest.approx(0.3 * 9.81, rel=1e-6)


def test_force_residual_of_the_true_energy_is_nothing():
    moving = window([0, 1])
    force = -step(moving).gradient
    acceleration = force / moving.mass[:, None] + moving.gravity
    obeying = replace(moving, x_prev=2 * moving.x - moving.x_next + DT**2 * acceleration)
    right, nothing = ForceResidual(FABRICS), InertialForce(FABRICS)
    for metric in (right, nothing):
        metric.update(step(obeying))
    assert right.compute()["force_residual_N/overall"] < 1e-9
    assert nothing.compute()["inertial_force_N/overall"] == pytest.approx(
        force.norm(dim=-1)[obeying.free].mean().item(), rel=1e-9
    )


def test_pinned_vertices_do_not_count():
    still = at_rest(window([0]))
    heavy = still.mass.clone()
    heavy[~still.free] = 100.0
    metric = InertialForce(FABRICS)
    metric.update(step(replace(still, mass=heavy)))
    assert metric.compute()["inertial_force_N/silk"] == pytest.approx(0.3 * 9.81)


def test_spring_hinge_residual_is_that_of_the_law():
    moving = window([0, 1])
    law = SpringHingeLaw.fit([(moving,)], num_fabrics=2)
    metric = SpringHingeResidual(FABRICS, law)
    metric.update(step(moving))
    residual = law.force_residual(moving).norm(dim=-1)[moving.free]
    assert metric.compute()["spring_hinge_residual_N/overall"] == pytest.approx(residual.mean().item())


def test_rest_state_of_springs_that_prefer_another_length():
    metric = RestState(FABRICS)
    for seed in range(2):  # the second batch has nothing new
        metric.update(step(window([0, 1, 0], seed), offset=-7.0, shift=0.002))
    assert metric.edges.tolist() == [56, 56], "of one cloth each"
    result = metric.compute()
    assert result["rest_energy_J/overall"] == pytest.approx(
        (result["rest_energy_J/silk"] + result["rest_energy_J/denim"]) / 2
    )
    assert result["rest_energy_J/silk"] == pytest.approx(7.0 - 0.5 * 300 * 0.002**2, rel=1e-6)
    assert result["rest_above_minimum_J/silk"] == pytest.approx(0.5 * 300 * 0.002**2, rel=1e-4)
    assert result["rest_above_minimum_J/denim"] == pytest.approx(0.5 * 2000 * 0.002**2, rel=1e-4)
    corner = torch.tensor([1.0, -1.0]) * 300 * 0.002  # two straight edges; the largest is at a corner with a diagonal
    diagonal = torch.tensor([0.5**0.5, -(0.5**0.5)]) * 300 * 0.002
    assert result["rest_force_N/silk"] == pytest.approx((corner + diagonal).norm().item(), rel=1e-3)
    assert result["rest_force_N/overall"] == pytest.approx(result["rest_force_N/denim"])


def test_rest_state_of_springs_at_their_length():
    metric = RestState(FABRICS)
    metric.update(step(window([0])))
    assert max(metric.compute().values()) < 1e-6


def test_stretch_stiffness_of_springs_is_their_constant():
    metric = StretchStiffness(FABRICS, tension={"silk": 5.0, "denim": 40.0, "wool": 1.0})
    metric.update(step(window([0, 1, 1])))
    result = metric.compute()
    mean_length = square_grid(1.0, 5).rest_lengths.mean()
    for name, k in STIFFNESS.items():
        assert result[f"stretch_stiffness_N_per_m/{name}"] == pytest.approx(k)
        assert result[f"stretch_secant_N_per_m/{name}"] == pytest.approx(k)
    assert result["blender_stiffness_N_per_m/silk"] == pytest.approx(5.0 * 900 / mean_length)
    assert result["stretch_stiffness_ratio/denim"] == pytest.approx(2000 / (40.0 * 900 / mean_length))


def test_secant_leaves_the_tail_out():
    """Nine edges of small strain with slope 3 and intercept 1, one far away with another slope."""
    x = torch.arange(1.0, 10.0)
    y = 1.0 + 3.0 * x
    central = torch.stack([torch.ones(9), x, y, x * x, x * y], -1)
    far = torch.tensor([[1.0, 1e3, -1e6, 1e6, -1e9]])
    assert secant(torch.cat([central, far]).double()).item() == pytest.approx(3.0)


class Half:
    """A loss for which every second vertex is violated, after it has used the random numbers."""

    def rise(self, step):
        vertices = torch.arange(step.window.mesh.num_vertices)
        torch.rand(7)
        return vertices, torch.where(vertices % 2 == 0, -1.0, 1.0)


def test_share_of_violated_inequalities_leaves_the_generator_alone():
    metric = ContrastiveViolations(FABRICS, Half())
    state = torch.get_rng_state()
    metric.update(step(window([0, 1])))
    assert torch.equal(state, torch.get_rng_state())
    result = metric.compute()
    assert result["violated_share/silk"] == pytest.approx(13 / 25)
    assert result["violated_share/denim"] == pytest.approx(12 / 25)
    assert result["violated_share/overall"] == pytest.approx(0.5)


def test_every_batch_has_displacements_of_its_own():
    """From the seed and the number of the batch: unlike each other, and the same in the next evaluation."""
    drawn = []

    class Drawing:
        def rise(self, step):
            drawn.append(float(torch.rand(())))
            return torch.arange(2), torch.tensor([1.0, -1.0])

    for _ in range(2):
        metric = ContrastiveViolations(FABRICS, Drawing())
        for _ in range(2):
            metric.update(step(window([0])))
    assert drawn[0] != drawn[1]
    assert drawn[:2] == drawn[2:]


def test_secants_are_those_of_the_deformations_at_t_plus_1():
    """Springs of 300 N/m that are twice as stiff beyond 5 mm: at t cloth is slack, at t+1 stretched by 10 %."""

    class Stiffening(Springs):
        def energies(self, inputs, attributes):
            stretch = inputs[:, 0]
            return 0.5 * attributes[:, 0] * torch.where(stretch > 0.005, 2.0, 1.0) * stretch**2

    still = at_rest(window([0]))
    stretched = replace(still, x=1.001 * still.x, x_next=1.1 * still.x)
    metric = StretchStiffness(FABRICS, tension={"silk": 5.0, "denim": 40.0})
    metric.update(StepEnergies(EUNet(Stiffening()), stretched, training=False))
    assert metric.compute()["stretch_secant_N_per_m/silk"] == pytest.approx(600.0)
    assert metric.compute()["stretch_stiffness_N_per_m/silk"] == pytest.approx(300.0)


def test_names_of_fabrics_are_checked():
    with pytest.raises(DrapeError, match="expected different names"):
        EnergyError(("silk", "silk"))
    with pytest.raises(DrapeError, match="overall"):
        EnergyError(("overall",))
    with pytest.raises(DrapeError, match=r"no tension stiffness of \['denim'\]"):
        StretchStiffness(FABRICS, tension={"silk": 1.0})
