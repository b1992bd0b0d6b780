"""The compiled energies of a baked law are those that tensors give, on every kind of cloth; and they are faster."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import drape
from drape.energy import baked_kernel_geometry, baked_kernel_law
from drape.energy.baked_file import read_baked
from drape.energy.baked_kernel import DissipationKernel, ElasticKernel
from drape.energy.baked_kernel_vectors import BLOCK, compiled
from drape.energy.dissipation import Dissipation
from drape.energy.elastic import ElasticEnergy
from drape.scene.grid import square_grid
from drape.scene.mesh import ClothMesh
from tests.conftest import bent
from tests.terms import converted, law, make_step

TABLE = Path(drape.__file__).parent / "checkpoints" / "eunet_stable_silk.npz"
LAW = read_baked(TABLE)
EXACT = read_baked(TABLE).double()
TERMS = {
    "elastic": lambda of: ElasticEnergy(of, transfer=False),
    "elastic, transferred": lambda of: ElasticEnergy(of, transfer=True),
    "dissipation": Dissipation,
}


def by_tensors(term, x_next, step, monkeypatch):
    """What the term gives where there is no kernel."""
    with monkeypatch.context() as patch:
        for kernel in (ElasticKernel, DissipationKernel):
            patch.setattr(kernel, "fits", staticmethod(lambda of, x: False))
        return term.energy_and_gradient(x_next, step)


def difference(got, expected):
    """The largest difference of energies and of gradients, relative to the largest of each."""
    return [float((a.double() - b).abs().max() / b.abs().max()) for a, b in zip(got, expected, strict=True)]


def curved() -> ClothMesh:
    """A cloth with lengths and angles of its own at rest; its number of edges is no multiple of the blocks'."""
    flat = square_grid(1.0, 9)
    mesh = ClothMesh.from_faces(bent(torch.tensor(flat.rest_positions), 0.2).numpy(), flat.faces)
    assert mesh.num_edges % BLOCK
    return mesh


@pytest.fixture(scope="module")
def scene():
    return make_step(curved(), square_grid(0.7, 5))


@pytest.mark.parametrize("name", TERMS)
def test_the_numbers_are_those_of_tensors(name, scene, monkeypatch):
    """In float64 sums in another order are all that differs: some hundred roundings of 1e-16."""
    step, x_next = scene
    term = TERMS[name](EXACT)
    got = term.energy_and_gradient(x_next, step)
    assert term._kernel is not None
    assert len(got[0]) == 2
    assert max(difference(got, by_tensors(term, x_next, step, monkeypatch))) < 1e-12


@pytest.mark.parametrize("name", TERMS)
def test_a_table_in_single_precision_is_summed_in_double(name, scene, monkeypatch):
    """Tensors sum 64 single-precision products: a few 1e-7 of the spline's part of the energy."""
    step, x_next = scene
    got = TERMS[name](LAW).energy_and_gradient(x_next, step)
    assert max(difference(got, by_tensors(TERMS[name](EXACT), x_next, step, monkeypatch))) < 1e-12
    assert max(difference(got, by_tensors(TERMS[name](LAW), x_next, step, monkeypatch))) < 2e-6


@pytest.mark.parametrize("name", TERMS)
def test_single_precision_positions(name, scene, monkeypatch):
    """Only the result is rounded: 6e-8 of each component. Displacements are exact differences of what is given."""
    step, x_next = converted(scene[0], torch.float32), scene[1].float()
    got = TERMS[name](LAW).energy_and_gradient(x_next, step)
    assert got[0].dtype == torch.float64
    assert got[1].dtype == torch.float32
    expected = by_tensors(TERMS[name](EXACT), x_next.double(), converted(step, torch.float64), monkeypatch)
    energy, gradient = difference(got, expected)
    assert energy < 1e-12
    assert gradient < 1e-7


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("amount", [0.001, 0.3, 3.0, 30.0])
def test_crumpled_and_torn(name, amount, scene, monkeypatch):
    """Angles of any size, edges far beyond the table."""
    step, x_next = scene
    x_next = step.mesh.rest_positions + amount * torch.randn(x_next.shape, dtype=x_next.dtype)
    step = replace(step, x=step.mesh.rest_positions)
    term = TERMS[name](EXACT)
    got = term.energy_and_gradient(x_next, step)
    assert max(difference(got, by_tensors(term, x_next, step, monkeypatch))) < 1e-10


