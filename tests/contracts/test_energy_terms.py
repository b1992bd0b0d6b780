"""What holds for every summand of an incremental potential."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.energy.term import Stencils
from drape.linalg.stencil_sum import Filled, StencilSum
from tests.terms import TERMS, assembled, converted, make_step, moved, renumbered, written_out

every_term = pytest.mark.parametrize("name", TERMS)
elastic_terms = pytest.mark.parametrize("name", [name for name, member in TERMS.items() if member.elastic])
exact_terms = pytest.mark.parametrize("name", [name for name, member in TERMS.items() if member.exact])


def rotation() -> torch.Tensor:
    turn, _ = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))
    return turn * torch.det(turn)


@every_term
def test_gradient(name, small_cloth):
    """The gradient of the energy agrees with finite differences, and is not zero."""
    term = TERMS[name].make()
    step, x_next = make_step(small_cloth)
    x = x_next.clone().requires_grad_()
    assert torch.autograd.grad(term(x, step).sum(), x)[0].norm() > 1e-9
    assert torch.autograd.gradcheck(lambda x: term(x, step), x, atol=1e-7, rtol=1e-5)


@every_term
def test_only_the_price_of_a_motion_asks_where_it_began(name, small_cloth):
    """Of two ends of a step, stored energies differ by the same wherever the step began."""
    term = TERMS[name].make()
    step, x_next = make_step(small_cloth)
    x = step.x + 1e-3 * torch.sin(40.0 * step.x.roll(1, -1))
    elsewhere = replace(step, x=x)
    if term.stores:  # the faces that a step searches at its start are those of the body; slip begins on them
        elsewhere = elsewhere.with_near(step.near, step.surface)
    other = x_next + 1e-3 * torch.cos(30.0 * x_next.roll(1, -1))
    here, there = (float((term(other, one) - term(x_next, one)).detach().sum()) for one in (step, elsewhere))
    assert here != 0.0
    assert (abs(here - there) < 1e-9 * abs(here)) is term.stores


@every_term
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_fast_gradient_is_that_of_autograd(name, dtype, cloth, small_cloth):
    """``energy_and_gradient`` returns the energy of ``forward`` and its gradient, without a graph."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth, small_cloth, dtype=dtype)
    x = x_next.clone().requires_grad_()
    energy = term(x, step)
    (gradient,) = torch.autograd.grad(energy.sum(), x)
    fast_energy, fast_gradient = term.energy_and_gradient(x, step)
    assert not fast_energy.requires_grad
    assert not fast_gradient.requires_grad
    assert fast_gradient.dtype == dtype
    tolerance = 1e-9 if dtype == torch.float64 else 1e-4
    torch.testing.assert_close(fast_energy, energy.detach(), rtol=tolerance, atol=0.0)
    assert (fast_gradient - gradient).norm() < tolerance * gradient.norm()


@every_term
def test_the_kernel_is_the_term(name, cloth, small_cloth):
    """Energy and gradient without tensors are those with them, in double precision whatever the step is in."""
    for dtype in (torch.float64, torch.float32):
        step, x_next = make_step(cloth, small_cloth, dtype=dtype)
        term = TERMS[name].make()
        kernel = term.kernel(step)
        if kernel is None:
            return
        energy, gradient = kernel(x_next.double().numpy())
        expected, slope = term.energy_and_gradient(x_next, step)
        tolerance = 1e-12 if dtype == torch.float64 else 1e-4
        assert energy == pytest.approx(float(expected.sum()), rel=tolerance)
        assert np.linalg.norm(gradient - slope.numpy()) <= tolerance * float(slope.norm())


