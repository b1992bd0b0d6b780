from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.data.windows import Window
from drape.energy.law import spring_hinge
from drape.energy.law.spring_hinge import COEFFICIENTS, SpringHingeLaw, balanced
from drape.energy.step import Step
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import Material
from tests.conftest import bent

TRUE = torch.tensor(
    [[9.0, 90.0, 40.0, 0.1, 1.5, 0.4, 2.0, 0.2], [0.0, 200.0, 300.0, -0.05, 0.7, 0.0, 4.0, 0.0]], dtype=torch.float64
)
SILK = Material("silk", 5.0, 0.5, 0.0, 0.0, 1.0, 0.15)


def window_of(mesh: MeshBatch, frames: list[torch.Tensor], free: torch.Tensor, fabric: list[int]) -> Window:
    return Window(
        mesh=mesh,
        x_prev=frames[0],
        x=frames[1],
        x_next=frames[2],
        mass=torch.ones(mesh.num_vertices, dtype=torch.float64),
        free=free,
        attributes=torch.zeros(len(fabric), 5, dtype=torch.float64),
        fabric=torch.tensor(fabric),
        gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64),
        dt=1 / 30,
    )


def curved() -> ClothMesh:
    """A cloth that is not flat at rest."""
    flat = square_grid(1.0, 6)
    return ClothMesh.from_faces(bent(torch.tensor(flat.rest_positions).double()).numpy(), flat.faces)


def window(fabrics: list[int], seed: int = 0) -> Window:
    """Randomly moving cloths; the vertices of the first row are pinned."""
    generator = torch.Generator().manual_seed(seed)
    mesh = MeshBatch.from_meshes([curved()] * len(fabrics))
    rest = mesh.rest_positions
    frames = [rest + 0.01 * torch.randn(rest.shape, generator=generator, dtype=torch.float64) for _ in range(3)]
    free = torch.ones(6, 6, dtype=torch.bool)
    free[0] = False
    return window_of(mesh, frames, free.flatten().repeat(len(fabrics)), fabrics)


def obeying(law: SpringHingeLaw, moving: Window, noise: float = 0.0) -> Window:
    """Frames t and t+1 as they are, and t-1 such that the law explains the motion, up to ``noise`` [N].

    x(t-1) = 2x(t) - x(t+1) + dt² (f/m + g) makes ``m a - m g = f``; f depends on x(t-1) a little.
    """
    added = noise * torch.randn(moving.x.shape, generator=torch.Generator().manual_seed(5)).double()
    for _ in range(15):
        acceleration = (law(moving) + added) / moving.mass[:, None] + moving.gravity
        moving = replace(moving, x_prev=2 * moving.x - moving.x_next + moving.dt**2 * acceleration)
    return moving


def only(**coefficients: float) -> SpringHingeLaw:
    """One fabric with all other coefficients 0."""
    return SpringHingeLaw(torch.tensor([[coefficients.get(name, 0.0) for name in COEFFICIENTS]]).double())


def frames_of(mesh: ClothMesh, **moved: torch.Tensor) -> Window:
    """A cloth at rest in all frames but those that are given."""
    batch = MeshBatch.from_meshes([mesh])
    still = window_of(batch, [batch.rest_positions] * 3, torch.ones(batch.num_vertices, dtype=torch.bool), [0])
    return replace(still, **moved)


def test_recovers_the_coefficients_that_made_the_data():
    windows = [obeying(SpringHingeLaw(TRUE), window([0, 1, 1], seed)) for seed in range(4)]
    law = SpringHingeLaw.fit(((each,) for each in windows), num_fabrics=2)
    torch.testing.assert_close(law.coefficients, TRUE, rtol=1e-6, atol=1e-6)
    assert law.force_residual(windows[0]).abs().max() < 1e-6
    assert windows[0].inertial_force.norm(dim=-1).mean() > 1.0


def test_noise_leaves_its_own_size():
    windows = [obeying(SpringHingeLaw(TRUE), window([0, 1], seed), noise=0.5) for seed in range(8)]
    law = SpringHingeLaw.fit([(each,) for each in windows], num_fabrics=2)
    residual = law.force_residual(windows[3])[windows[3].free]
    assert residual.square().mean().sqrt() == pytest.approx(0.5, rel=0.1)


def test_a_violent_window_does_not_decide(monkeypatch):
    """Forces of another law, a thousand times as large, in one window of nine: least squares follow them."""
    right = [obeying(SpringHingeLaw(TRUE), window([0, 1], seed)) for seed in range(8)]
    violent = window([0, 1], seed=8)
    windows = [*right, replace(violent, x_prev=violent.x_prev + 3.0 * (violent.x - violent.mesh.rest_positions))]

    def residual() -> float:
        law = SpringHingeLaw.fit([(each,) for each in windows], num_fabrics=2)
        return float(law.force_residual(right[0]).norm(dim=-1).mean() / right[0].inertial_force.norm(dim=-1).mean())

    assert residual() < 1e-2
    monkeypatch.setattr(spring_hinge, "ROUNDS", 1)
    assert residual() > 0.3


