"""Incremental potential contact: forces, stiffness, paths without crossings, crossings and how they are undone."""

import numpy as np
import pytest
from scipy import sparse

from drape.contact.barrier import push, push_slope, stiffness_for
from drape.contact.collisions import Collisions
from drape.contact.untangle import untangle
from drape.errors import DrapeError
from drape.metrics.self_intersection import self_intersecting

REACH = 0.004
STIFFNESS = 50.0


def grid(n, size=0.3):
    a = np.linspace(-size / 2, size / 2, n)
    x, y = np.meshgrid(a, a, indexing="ij")
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1), faces


def turned(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + [0.003, 0.007, 0]


def layers(gap, n=(9, 12), rough=0.1, seed=0):
    """A sheet above a larger one, of one cloth; positions, faces, vertices of the upper sheet."""
    (upper, faces), (lower, more) = grid(n[0]), grid(n[1], 0.5)
    rest = np.concatenate([upper, turned(lower, 0.3)])
    x = rest.copy()
    x[: len(upper), 2] = gap
    x[:, 2] += rough * gap * np.random.default_rng(seed).uniform(-1, 1, len(x))
    return rest, x, np.concatenate([faces, more + len(upper)]), len(upper)


def two_layers(**options):
    rest, x, faces, upper = layers(0.5 * REACH, **options)
    return Collisions(rest, faces, self_distance=REACH, self_stiffness=STIFFNESS), x, upper


def cloth_on_body(body_distance=0.003):
    rest, x, faces, upper = layers(0.5 * REACH)
    cloth, body = faces[: 2 * 64], faces[2 * 64 :] - upper
    collisions = Collisions(
        rest[:upper], cloth, self_distance=REACH, self_stiffness=STIFFNESS, body=rest[upper:], body_faces=body,
        body_distance=body_distance, body_stiffness=STIFFNESS,
    )
    return collisions, x[:upper], x[upper:]


def differences(function, x, directions, step=1e-8):
    return np.array([(function(x + step * d) - function(x - step * d)) / (2 * step) for d in directions])


def whole(upper_triangle):
    return (upper_triangle + sparse.triu(upper_triangle, 1).T).toarray()


def test_the_push_is_the_slope_of_the_barrier():
    r = np.linspace(0.05, 0.95, 19)
    barrier = lambda r: -((1 - r**2) ** 2) * np.log(r**2)  # noqa: E731
    np.testing.assert_allclose(push(r), -(barrier(r + 1e-6) - barrier(r - 1e-6)) / 2e-6, rtol=1e-6)
    np.testing.assert_allclose(push_slope(r), (push(r + 1e-6) - push(r - 1e-6)) / 2e-6, rtol=1e-6)


@pytest.mark.parametrize("with_body", [False, True])
def test_the_gradient_is_that_of_the_energy(with_body):
    if with_body:
        collisions, x, body = cloth_on_body()
    else:
        (collisions, x, _), body = two_layers(), None
    energy, gradient = collisions.energy_and_gradient(x, body)
    directions = np.random.default_rng(1).normal(size=(5, *x.shape))
    slopes = differences(lambda y: collisions.energy_and_gradient(y, body)[0], x, directions)
    assert energy > 0
    np.testing.assert_allclose(np.einsum("dvi,vi->d", directions, gradient), slopes, rtol=1e-5)


@pytest.mark.parametrize("with_body", [False, True])
def test_the_hessian_is_positive_and_nearly_that_of_the_energy(with_body):
    if with_body:
        collisions, x, body = cloth_on_body()
    else:
        (collisions, x, _), body = two_layers(), None
    upper = collisions.hessian(x, body)
    hessian = whole(upper)
    values = np.linalg.eigvalsh(hessian)
    assert sparse.tril(upper, -1).nnz == 0
    assert values[0] > -1e-9 * values[-1]
    up = np.zeros_like(x)
    up[: 9 * 9, 2] = 1.0
    bump = up * np.cos(20 * x[:, :1])
    for d in (up, bump):
        exact = differences(lambda y: collisions.energy_and_gradient(y, body)[1], x, [d])[0].ravel() @ d.ravel()
        assert d.ravel() @ hessian @ d.ravel() == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_two_sheets_feel_the_pressure_that_was_asked_for(share):
    pressure = 0.2 * 9.81
    for n in (9, 12), (25, 40):
        rest, x, faces, upper = layers(share * REACH, n=n, rough=0.0)
        stiffness = stiffness_for(pressure, REACH, 1.14 * 0.3 / (n[0] - 1), share)
        collisions = Collisions(rest, faces, self_distance=REACH, self_stiffness=stiffness)
        force = -collisions.energy_and_gradient(x)[1][:upper, 2].sum()
        assert force / 0.3**2 == pytest.approx(pressure, rel=0.15)
    heavy = stiffness_for(500 * pressure, REACH, 0.01, share)
    assert heavy == pytest.approx(500 * stiffness_for(pressure, REACH, 0.01, share))


def test_action_is_reaction():
    collisions, x, upper = two_layers()
    _, gradient = collisions.energy_and_gradient(x)
    assert abs(gradient[:upper]).sum() > 0
    np.testing.assert_allclose(gradient[:upper].sum(0), -gradient[upper:].sum(0), rtol=1e-9)


def test_a_body_given_as_cloth_pushes_the_same():
    """Barrier between a cloth and a body is that between two parts of a cloth, up to the areas of the body's edges."""
    collisions, x, body = cloth_on_body(REACH)
    both, whole_x, upper = two_layers()
    gradient = both.energy_and_gradient(whole_x)[1][:upper]
    given = collisions.energy_and_gradient(x, body)[1]
    assert np.vdot(given, gradient) / np.vdot(gradient, gradient) == pytest.approx(1.0, rel=0.5)


def test_a_floor_of_two_triangles_is_no_heavier_than_the_cloth():
    x, faces = grid(13)
    floor = 10.0 * np.array([[-1.0, -1.2, 0], [1.3, -1, 0], [1, 1.2, 0], [-1, 1, 0]]) + [0.003, 0, 0]
    collisions = Collisions(
        x, faces, self_distance=REACH, self_stiffness=1.0, body=floor, body_faces=np.array([[0, 1, 2], [0, 2, 3]]),
        body_distance=REACH, body_stiffness=STIFFNESS,
    )
    force = -collisions.energy_and_gradient(x + [0, 0, 0.5 * REACH], floor)[1][:, 2]
    assert force.min() > 0
    assert force.max() < 8 * np.median(force)


def test_bodies_do_not_meet_themselves_and_nothing_near_costs_nothing():
    rest, faces = grid(5)
    body = np.concatenate([rest, rest + [0, 0, 1e-4]]) + [0, 0, 1.0]
    body_faces = np.concatenate([faces, faces + len(rest)])
    collisions = Collisions(
        rest, faces, self_distance=REACH, self_stiffness=1.0, body=body, body_faces=body_faces, body_distance=REACH
    )
    assert collisions.energy_and_gradient(rest, body)[0] == 0.0
    assert collisions.hessian(rest, body).nnz == 0
    swapped = np.concatenate([body[len(rest) :], body[: len(rest)]])
    assert collisions.free_share(rest, body, rest, swapped) == 1.0


def test_a_vertex_stops_before_a_face():
    rest, x, faces, upper = layers(0.03, rough=0.0)
    collisions = Collisions(rest, faces, self_distance=REACH, self_stiffness=STIFFNESS)
    end = x.copy()
    end[:upper, 2] = -0.03
    share = collisions.free_share(x, None, end, None)
    assert 0.4 < share < 0.5
    assert collisions.free_share(x, None, x + [0, 0, -1.0], None) == 1.0


def test_path_after_path_never_crosses():
    """Each leaves a tenth of the distance, until a gap that rounding cannot lose."""
    rest, x, faces, upper = layers(0.003)
    collisions = Collisions(rest, faces, self_distance=REACH, self_stiffness=STIFFNESS)
    random = np.random.default_rng(5)
    for _ in range(14):
        end = x + 1e-4 * random.normal(size=x.shape)
        end[:upper, 2] -= 0.003
        x = x + collisions.free_share(x, None, end, None) * (end - x)
        assert len(collisions.crossings(x).pairs) == 0
    least = collisions.cloth.collisions(np.asfortranarray(x)).compute_minimum_distance(
        collisions.cloth.mesh, np.asfortranarray(x)
    )
    assert 1e-9 < np.sqrt(least) < 1e-4


@pytest.mark.parametrize("seed", range(10))
def test_no_path_ends_in_a_crossing(seed):
    """Two triangles and random ways: vertex and face, edge and edge."""
    random = np.random.default_rng(seed)
    start, faces = random.normal(size=(6, 3)), np.array([[0, 1, 2], [3, 4, 5]])
    start[3:] += [10.0, 0, 0]
    collisions = Collisions(start, faces, self_distance=REACH, self_stiffness=1.0)
    crosses = lambda start, end, s: len(collisions.crossings(start + s * (end - start)).pairs) > 0  # noqa: E731
    met = 0
    for _ in range(6):
        end = random.normal(size=(6, 3)) * 2
        share = collisions.free_share(start, None, end, None)
        assert not any(crosses(start, end, s) for s in np.linspace(0, share, 8))
        later = [s for s in np.linspace(0, 1, 20) if crosses(start, end, s)]
        met += len(later) > 0
        assert not later or share < later[0]
        start = start + share * (end - start)
    assert met > 0


@pytest.mark.parametrize("size", [1e-4, 3e-4, 1e-3, 3e-3])
def test_short_ways_are_free_without_a_search(size):
    """What is known of the distances at the start spares CCD, and changes no answer."""
    rest, x, faces, _ = layers(0.5 * REACH, rough=0.02)
    end = x + size * np.random.default_rng(2).uniform(-1, 1, x.shape)
    knows, fresh = (Collisions(rest, faces, self_distance=REACH, self_stiffness=1.0) for _ in range(2))
    assert knows.energy_and_gradient(x)[0] > 0
    share = fresh.free_share(x, None, end, None)
    assert knows.free_share(x, None, end, None) == share
    assert (share < 1) == (size > 3e-4)
    assert knows.cloth.searches == 1 + (size > 3e-4)


def test_a_wide_region_is_left():
    """A long path needs many pairs, which later evaluations should not look at."""
    collisions, x, _ = two_layers()
    collisions.free_share(x, None, x + [0, 0, 0.1], None)
    collisions.energy_and_gradient(x)
    assert collisions.cloth.searches == 2


def test_a_moving_body_is_seen_by_a_cloth_at_rest():
    collisions, x, body = cloth_on_body()
    assert collisions.free_share(x, body, x, body - [0, 0, 0.1]) == 1.0
    share = collisions.free_share(x, body, x, body + [0, 0, 0.1])
    assert 0.005 < share < 0.02
    collisions, x, body = cloth_on_body(None)
    assert collisions.energy_and_gradient(x, body)[0] == 0.0
    assert collisions.free_share(x, body, x, body + [0, 0, 0.1]) == pytest.approx(share, rel=0.1)


def test_pairs_are_searched_again_only_outside_the_region():
    collisions, x, upper = two_layers()
    away = x.copy()
    away[:upper, 2] += 0.02
    for y, searches in ((away, 1), (away + 1e-5, 1), (x, 2), (x + 1e-5, 2), (away, 3)):
        collisions.energy_and_gradient(y)
        assert collisions.cloth.searches == searches
    fresh, _, _ = two_layers()
    assert collisions.energy_and_gradient(x)[0] == pytest.approx(fresh.energy_and_gradient(x)[0], rel=1e-12)
    assert fresh.energy_and_gradient(x)[0] > 0


def test_far_away_the_contact_is_the_same():
    collisions, x, body = cloth_on_body()
    here, there = (collisions.energy_and_gradient(x + far, body + far)[1] for far in (0.0, 1000.0))
    np.testing.assert_allclose(there, here, atol=1e-7 * abs(here).max())
    assert collisions.free_share(x, body, x, body + 0.1) == pytest.approx(
        collisions.free_share(x + 1000, body + 1000, x + 1000, body + 1000.1), rel=1e-6
    )


def friction_of_sheets(dt=0.01, eps_v=1e-3):
    collisions, x, upper = two_layers()
    return collisions, x, upper, collisions.friction(x, None, dt=dt, eps_v=eps_v, self_friction=0.4)


def test_friction_is_the_coefficient_times_the_normal_force():
    collisions, x, upper, friction = friction_of_sheets()
    normal = -collisions.energy_and_gradient(x)[1][:upper, 2].sum()
    slid = x.copy()
    slid[:upper, 0] += 1e-4  # ten times eps_v dt
    energy, gradient = friction.energy_and_gradient(x, None, slid, None)
    assert gradient[:upper, 0].sum() == pytest.approx(0.4 * normal, rel=0.02)
    assert energy == pytest.approx(0.4 * normal * 1e-4, rel=0.05)
    assert abs(friction.energy_and_gradient(x, None, x + 0.1, None)[1]).max() < 1e-9 * normal
    still = [friction.energy_and_gradient(each, None, each, None)[0] for each in (x, slid)]
    assert still[1] == pytest.approx(still[0], rel=1e-9)  # of the way, not of the place


@pytest.mark.parametrize("slip", [2e-6, 1e-4])
def test_the_derivatives_of_friction(slip):
    _, x, upper, friction = friction_of_sheets()
    slid = x.copy()
    slid[:upper, 0] += slip
    direction = np.random.default_rng(0).normal(size=x.shape)
    _, gradient = friction.energy_and_gradient(x, None, slid, None)
    slope = differences(lambda y: friction.energy_and_gradient(x, None, y, None)[0], slid, [direction], 1e-9)[0]
    assert np.vdot(direction, gradient) == pytest.approx(slope, rel=1e-4)
    hessian = whole(friction.hessian(x, None, slid, None))
    bend = differences(lambda y: friction.energy_and_gradient(x, None, y, None)[1], slid, [direction], 1e-9)[0]
    np.testing.assert_allclose(hessian @ direction.ravel(), bend.ravel(), atol=1e-3 * abs(bend).max())
    assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * abs(hessian).max()


def test_a_body_carries_cloth_by_friction():
    collisions, x, body = cloth_on_body()
    friction = collisions.friction(x, body, dt=0.01, eps_v=1e-3, self_friction=0.0, body_friction=0.3)
    _, gradient = friction.energy_and_gradient(x, body, x, body + [0.01, 0, 0])
    assert gradient[:, 0].sum() < 0
    none = collisions.friction(x, body, dt=0.01, eps_v=1e-3, self_friction=0.5)
    assert none.energy_and_gradient(x, body, x, body + [0.01, 0, 0])[0] == 0.0
    assert friction.hessian(x, body, x, body + [0.01, 0, 0]).shape == (x.size, x.size)


def test_crossings_of_two_triangles():
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1.0]])
    collisions = Collisions(x, np.array([[0, 1, 2], [3, 4, 5]]), self_distance=REACH, self_stiffness=1.0)
    found = collisions.crossings(x)
    assert found.pairs.tolist() == [[0, 1]]
    np.testing.assert_allclose(found.places[0, 2], 0.0, atol=1e-12)
    assert str(found).startswith("1 pairs of faces cross, the first near (0.2")
    assert str(collisions.crossings(x + np.repeat([0, 2.0], 3)[:, None])) == "no faces cross"