@every_term
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_stencils_are_positive_semidefinite(name, dtype, cloth):
    """Each piece is symmetric without negative eigenvalues, in motion, compressed and scrambled."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth, dtype=dtype)
    rounding = 1e-11 if dtype == torch.float64 else 1e-4
    for x in (x_next, 0.1 * x_next, torch.randn_like(x_next), step.mesh.rest_positions.to(dtype)):
        for piece in term.stencils(x, step):
            assert isinstance(piece, Filled) or piece.blocks.dtype == dtype
            ((vertices, blocks),) = written_out([piece])
            assert blocks.shape == (len(vertices), vertices.shape[1], 3, vertices.shape[1], 3)
            size = 3 * vertices.shape[1]
            pieces = blocks.reshape(-1, size, size)
            largest = pieces.abs().amax((1, 2))
            assert ((pieces - pieces.mT).abs().amax((1, 2)) <= rounding * largest).all()
            assert (torch.linalg.eigvalsh(pieces)[:, 0] >= -rounding * largest).all()


@exact_terms
def test_stencils_are_the_hessian(name, small_cloth):
    """Where the term promises it, the pieces add up to the second derivative."""
    member = TERMS[name]
    term = member.make()
    step, x_next = make_step(small_cloth)
    x = member.exact(step, x_next)
    hessian = torch.autograd.functional.hessian(lambda x: term(x, step).sum(), x).reshape(x.numel(), x.numel())
    found = assembled(term.stencils(x, step), len(x))
    assert (found - hessian).abs().max() <= 1e-8 * hessian.abs().max()


@every_term
def test_moving_the_scene_changes_nothing(name, cloth, small_cloth):
    """Cloth, body, gravity and forces turned and moved together: the same energy, forces turned."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth, small_cloth)
    turn, shift = rotation(), torch.tensor([1.0, -2.0, 3.0], dtype=torch.float64)
    energy, gradient = term.energy_and_gradient(x_next, step)
    other, turned = term.energy_and_gradient(x_next @ turn.T + shift, moved(step, turn, shift))
    torch.testing.assert_close(other, energy, rtol=1e-9, atol=1e-14)
    assert (turned - gradient @ turn.T).norm() < 1e-8 * gradient.norm()


@elastic_terms
def test_elastic_energy_ignores_rigid_motion(name, cloth):
    """Turning and moving the cloth alone changes no elastic energy."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth)
    other = term(x_next @ rotation().T + 3.0, step)
    torch.testing.assert_close(other, term(x_next, step), rtol=1e-9, atol=1e-14)


@elastic_terms
def test_elastic_forces_have_no_sum(name, cloth):
    """The cloth pushes itself nowhere and turns itself nowhere."""
    step, x_next = make_step(cloth)
    _, gradient = TERMS[name].make().energy_and_gradient(x_next, step)
    assert gradient.norm() > 0
    assert gradient.sum(0).norm() < 1e-9 * gradient.norm()
    assert torch.linalg.cross(x_next, gradient).sum(0).norm() < 1e-9 * gradient.norm()


@elastic_terms
def test_no_elastic_energy_at_rest(name, cloth):
    """The rest state, wherever it lies, stores nothing and pulls nowhere."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth)
    scale, forces = term.energy_and_gradient(x_next, step)
    energy, gradient = term.energy_and_gradient(step.mesh.rest_positions @ rotation().T + 1.0, step)
    assert energy.item() < 1e-9 * scale.item()
    assert gradient.norm() < 1e-9 * forces.norm()


@elastic_terms
def test_crumpled_cloth_meets_no_cliff(name, cloth):
    """Between two crumpled states, where normals pass through edges and folds close, the energy has kinks at most.

    Where it is least explained by its slopes the interval is halved thirty times: a cliff would stay as high.
    """
    term = TERMS[name].make()
    step, _ = make_step(cloth)
    noise = 0.5 * float(step.mesh.rest_lengths.mean())
    torch.manual_seed(3)
    first, last = (step.mesh.rest_positions + noise * torch.randn_like(step.x) for _ in range(2))

    @functools.cache
    def at(place: float) -> tuple[float, float]:
        energy, gradient = term.energy_and_gradient(first + place * (last - first), step)
        return energy.item(), (gradient * (last - first)).sum().item()

    def unexplained(low: float, high: float) -> float:
        (here, slope), (there, other) = at(low), at(high)
        return abs(there - here - 0.5 * (slope + other) * (high - low))

    low, high = max(itertools.pairwise(k / 128 for k in range(129)), key=lambda ends: unexplained(*ends))
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if unexplained(low, middle) > unexplained(middle, high) else (middle, high)
    assert unexplained(low, high) < 1e-7 * at(low)[0]


