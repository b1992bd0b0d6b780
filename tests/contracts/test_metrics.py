"""What every metric of an energy promises: no dependence on batches and processes, and values per fabric."""

import re
from dataclasses import replace
from functools import partial

import pytest
import torch
from omegaconf import OmegaConf
from torchmetrics import MetricCollection

from drape.config import instantiate
from drape.config.resolvers import CONF
from drape.data.windows import Window
from drape.energy.law.deformation import StretchBending
from drape.energy.law.eunet import EUNet
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.law.step_energies import StepEnergies
from drape.energy.law.units import DissipationUnits, PotentialUnits
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh_batch import MeshBatch
from drape.metrics.family import energy_metrics
from drape.metrics.stiffness import StretchStiffness

FABRICS = ("silk", "leather", "denim", "cotton")
TENSION = {"silk": 5.0, "leather": 80.0, "denim": 40.0, "cotton": 15.0}
PER_MESH = ("attributes", "fabric")
PER_VERTEX = ("x_prev", "x", "x_next", "mass", "free")


class Springs(PotentialUnits):
    def __init__(self):
        super().__init__(StretchBending())

    def energies(self, inputs, attributes):
        bending = 0.1 * (1.0 - inputs[:, 1])
        return 0.01 + 0.5 * (1.0 + attributes[:, 0]) * (inputs[:, 0] - 0.001) ** 2 + bending


class Drag(DissipationUnits):
    def inputs(self, geometry, previous, dt):
        return (geometry.midpoint - previous.midpoint) / dt

    def energies(self, inputs, attributes):
        potential = 1e-3 * (1.0 + attributes[:, 0]) * inputs.square().sum(-1)
        return potential, 2.0 * potential

    def drag(self, speed, attributes):
        return 0.0 * speed


class Alternating:
    """Stands for the contrastive loss: the sign of the rise is that of the inertial force, nothing is drawn."""

    def rise(self, step):
        vertices = step.window.free.nonzero()[:, 0]
        return vertices, step.window.inertial_force[vertices, 0]


def window(fabrics: list[int], seed: int) -> Window:
    generator = torch.Generator().manual_seed(seed)
    mesh = MeshBatch.from_meshes([square_grid(1.0, 5)] * len(fabrics))
    frames = [
        mesh.rest_positions + 0.02 * torch.randn(mesh.num_vertices, 3, generator=generator, dtype=torch.float64)
        for _ in range(3)
    ]
    fabric = torch.tensor(fabrics)
    free = torch.ones(25, dtype=torch.bool)
    free[[0, 4]] = False
    return Window(
        mesh=mesh,
        x_prev=frames[0],
        x=frames[1],
        x_next=frames[2],
        mass=(0.1 + 0.2 * fabric).double().repeat_interleave(25),
        free=free.repeat(len(fabrics)),
        attributes=1000.0 * (1.0 + fabric[:, None].double()).repeat(1, 5),
        fabric=fabric,
        gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64),
        dt=1 / 30,
    )


def pick(batch: Window, meshes: list[int]) -> Window:
    """Some of the cloths of a batch as a batch of their own."""
    vertices = torch.cat([torch.arange(25 * k, 25 * (k + 1)) for k in meshes])
    parts = {name: getattr(batch, name)[meshes] for name in PER_MESH}
    parts |= {name: getattr(batch, name)[vertices] for name in PER_VERTEX}
    return replace(batch, mesh=MeshBatch.from_meshes([square_grid(1.0, 5)] * len(meshes)), **parts)


BATCH = window([0, 1, 1, 3, 0, 3, 3], seed=3)
"""Leather twice, denim never."""
LAW = SpringHingeLaw.fit([(window([0, 1, 3, 2], seed=k),) for k in range(3)], len(FABRICS))