def test_the_fit_does_not_depend_on_the_batches():
    singles = [obeying(SpringHingeLaw(TRUE), window([k % 2], seed=k), noise=1.0) for k in range(6)]
    together = replace(
        singles[0],
        mesh=MeshBatch.from_meshes([curved()] * 6),
        attributes=torch.zeros(6, 5, dtype=torch.float64),
        **{
            name: torch.cat([getattr(w, name) for w in singles])
            for name in ("x_prev", "x", "x_next", "mass", "free", "fabric")
        },
    )
    one, many = SpringHingeLaw.fit([(together,)], 2), SpringHingeLaw.fit([(each,) for each in singles], 2)
    torch.testing.assert_close(one.coefficients, many.coefficients, rtol=1e-8, atol=1e-8)


def test_what_never_happens_is_nothing():
    """Cloth that moves without bending says nothing of its hinges."""
    flat = frames_of(square_grid(1.0, 4))
    plane = torch.tensor([1.0, 1.0, 0.0])
    frames = [flat.x + 0.01 * plane * torch.randn_like(flat.x) for _ in range(3)]
    moving = replace(flat, **dict(zip(("x_prev", "x", "x_next"), frames, strict=True)), gravity=0.0 * flat.gravity)
    stretching = only(spring_now_N_per_m=50.0, spring_next_N_per_m=70.0, damper_kg_per_s=1.0, drag_kg_per_s=0.3)
    found = SpringHingeLaw.fit([(obeying(stretching, moving),)], num_fabrics=1)
    torch.testing.assert_close(found.coefficients, stretching.coefficients, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("name", "frame"), list(zip(COEFFICIENTS, ("x_prev", "x", "x_next"), strict=False)))
def test_stretched_edges_pull_together(name, frame):
    """A triangle with sides of 3, 4 and 5 m, a tenth too large in one frame."""
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    mesh = ClothMesh.from_faces(corners, np.array([[0, 1, 2]]))
    force = only(**{name: 100.0})(frames_of(mesh, **{frame: 1.1 * torch.tensor(corners)}))
    assert force[0].tolist() == pytest.approx([30.0, 40.0, 0.0], rel=1e-6)
    assert force[1].tolist() == pytest.approx([-30.0 - 50.0 * 0.6, 50.0 * 0.8, 0.0], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "frame"), [("hinge_before_J", "x_prev"), ("hinge_now_J", "x"), ("hinge_next_J", "x_next")]
)
@pytest.mark.parametrize("winding", [1, -1])
def test_folded_hinges_push_back(name, frame, winding):
    """A face folded up by 0.5 rad about a side: its far corner, 2 m away, feels 0.5 b/2 across the face.

    It is the same whichever side of the faces is the outer one.
    """
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.5, 0.0], [-1.0, 0.5, 0.0]])
    mesh = ClothMesh.from_faces(corners, np.array([[0, 2, 1], [0, 1, 3]])[:, ::winding])
    sine, cosine = np.sin(0.5), np.cos(0.5)
    folded = torch.tensor(corners)
    folded[2] = torch.tensor([2.0 * cosine, 0.5, 2.0 * sine])
    force = only(**{name: 100.0})(frames_of(mesh, **{frame: folded}))
    assert force[2].tolist() == pytest.approx([25.0 * sine, 0.0, -25.0 * cosine], abs=1e-6)
    assert force[3].tolist() == pytest.approx([0.0, 0.0, -50.0], abs=1e-6)


def test_dampers_act_along_the_edges_as_they_were():
    """An end that moves along an edge and across it, seen from the other end."""
    corners = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    mesh = ClothMesh.from_faces(corners, np.array([[0, 1, 2]]))
    moved = torch.tensor(corners)
    moved[1] += torch.tensor([0.5, 0.0, 1.0])
    force = only(damper_kg_per_s=2.0)(frames_of(mesh, x_next=moved))
    assert force[0].tolist() == pytest.approx([2.0 * 0.5 * 30, 0.0, 0.0])
    assert force.sum(0).norm() < 1e-9


def test_drag_is_against_the_motion():
    moving = window([0])
    torch.testing.assert_close(only(drag_kg_per_s=2.0)(moving), -2.0 * moving.v_next)


def test_internal_forces_add_up_to_nothing():
    """No sum and, where all act at t+1, no torque either."""
    inner = TRUE.clone()
    inner[:, -1] = 0.0
    moving = window([0, 1])
    force = SpringHingeLaw(inner)(moving)
    assert force.norm() > 10.0
    np.testing.assert_allclose(torch.stack([force[:36].sum(0), force[36:].sum(0)]), 0.0, atol=1e-9)
    force = only(spring_next_N_per_m=90.0, hinge_next_J=2.0)(window([0]))
    np.testing.assert_allclose(torch.linalg.cross(window([0]).x_next, force).sum(0), 0.0, atol=1e-9)