@every_term
def test_batch_is_as_single(name, cloth, small_cloth):
    """Two meshes in one batch have the energies, forces and stiffness that they have alone."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth, small_cloth)
    energy, gradient = term.energy_and_gradient(x_next, step)
    matrix = assembled(term.stencils(x_next, step), len(x_next))
    count = cloth.num_vertices
    for number, (mesh, part) in enumerate(((cloth, slice(0, count)), (small_cloth, slice(count, None)))):
        one, end = make_step(mesh)
        alone, forces = term.energy_and_gradient(end, one)
        torch.testing.assert_close(energy[number : number + 1], alone, rtol=1e-8, atol=1e-14)
        assert (gradient[part] - forces).norm() < 1e-8 * forces.norm()
        expected = assembled(term.stencils(end, one), len(end))
        rows = slice(3 * part.start, 3 * part.stop if part.stop else None)
        assert (matrix[rows, rows] - expected).abs().max() <= 1e-8 * expected.abs().max()


@every_term
def test_order_of_vertices_does_not_matter(name, cloth):
    """Renumbering vertices and faces leaves energy and forces as they are."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth)
    order = torch.randperm(cloth.num_vertices)
    energy, gradient = term.energy_and_gradient(x_next, step)
    other, forces = term.energy_and_gradient(x_next[order], renumbered(step, order))
    torch.testing.assert_close(other, energy, rtol=1e-9, atol=1e-14)
    assert (forces - gradient[order]).norm() < 1e-9 * gradient.norm()


@every_term
def test_single_precision_is_close(name, cloth):
    """Positions in float32 give energy and forces of float64 to 0.1 %."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth)
    energy, gradient = term.energy_and_gradient(x_next, step)
    other, forces = term.energy_and_gradient(x_next.float(), converted(step, torch.float32))
    torch.testing.assert_close(other.double(), energy, rtol=1e-3, atol=0.0)
    assert (forces.double() - gradient).norm() < 1e-3 * gradient.norm()


@every_term
def test_far_from_the_origin(name, cloth):
    """At 10 km the energy and the forces are those at the origin to 1e-6."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth)
    shift = torch.tensor([1e4, -1e4, 1e4], dtype=torch.float64)
    energy, gradient = term.energy_and_gradient(x_next, step)
    other, forces = term.energy_and_gradient(x_next + shift, moved(step, torch.eye(3, dtype=torch.float64), shift))
    torch.testing.assert_close(other, energy, rtol=1e-6, atol=0.0)
    assert (forces - gradient).norm() < 1e-6 * gradient.norm()


def degenerate(rest: torch.Tensor, body: torch.Tensor) -> dict[str, torch.Tensor]:
    """Cloths that no simulation should see, and every simulation does see."""
    merged = rest.clone()
    merged[0] = merged[1]
    on_edges = 0.5 * (body[:-1] + body[1:])
    return {
        "folded": torch.stack([rest[:, 0].abs(), rest[:, 1], rest[:, 2]], -1),
        "line": rest * torch.tensor([1.0, 0.0, 0.0], dtype=rest.dtype),
        "point": torch.zeros_like(rest),
        "point_elsewhere": torch.full_like(rest, 0.1),
        "merged": merged,
        "rest": rest,
        "mirrored": rest * torch.tensor([-1.0, 1.0, 1.0], dtype=rest.dtype),
        "tiny": 1e-9 * rest,
        "huge": 1e3 * rest,
        "scrambled": torch.randn_like(rest),
        "on_body_vertices": body[: len(rest)],
        "on_body_edges": on_edges[: len(rest)],
    }