def test_crossings_with_a_body_are_numbered_after_the_cloth():
    collisions, x, body = cloth_on_body()
    assert len(collisions.crossings(x, body).pairs) == 0
    pairs = collisions.crossings(x, body + [0, 0, 1] * np.sign(x[:1, :1]) * -0.5 * REACH).pairs
    assert len(pairs) > 0
    assert (pairs[:, 0] < 128).all()
    assert (pairs[:, 1] >= 128).all()


def test_crossings_are_those_of_the_metric():
    rest, x, faces, _ = layers(1e-3, rough=2.0)
    pairs = Collisions(rest, faces, self_distance=REACH, self_stiffness=1.0).crossings(x).pairs
    apart = (faces[pairs[:, 0], :, None] != faces[pairs[:, 1], None, :]).all(axis=(1, 2))
    found = np.zeros(len(faces), bool)
    found[pairs[apart]] = True
    assert 10 < found.sum() < len(faces)
    np.testing.assert_array_equal(found, self_intersecting(x, faces))


def dented(depth):
    rest, x, faces, upper = layers(0.003, rough=0.0)
    x[:upper, 2] -= depth * np.exp(-((x[:upper, :2] - [0.02, 0.01]) ** 2).sum(1) / 0.05**2)
    return Collisions(rest, faces, self_distance=REACH, self_stiffness=1.0), x, upper