def test_forces_turn_with_the_cloth():
    moving = window([0, 1])
    turn, _ = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64))
    turn = turn * torch.det(turn)
    frames = {name: getattr(moving, name) @ turn.T + 3.0 for name in ("x_prev", "x", "x_next")}
    law = SpringHingeLaw(TRUE)
    torch.testing.assert_close(law(replace(moving, **frames)), law(moving) @ turn.T, rtol=1e-8, atol=1e-8)


def test_pinned_vertices_do_not_enter_the_fit():
    windows = [obeying(SpringHingeLaw(TRUE), window([0, 1], seed)) for seed in range(4)]
    held = [replace(w, mass=torch.where(w.free, w.mass, 50.0)) for w in windows]
    law = SpringHingeLaw.fit([(each,) for each in held], 2)
    torch.testing.assert_close(law.coefficients, TRUE, rtol=1e-6, atol=1e-6)
    assert held[0].inertial_force[~held[0].free].norm() > 100.0
    assert not SpringHingeLaw(TRUE).force_residual(held[0])[~held[0].free].any()


def test_a_fabric_that_was_not_there_is_refused():
    law = SpringHingeLaw.fit([(window([1]),)], num_fabrics=2)
    assert law.coefficients[0].isnan().all()
    assert law.force_residual(window([1])).isfinite().all()
    with pytest.raises(DrapeError, match=r"not fitted on the fabrics number \[0\]"):
        law(window([0, 1]))
    with pytest.raises(DrapeError, match="nothing moves"):
        SpringHingeLaw.fit([], num_fabrics=2)
    with pytest.raises(DrapeError, match="nothing moves"):
        SpringHingeLaw.fit([(frames_of(square_grid(1.0, 3)),)], num_fabrics=2)


def in_a_scene(law: SpringHingeLaw, moving: Window) -> torch.Tensor:
    """The force at t+1 of the energies of the first fabric."""
    step = Step(
        mesh=moving.mesh, x=moving.x, v=moving.v, mass=moving.mass, free=moving.free, attributes=moving.attributes,
        gravity=moving.gravity, dt=moving.dt,
    )  # fmt: skip
    hinges = law.of_fabric(0, SILK, face_area=0.02, dt=0.01)
    terms = [kind(hinges, transfer=False) for kind in (HingeElastic, Damping)]
    return -sum(term.energy_and_gradient(moving.x_next, step)[1] for term in terms)


def test_in_a_scene_all_forces_are_those_at_the_next_frame():
    moving = window([0])
    law = only(spring_next_N_per_m=90.0, hinge_next_J=2.0, damper_kg_per_s=3.0, drag_kg_per_s=0.4)
    torch.testing.assert_close(in_a_scene(law, moving), law(moving), rtol=1e-7, atol=1e-7)
    added = only(spring_next_N_per_m=139.0, hinge_next_J=2.0, damper_kg_per_s=2.0, drag_kg_per_s=0.2)
    torch.testing.assert_close(in_a_scene(SpringHingeLaw(TRUE), moving), added(moving), rtol=1e-7, atol=1e-7)


def test_in_a_scene_nothing_below_zero_counts():
    moving = window([0])
    law = SpringHingeLaw(torch.tensor([[0.0, 90.0, -100.0, 2.0, -1.0, -3.0, -4.0, -0.2]]).double())
    assert law(moving).norm() > 1.0
    assert not in_a_scene(law, moving).any()


def test_instruments_see_through_noise_that_makes_least_squares_soft():
    """Noise as large as the basis: least squares halve the coefficients; instruments with noise of their own do not."""
    random = torch.Generator().manual_seed(0)

    def drawn() -> torch.Tensor:
        return torch.randn((20_000, 2, 3), generator=random, dtype=torch.float64)

    true, basis = torch.tensor([3.0, -5.0], dtype=torch.float64), drawn()
    force = torch.einsum("k,vkx->vx", true, basis)
    seen, instruments = basis + drawn(), torch.cat([basis + drawn(), basis + drawn()], 1)
    torch.testing.assert_close(balanced(seen, force, seen), 0.5 * true, rtol=0.05, atol=0)
    torch.testing.assert_close(balanced(seen, force, instruments), true, rtol=0.05, atol=0)


def test_other_windows_are_the_instruments_of_a_fit():
    """Windows that obey a law give it, whatever cloth their instruments are of."""
    law = SpringHingeLaw(TRUE)
    windows = [obeying(law, window([0, 1], seed)) for seed in range(3)]
    found = SpringHingeLaw.fit([(each, each) for each in windows], 2)
    torch.testing.assert_close(found.coefficients, TRUE, rtol=1e-5, atol=1e-5)
    other = SpringHingeLaw.fit([(each, window([0, 1], seed=7)) for each in windows], 2)
    torch.testing.assert_close(other.coefficients, TRUE, rtol=1e-4, atol=1e-4)