@every_term
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_finite_on_degenerate_input(name, dtype, cloth):
    """Energy, both gradients and stencils are finite for folded, collapsed, scrambled cloth and on the body itself."""
    term = TERMS[name].make()
    step, x_next = make_step(cloth, dtype=dtype)
    cases = degenerate(step.mesh.rest_positions.to(dtype), step.obstacle.x)
    for case, x in cases.items():
        for start, end in ((step.x, x), (x, x_next), (x, x)):
            one = replace(step, x=start)
            end = end.clone().requires_grad_()
            energy = term(end, one)
            (slow,) = torch.autograd.grad(energy.sum(), end)
            fast_energy, fast = term.energy_and_gradient(end, one)
            blocks = [stencils.blocks for stencils in written_out(term.stencils(end.detach(), one))]
            for value in (energy, fast_energy, slow, fast, *blocks):
                assert torch.isfinite(value).all(), case


def whole(upper) -> np.ndarray:
    """Both triangles of a matrix whose upper one is there."""
    assert abs(np.tril(upper.toarray(), -1)).max() == 0.0
    return upper.toarray() + np.triu(upper.toarray(), 1).T


@every_term
def test_both_hessians_are_positive_semidefinite(name, small_cloth):
    step, x_next = make_step(small_cloth)
    term = TERMS[name].make()
    rough = whole(term.rough_hessian(x_next, step))
    np.testing.assert_allclose(rough, assembled(term.stencils(x_next, step), len(x_next)), atol=1e-9 * abs(rough).max())
    better = term.hessian(x_next, step)
    for matrix in [rough] if better is None else [rough, whole(better)]:
        assert matrix.shape == (27, 27)
        assert np.linalg.eigvalsh(matrix).min() >= -1e-9 * max(abs(matrix).max(), 1.0)


def test_sums_of_stencils_remember_where_entries_go(small_cloth):
    """Whether the vertices are those of the last sum, others, or contacts that came and went."""
    step, x_next = make_step(small_cloth)
    terms = [TERMS[name].make() for name in ("elastic", "contact_paper", "inertia")]
    together = StencilSum()
    for used in (terms, terms, terms[:2], terms[1:], terms):
        pieces = [piece for term in used for piece in term.stencils(x_next, step)]
        alone = [not isinstance(piece, Filled) and piece[0].shape[1] == 1 for piece in pieces]
        pieces = [Stencils(*(e[:5] for e in p)) if one else p for p, one in zip(pieces, alone, strict=True)]
        expected = assembled(pieces, len(x_next))
        np.testing.assert_allclose(whole(together.upper(pieces, len(x_next))), expected, atol=1e-9 * expected.max())


@pytest.mark.parametrize("name", ["baked", "baked, transferred"])
def test_stencils_that_add_themselves_are_as_those_written_out(name, small_cloth):
    """Alone and among others, again, and where the same vertices come in the other form or in another order."""
    step, x_next = make_step(small_cloth)
    terms = [TERMS[other].make() for other in ("elastic", "inertia", "bending")]
    others = [piece for term in terms for piece in term.stencils(x_next, step)]
    filled = TERMS[name].make().stencils(x_next, step)
    assert all(isinstance(piece, Filled) for piece in filled)
    plain, together = written_out(filled), StencilSum()
    for pieces in (filled, [*others, *filled], [*others, *filled], [*others, *plain], [*others, *filled, *filled]):
        expected = StencilSum().upper(written_out(pieces), len(x_next)).toarray()
        np.testing.assert_allclose(together.upper(pieces, len(x_next)).toarray(), expected, atol=1e-12 * expected.max())


def test_the_good_hessian_of_a_learned_law_is_near_the_true_one(small_cloth):
    """At rest nothing is left out: no tension, and the law is convex there."""
    step, _ = make_step(small_cloth)
    rest = step.mesh.rest_positions
    term = TERMS["elastic"].make()
    true = torch.autograd.functional.hessian(lambda x: term(x, step).sum(), rest).reshape(27, 27).numpy()
    np.testing.assert_allclose(whole(term.hessian(rest, step)), true, atol=1e-4 * abs(true).max())
