"""The compiled energy of a baked law is the one that tensors give, on every kind of cloth; and it is faster."""

from __future__ import annotations

import copy
import functools

import numpy as np
import pytest
import torch
from torch import Tensor

from drape import compiled as compiled_code
from drape.compiled import BLOCK, compiled
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.hinge_law import HingeLaw
from drape.energy.step import Step
from drape.energy.term import EnergyTerm
from drape.energy.terms.hinge_elastic import HingeElastic
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.linalg.stencil_sum import Filled
from tests.conftest import bent
from tests.terms import assembled, baked, converted, make_step, written_out


class ByTensors(HingeLaw):
    """The potential of a table, which nothing is compiled for."""

    def __init__(self, law: BakedHinges):
        super().__init__(law.face_area, law.damper, law.drag)
        self.law = law

    def potential(self, q: Tensor) -> Tensor:
        return self.law.potential(q)


def curved() -> ClothMesh:
    """A cloth with lengths and angles of its own at rest; its number of edges is no multiple of the blocks'."""
    flat = square_grid(1.0, 9)
    mesh = ClothMesh.from_faces(bent(torch.tensor(flat.rest_positions), 0.2).numpy(), flat.faces)
    assert mesh.num_edges % BLOCK
    return mesh


def triangle() -> ClothMesh:
    """Boundaries only."""
    return ClothMesh.from_faces(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.1, 0.2, 0.0]]), np.array([[0, 1, 2]]))


MESHES = {
    "uniform": lambda: [square_grid(1.0, 7)],
    "alternating": lambda: [square_grid(1.0, 8, "alternating")],
    "curved at rest, and another": lambda: [curved(), square_grid(0.7, 5)],
    "triangle": lambda: [triangle()],
    "triangles": lambda: [triangle(), triangle()],
}


@functools.cache
def scene(name: str) -> tuple[Step, Tensor]:
    return make_step(*MESHES[name]())


def places(name: str) -> dict[str, Tensor]:
    """Where the cloths of a scene may be."""
    step, x_next = scene(name)
    rest, noise = step.mesh.rest_positions, torch.randn(x_next.shape, dtype=torch.float64)
    size = float(step.mesh.length_scale)
    merged = x_next.clone()
    merged[0] = merged[1]
    onto_edge = x_next.clone()
    onto_edge[2] = 0.5 * (onto_edge[0] + onto_edge[1])
    near_edge = x_next.clone()
    near_edge[2] = torch.lerp(onto_edge[2], near_edge[2], 5e-3)
    return {
        "moving": x_next,
        "rest": rest,
        "near rest": rest + 1e-4 * size * noise,
        "crumpled": rest + 0.3 * size * noise,
        "scrambled": size * noise,
        "torn": rest + 300.0 * size * noise,
        "folded": torch.stack([rest[:, 0].abs(), rest[:, 1], rest[:, 2]], 1) + 1e-2 * size * noise,
        "folded onto itself": torch.stack([rest[:, 0].abs(), rest[:, 1], rest[:, 2]], 1),
        "merged": merged,
        "corner on an edge": onto_edge,
        "corner near an edge": near_edge,
        "line": rest * torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64),
        "point": torch.zeros_like(rest),
    }


PLACES = list(places("triangle"))
every_mesh = pytest.mark.parametrize("name", MESHES)
either = pytest.mark.parametrize("transfer", [False, True])


def both(transfer: bool) -> tuple[EnergyTerm, EnergyTerm]:
    """A term that is compiled, and the same term by tensors."""
    return HingeElastic(baked(), transfer=transfer), HingeElastic(ByTensors(baked()), transfer=transfer)


def difference(got: Tensor, expected: Tensor) -> float:
    """The largest, relative to the largest; where there is nothing, to a thousandth of a joule, newton or N/m."""
    return float((got.double() - expected).abs().max() / expected.abs().max().clamp(min=1e-3))


@either
@every_mesh
@pytest.mark.parametrize("place", PLACES)
def test_the_numbers_are_those_of_tensors(name, place, transfer):
    """Energies, gradients and every block of the Hessian: sums in another order are all that differs."""
    (step, _), x = scene(name), places(name)[place]
    fast, slow = both(transfer)
    found, expected = fast.energy_and_gradient(x, step), slow.energy_and_gradient(x, step)
    assert fast._tables is not None
    assert slow._tables is None
    assert [len(part) for part in found] == [step.mesh.num_meshes, len(x)]
    assert difference(fast.energy_and_gradient(x, step)[0], slow(x, step)) < 1e-10
    assert difference(found[0], expected[0]) < 1e-10
    assert difference(found[1], expected[1]) < 1e-10
    pieces = fast.stencils(x, step)
    assert isinstance(pieces[0], Filled)
    ((vertices, blocks),), ((expected_vertices, expected_blocks),) = written_out(pieces), slow.stencils(x, step)
    assert torch.equal(vertices, expected_vertices)
    assert difference(blocks, expected_blocks) < 1e-10