def collection() -> MetricCollection:
    """Those of the configuration, where nothing is drawn."""
    makers = instantiate(OmegaConf.load(CONF / "metrics" / "energy.yaml"))
    makers["violations"] = partial(makers["violations"], loss=Alternating())
    return energy_metrics(makers, {"fabrics": FABRICS, "tension": TENSION, "law": LAW})


def family() -> dict:
    return dict(collection().items())


METRICS = sorted(family())


def evaluate(metric, batches: list[Window]):
    for batch in batches:
        metric.update(StepEnergies(EUNet(Springs(), Drag()), batch, training=False))
    return metric


def close(result: dict[str, float]):
    return pytest.approx(result, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", METRICS)
@pytest.mark.parametrize("split", [[[0, 1, 2], [3, 4, 5, 6]], [[6], [2], [0], [1], [4], [5], [3]]])
def test_size_and_order_of_batches_do_not_matter(name, split):
    whole = evaluate(family()[name], [BATCH]).compute()
    assert evaluate(family()[name], [pick(BATCH, meshes) for meshes in split]).compute() == close(whole)


@pytest.mark.parametrize("name", METRICS)
def test_a_fabric_has_the_value_of_its_own_windows(name):
    whole = evaluate(family()[name], [BATCH]).compute()
    for number, fabric in enumerate(FABRICS):
        meshes = [k for k, f in enumerate(BATCH.fabric.tolist()) if f == number]
        own = evaluate(family()[name], [pick(BATCH, meshes)]).compute() if meshes else {}
        of_fabric = {key: value for key, value in whole.items() if key.endswith(f"/{fabric}")}
        assert of_fabric == close({key: value for key, value in own.items() if not key.endswith("/overall")})
        assert bool(of_fabric) == bool(meshes)


@pytest.mark.parametrize("name", METRICS)
def test_states_of_processes_add_up(name):
    whole = evaluate(family()[name], [BATCH]).compute()
    first = evaluate(family()[name], [pick(BATCH, [0, 1, 2])])
    second = evaluate(family()[name], [pick(BATCH, [3, 4, 5, 6])])
    reduce = first._reductions
    for state in first._defaults:
        values = torch.stack([getattr(first, state), getattr(second, state)])
        assert values.dtype == torch.float64
        setattr(first, state, reduce[state](values))
    assert first.compute() == close(whole)


@pytest.mark.parametrize("name", METRICS)
def test_reset_forgets(name):
    metric = evaluate(family()[name], [BATCH])
    whole = metric.compute()
    metric.reset()
    assert evaluate(metric, [BATCH]).compute() == close(whole)


@pytest.mark.parametrize("name", METRICS)
def test_keys_and_values(name):
    result = evaluate(family()[name], [BATCH]).compute()
    assert result
    for key, value in result.items():
        assert re.fullmatch(r"[a-z0-9]+(_[A-Za-z0-9]+)+/[a-z]+", key), key
        assert isinstance(value, float)
        assert value == value
    assert any(value > 0 for value in result.values())


@pytest.mark.parametrize("name", METRICS)
def test_nothing_is_changed_by_measuring(name):
    before = {name: getattr(BATCH, name).clone() for name in (*PER_MESH, *PER_VERTEX)}
    generator = torch.get_rng_state()
    evaluate(family()[name], [BATCH])
    assert torch.equal(generator, torch.get_rng_state())
    for field, value in before.items():
        assert torch.equal(getattr(BATCH, field), value)


def test_the_family_gives_one_flat_dictionary():
    together = collection()
    together.update(StepEnergies(EUNet(Springs(), Drag()), BATCH, training=False))
    result = together.compute()
    separate = {}
    for name in METRICS:
        separate |= evaluate(family()[name], [BATCH]).compute()
    assert dict(result) == close(separate)


def test_what_a_metric_asks_for_in_vain_is_named():
    makers = {"mine": partial(StretchStiffness, fabrics=FABRICS)}
    with pytest.raises(DrapeError, match=r"metrics\.mine: found no value for tension; expected .* only give fabrics$"):
        energy_metrics(makers, {"fabrics": FABRICS})