def test_a_small_tangle_is_undone():
    collisions, x, upper = dented(0.012)
    before = x.copy()
    new, left = untangle(collisions, x)
    assert len(collisions.crossings(x).pairs) > 10
    assert len(left.pairs) == len(collisions.crossings(new).pairs) == 0
    assert abs(new - x).max() < 0.02
    np.testing.assert_array_equal(x, before)
    held = np.arange(len(x)) >= upper
    new, left = untangle(collisions, x, held=held)
    np.testing.assert_array_equal(new[held], x[held])


def test_cloth_leaves_a_body_outwards():
    rest, faces = grid(9)
    body, body_faces = grid(12, 0.5)
    body = turned(body, 0.3)
    body[:, 2] -= 0.4 * (body[:, :2] ** 2).sum(1)  # a cap that looks up
    x = rest - [0, 0, 0.006]
    collisions = Collisions(rest, faces, self_distance=REACH, self_stiffness=1.0, body=body, body_faces=body_faces)
    assert len(collisions.crossings(x, body).pairs) > 5
    new, left = untangle(collisions, x, body)
    assert len(left.pairs) == 0
    assert (new[:, 2] > -0.4 * (new[:, :2] ** 2).sum(1) - 2e-3).all()
    assert abs(new - x).max() < 0.02


def test_what_cannot_be_undone_is_reported():
    collisions, x, _ = dented(0.012)
    new, left = untangle(collisions, x, held=np.ones(len(x), bool), moves=3)
    assert len(left.pairs) == len(collisions.crossings(x).pairs) > 0
    np.testing.assert_array_equal(new, x)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"self_distance": 0.0}, "self_distance 0.0"),
        ({"self_stiffness": float("nan")}, "self_stiffness nan"),
        ({"body": np.zeros((3, 3))}, "body given, body_faces absent"),
    ],
)
def test_mistakes_are_sentences(change, message):
    rest, faces = grid(3)
    with pytest.raises(DrapeError, match=message):
        Collisions(rest, faces, **{"self_distance": REACH, "self_stiffness": 1.0, **change})


def test_wrong_positions_are_refused():
    collisions, x, _ = two_layers()
    with pytest.raises(DrapeError, match="expected"):
        collisions.energy_and_gradient(x[1:])
    with pytest.raises(DrapeError, match="not finite"):
        collisions.energy_and_gradient(np.full_like(x, np.nan))
    with pytest.raises(DrapeError, match="share"):
        stiffness_for(1.0, REACH, 0.01, 1.5)