@either
def test_the_law_is_not_silent_there(transfer):
    """What the comparison above is of: all kinds of edges of all scenes are stretched, and bent where they can be."""
    for name in MESHES:
        step, x = scene(name)
        energy, gradient = both(transfer)[0].energy_and_gradient(x, step)
        assert energy.min() > 1e-3
        assert gradient.norm(dim=1).min() > 1e-3


@every_mesh
def test_single_precision_positions(name):
    """Only the gradient is rounded, at the end: 6e-8 of each component."""
    step, x_next = scene(name)
    energy, gradient = both(True)[0].energy_and_gradient(x_next.float(), converted(step, torch.float32))
    assert (energy.dtype, gradient.dtype) == (torch.float64, torch.float32)
    expected = both(True)[1].energy_and_gradient(x_next.float().double(), step)
    assert difference(energy, expected[0]) < 1e-10
    assert difference(gradient, expected[1]) < 1e-7


def test_a_table_in_single_precision_is_summed_in_double():
    """Coefficients are rounded to 6e-8, and nothing else is."""
    step, x_next = scene("curved at rest, and another")
    law = copy.deepcopy(baked()).float()
    found = HingeElastic(law, transfer=True).energy_and_gradient(x_next, step)
    expected = both(True)[1].energy_and_gradient(x_next, step)
    assert 1e-12 < max(difference(*pair) for pair in zip(found, expected, strict=True)) < 1e-6
    again = HingeElastic(ByTensors(law.double()), transfer=True).energy_and_gradient(x_next, step)
    assert max(difference(*pair) for pair in zip(found, again, strict=True)) < 1e-10


@either
@pytest.mark.parametrize("place", ["moving", "near rest", "crumpled", "folded", "corner near an edge"])
def test_the_gradient_is_that_of_the_energy(place, transfer):
    """By autograd through tensors, and by differences of the compiled energy itself."""
    name = "curved at rest, and another"
    (step, _), x = scene(name), places(name)[place]
    fast, _ = both(transfer)
    _, gradient = fast.energy_and_gradient(x, step)
    moved = x.clone().requires_grad_()
    assert difference(gradient, torch.autograd.grad(fast(moved, step).sum(), moved)[0]) < 1e-9
    direction = torch.randn(x.shape, dtype=x.dtype)
    h = 1e-7
    ends = [fast.energy_and_gradient(x + side * h * direction, step)[0].sum() for side in (-1, 1)]
    torch.testing.assert_close((ends[1] - ends[0]) / (2 * h), (gradient * direction).sum(), rtol=1e-5, atol=1e-6)


@either
@every_mesh
def test_the_hessian_has_no_negative_direction(name, transfer):
    step, _ = scene(name)
    for x in places(name).values():
        ((_, blocks),) = written_out(both(transfer)[0].stencils(x, step))
        pieces = blocks.reshape(len(blocks), 12, 12)
        assert (torch.linalg.eigvalsh(pieces)[:, 0] >= -1e-11 * pieces.abs().amax((1, 2))).all()


@either
@pytest.mark.parametrize("name", ["uniform", "curved at rest, and another"])
def test_the_hessian_at_rest_is_the_true_one(name, transfer):
    """Nothing is pulled and nothing is projected: the second derivative, by autograd; and so it is in an instant."""
    step, _ = scene(name)
    term, rest = both(transfer)[0], step.mesh.rest_positions
    true = torch.autograd.functional.hessian(lambda x: term(x, step).sum(), rest).reshape(rest.numel(), -1)
    assert difference(assembled(term.stencils(rest, step), len(rest)), true) < 1e-9


def test_tension_and_compression_count_by_their_size():
    """``|∂φp/∂l|/l`` across each edge: of a stretched triangle the true Hessian, of a compressed one not."""
    step, _ = scene("triangle")
    term, rest = both(False)[0], step.mesh.rest_positions
    for size, tense in ((1.05, True), (0.95, False)):
        x = size * rest
        true = torch.autograd.functional.hessian(lambda x: term(x, step).sum(), x).reshape(9, 9)
        ((_, blocks),) = written_out(term.stencils(x, step))
        found = assembled(term.stencils(x, step), 3)
        assert (difference(found, true) < 1e-9) == tense
        upright = blocks[:, 0, 2, 0, 2]
        pull = term.law.slopes(torch.stack([(size - 1.0) * step.mesh.rest_lengths, torch.zeros(3).double()], 1))
        torch.testing.assert_close(upright, pull.gradient[:, 0].abs() / (size * step.mesh.rest_lengths))