@pytest.mark.parametrize("name", TERMS)
def test_rest_and_collapse(name, scene, monkeypatch):
    step, _ = scene
    term = TERMS[name](EXACT)
    for x in (step.mesh.rest_positions, torch.zeros_like(step.x), torch.tensor([0.0, 1.0, 0.0]) * step.x):
        energy, gradient = term.energy_and_gradient(x, step)
        expected = by_tensors(term, x, step, monkeypatch)
        assert torch.isfinite(gradient).all()
        torch.testing.assert_close(energy, expected[0], rtol=1e-10, atol=1e-12)
        torch.testing.assert_close(gradient, expected[1], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", TERMS)
def test_the_gradient_is_that_of_the_energy(name, scene):
    step, x_next = scene
    term = TERMS[name](LAW)
    _, gradient = term.energy_and_gradient(x_next, step)
    direction = torch.randn(x_next.shape, dtype=x_next.dtype)
    ends = [term.energy_and_gradient(x_next + h * direction, step)[0].sum() for h in (-1e-7, 1e-7)]
    torch.testing.assert_close((ends[1] - ends[0]) / 2e-7, (gradient * direction).sum(), rtol=1e-5, atol=0.0)


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e200])
def test_nothing_hides_what_is_not_a_number(name, bad, scene):
    step, x_next = scene
    x_next = x_next.clone()
    x_next[0, 1] = bad
    energy, _ = TERMS[name](LAW).energy_and_gradient(x_next, step)
    assert not torch.isfinite(energy[0])
    assert torch.isfinite(energy[1])


def test_another_cloth_and_another_precision(scene, monkeypatch):
    """A term that has seen one cloth forgets it, and a law may change its precision."""
    table = read_baked(TABLE)
    for term in (ElasticEnergy(table, transfer=True), Dissipation(table)):
        table.float()
        term.energy_and_gradient(scene[1], scene[0])
        table.double()
        step, x_next = make_step(square_grid(0.5, 4))
        expected = by_tensors(term, x_next, step, monkeypatch)
        assert max(difference(term.energy_and_gradient(x_next, step), expected)) < 1e-12


def test_only_for_tables_and_the_processor(scene):
    x = scene[1]
    for kernel in (ElasticKernel, DissipationKernel):
        assert kernel.fits(LAW, x)
        assert not kernel.fits(LAW, x.to("meta"))
        assert not kernel.fits(law(), x)


@compiled
def _functions(x, y, out):
    for k in range(len(x)):
        out[0, k] = baked_kernel_geometry.arctangent(y[k], x[k])
        out[1, k] = baked_kernel_law._asinh(x[k], np.sqrt(1.0 + x[k] * x[k]))
        out[2, k] = baked_kernel_law._expm1(-abs(x[k]))
        out[3, k], out[4, k] = baked_kernel_law._sine_cosine(np.arctan2(y[k], x[k]))


def test_functions():
    """To some units in the last place; angles in all quadrants and on the axes, sizes over many orders."""
    x, y = np.random.default_rng(0).normal(size=(2, 20_000)) * 10.0 ** np.random.default_rng(1).uniform(-8, 8, (2, 1))
    special = np.array([[0.0, 1.0, -1.0, 0.0, 0.0, 1.0, -1.0], [0.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0]])
    x, y = np.concatenate([x, 10.0 ** np.arange(-7.0, 7.0), special[0]]), np.concatenate([y, np.ones(14), special[1]])
    out = np.empty((5, len(x)))
    _functions(x, y, out)
    angle = np.arctan2(y, x)
    expected = np.stack([angle, np.arcsinh(x), np.expm1(-abs(x)), np.sin(angle), np.cos(angle)])
    np.testing.assert_allclose(out, expected, rtol=1e-14, atol=3e-15)


def test_compiled_without_a_place_to_keep_it():
    names = {}
    exec(compile("def twice(x):\n    return 2.0 * x", "<nowhere>", "exec"), names)
    assert compiled(names["twice"])(1.5) == 3.0


def test_faster_than_tensors(monkeypatch):
    """Five times and more on an idle machine; twice must remain on any."""
    step, x_next = make_step(square_grid(1.0, 60))

    def least(work):
        seconds = []
        for _ in range(10):
            start = time.perf_counter()
            work()
            seconds.append(time.perf_counter() - start)
        return min(seconds)

    for term in (ElasticEnergy(LAW, transfer=True), Dissipation(LAW)):
        kernel = least(lambda term=term: term.energy_and_gradient(x_next, step))
        tensors = least(lambda term=term: by_tensors(term, x_next, step, monkeypatch))
        print(f"{term.name}: {1e3 * kernel:.2f} ms, {1e3 * tensors:.2f} ms by tensors")
        assert 2.0 * kernel < tensors
