from dataclasses import replace

import numpy as np
import pytest
import torch

from drape.data.windows import Window
from drape.energy.mass_spring import COEFFICIENTS, MassSpringLaw, springs_of
from drape.errors import DrapeError
from drape.scene.grid import square_grid
from drape.scene.mesh_batch import MeshBatch

TRUE = torch.tensor(
    [[900.0, 400.0, 3.0, 2.0, 1.0, 0.5, 0.2], [5000.0, 6000.0, 70.0, 0.0, 4.0, 0.1, 0.0]], dtype=torch.float64
)


def window(fabrics: list[int], seed: int = 0) -> Window:
    """Randomly moving cloths; the vertices of the first row are pinned."""
    generator = torch.Generator().manual_seed(seed)
    mesh = MeshBatch.from_meshes([square_grid(1.0, 6)] * len(fabrics))
    rest = mesh.rest_positions
    frames = [rest + 0.01 * torch.randn(rest.shape, generator=generator, dtype=torch.float64) for _ in range(3)]
    free = torch.ones(6, 6, dtype=torch.bool)
    free[0] = False
    return Window(
        mesh=mesh,
        x_prev=frames[0],
        x=frames[1],
        x_next=frames[2],
        mass=torch.full((mesh.num_vertices,), 0.3, dtype=torch.float64),
        free=free.flatten().repeat(len(fabrics)),
        attributes=torch.zeros(len(fabrics), 5, dtype=torch.float64),
        fabric=torch.tensor(fabrics),
        gravity=torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64),
        dt=1 / 30,
    )


def obeying(law: MassSpringLaw, moving: Window, noise: float = 0.0) -> Window:
    """The same deformation with frame t-1 such that the law explains the motion, up to ``noise`` [N].

    The forces depend on frames t and t+1 only, so x(t-1) = 2x(t) - x(t+1) + dt² (f/m + g) makes ``m a - m g = f``.
    """
    force = law(moving) + noise * torch.randn(moving.x.shape, generator=torch.Generator().manual_seed(5)).double()
    acceleration = force / moving.mass[:, None] + moving.gravity
    return replace(moving, x_prev=2 * moving.x - moving.x_next + moving.dt**2 * acceleration)


def test_recovers_the_coefficients_that_made_the_data():
    windows = [obeying(MassSpringLaw(TRUE), window([0, 1, 1], seed)) for seed in range(4)]
    law = MassSpringLaw.fit(iter(windows), num_fabrics=2)
    torch.testing.assert_close(law.coefficients, TRUE, rtol=1e-6, atol=1e-6)
    assert law.force_residual(windows[0]).abs().max() < 1e-6
    assert windows[0].inertial_force.norm(dim=-1).mean() > 1.0


def test_noise_leaves_its_own_size():
    windows = [obeying(MassSpringLaw(TRUE), window([0, 1], seed), noise=0.5) for seed in range(8)]
    law = MassSpringLaw.fit(windows, num_fabrics=2)
    residual = law.force_residual(windows[3])[windows[3].free]
    assert residual.square().mean().sqrt() == pytest.approx(0.5, rel=0.1)


def test_the_fit_does_not_depend_on_the_batches():
    singles = [obeying(MassSpringLaw(TRUE), window([k % 2], seed=k), noise=1.0) for k in range(6)]
    together = replace(
        singles[0],
        mesh=MeshBatch.from_meshes([square_grid(1.0, 6)] * 6),
        attributes=torch.zeros(6, 5, dtype=torch.float64),
        **{
            name: torch.cat([getattr(w, name) for w in singles])
            for name in ("x_prev", "x", "x_next", "mass", "free", "fabric")
        },
    )
    one, many = MassSpringLaw.fit([together], 2), MassSpringLaw.fit(singles, 2)
    torch.testing.assert_close(one.coefficients, many.coefficients, rtol=1e-8, atol=1e-8)


def test_internal_forces_add_up_to_nothing():
    without_drag = TRUE.clone()
    without_drag[:, -1] = 0.0
    moving = window([0, 1])
    force = MassSpringLaw(without_drag)(moving)
    assert force.norm() > 100.0
    torque = torch.linalg.cross(moving.x_next, force)
    np.testing.assert_allclose(moving.mesh.sum_vertices(force[:, 2]), 0.0, atol=1e-9)
    np.testing.assert_allclose(torque.sum(0), 0.0, atol=1e-9)


def test_a_stretched_edge_is_pulled_together():
    still = window([0])
    rest = still.mesh.rest_positions
    stretched = replace(still, x_prev=rest, x=1.1 * rest, x_next=1.1 * rest)
    only_straight = torch.zeros(1, len(COEFFICIENTS), dtype=torch.float64)
    only_straight[0, 0] = 100.0
    force = MassSpringLaw(only_straight)(stretched)
    corner = 0  # a corner of the square: one straight edge in x, one in y, each 0.2 m long
    assert force[corner].tolist() == pytest.approx([100 * 0.02, -100 * 0.02, 0.0], rel=1e-5)


def test_drag_is_against_the_motion():
    moving = window([0])
    only_drag = torch.zeros(1, len(COEFFICIENTS), dtype=torch.float64)
    only_drag[0, -1] = 2.0
    torch.testing.assert_close(MassSpringLaw(only_drag)(moving), -2.0 * moving.v_next)


def test_pinned_vertices_do_not_enter_the_fit():
    windows = [obeying(MassSpringLaw(TRUE), window([0, 1], seed)) for seed in range(4)]
    held = [replace(w, x_prev=torch.where(w.free[:, None], w.x_prev, w.x_prev + 1.0)) for w in windows]
    torch.testing.assert_close(MassSpringLaw.fit(held, 2).coefficients, TRUE, rtol=1e-6, atol=1e-6)
    assert not MassSpringLaw(TRUE).force_residual(held[0])[~held[0].free].any()


def test_springs_of_the_grid():
    springs = springs_of(MeshBatch.from_meshes([square_grid(1.0, 22)]))
    assert torch.bincount(springs.group).tolist() == [2 * 22 * 21, 21 * 21, 1281]
    assert springs.rest_lengths[springs.group == 2].min() == pytest.approx(2**0.5 / 21, rel=1e-5)
    assert springs.rest_lengths[springs.group == 2].max() == pytest.approx(5**0.5 / 21, rel=1e-5)


def test_a_fabric_that_was_not_there_is_refused():
    law = MassSpringLaw.fit([window([1])], num_fabrics=2)
    assert law.coefficients[0].isnan().all()
    assert law.force_residual(window([1])).isfinite().all()
    with pytest.raises(DrapeError, match=r"not fitted on the fabrics number \[0\]"):
        law(window([0, 1]))
    with pytest.raises(DrapeError, match="nothing moves"):
        MassSpringLaw.fit([], num_fabrics=2)