@either
def test_turning_and_moving_changes_nothing(transfer):
    step, x = scene("curved at rest, and another")
    term = both(transfer)[0]
    turn, _ = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))
    turn = turn * torch.det(turn)
    energy, gradient = term.energy_and_gradient(x, step)
    other, turned = term.energy_and_gradient(x @ turn.T + torch.tensor([3.0, -2.0, 7.0]).double(), step)
    assert difference(other, energy) < 1e-10
    assert difference(turned, gradient @ turn.T) < 1e-10
    matrix, moved = (assembled(term.stencils(place, step), len(x)) for place in (x, x @ turn.T))
    every = torch.block_diag(*[turn] * len(x))
    assert difference(moved, every @ matrix @ every.T) < 1e-9


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e200])
@pytest.mark.parametrize("vertex", [0, 40, -1])
def test_nothing_hides_what_is_not_a_number(bad, vertex):
    """Of the cloth that has it; the other's energy and forces are what they were."""
    step, x_next = scene("curved at rest, and another")
    whole = both(True)[0].energy_and_gradient(x_next, step)
    broken = x_next.clone()
    broken[vertex, 1] = bad
    term, cloth = both(True)[0], int(step.mesh.mesh_of_vertex[vertex])
    energy, gradient = term.energy_and_gradient(broken, step)
    assert not torch.isfinite(energy[cloth])
    assert energy[1 - cloth] == whole[0][1 - cloth]
    others = step.mesh.mesh_of_vertex == 1 - cloth
    assert torch.equal(gradient[others], whole[1][others]) or vertex == 0  # edges that fill up a block have its first
    assembled(term.stencils(broken, step), len(broken))


def test_another_cloth_and_another_precision():
    """A term that has seen one cloth forgets it, and a law may change its precision."""
    law = copy.deepcopy(baked())
    term = HingeElastic(law, transfer=True)
    for name, dtype in (("triangles", torch.float64), ("triangles", torch.float32), ("uniform", torch.float64)):
        law.to(dtype)
        step, x_next = scene(name)
        found, expected = (
            each.energy_and_gradient(x_next, step) for each in (term, HingeElastic(ByTensors(law), transfer=True))
        )
        assert max(difference(*pair) for pair in zip(found, expected, strict=True)) < 1e-10


def test_only_for_tables_and_the_processor():
    fast, slow = both(False)
    mesh = MeshBatch.from_meshes([triangle()])
    edges, x = fast.edges(mesh), torch.zeros(3, 3)
    assert fast._compiled(edges, x) is not None
    assert fast._compiled(edges, x.to("meta")) is None
    assert slow._compiled(edges, x) is None


@compiled
def _functions(x, y, out):
    for k in range(len(x)):
        out[0, k] = compiled_code.arctangent2(y[k], x[k])
        out[1, k] = compiled_code.logarithm(abs(y[k]))


def test_functions():
    """To some units in the last place; angles in all quadrants and on the axes, sizes over many orders."""
    x, y = np.random.default_rng(0).normal(size=(2, 20_000)) * 10.0 ** np.random.default_rng(1).uniform(-8, 8, (2, 1))
    special = np.array([[1.0, 1.0, -1.0, 0.0, 0.0, 1.0, -1.0], [1e-300, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]])
    x, y = np.concatenate([x, 10.0 ** np.arange(-7.0, 7.0), special[0]]), np.concatenate([y, np.ones(14), special[1]])
    out = np.empty((2, len(x)))
    _functions(x, y, out)
    np.testing.assert_allclose(out, np.stack([np.arctan2(y, x), np.log(abs(y))]), rtol=1e-14, atol=3e-15)
    zero, found = np.zeros(3), np.empty((2, 3))
    _functions(np.array([0.0, 1.0, -1.0]), zero, found)
    np.testing.assert_allclose(found[0], [0.0, 0.0, np.pi])


def test_compiled_without_a_place_to_keep_it():
    names = {}
    exec(compile("def twice(x):\n    return 2.0 * x", "<nowhere>", "exec"), names)
    assert compiled(names["twice"])(1.5) == 3.0
