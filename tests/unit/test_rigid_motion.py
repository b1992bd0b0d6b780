"""The rigid part of a motion, against rotations that are known."""

from __future__ import annotations

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from drape.simulators.kinematic.prior import RigidMotion

TURN = torch.from_numpy(Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix())


def points(number: int, seed: int = 0) -> Tensor:
    return torch.randn(number, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def single(x: Tensor, x_next: Tensor, weight: Tensor | None = None) -> RigidMotion:
    weight = torch.ones(len(x)) if weight is None else weight
    return RigidMotion.fit(x, x_next, weight, torch.zeros(len(x), dtype=torch.long), 1)


def test_a_rigid_motion_is_found_and_takes_other_points_along():
    x, other = points(12), points(5, seed=1)
    there = torch.tensor([3.0, -2.0, 0.5])
    motion = single(x, x @ TURN.T + there)
    torch.testing.assert_close(motion.rotation[0], TURN, atol=1e-5, rtol=0.0)
    shift = motion.shift(other, torch.zeros(5, dtype=torch.long))
    torch.testing.assert_close(shift, other @ TURN.T + there - other, atol=1e-4, rtol=0.0)


def test_scipy_finds_the_same_rotation_of_a_motion_that_is_not_rigid():
    x, weight = points(20), torch.rand(20, generator=torch.Generator().manual_seed(2)).double()
    x_next = x @ TURN.T + 0.1 * points(20, seed=3)
    mean, mean_next = ((weight[:, None] * p).sum(0) / weight.sum() for p in (x, x_next))
    expected, _ = Rotation.align_vectors((x_next - mean_next).numpy(), (x - mean).numpy(), weight.numpy())
    found = single(x, x_next, weight).rotation[0]
    torch.testing.assert_close(found, torch.from_numpy(expected.as_matrix()), atol=1e-5, rtol=0.0)


def test_mirrored_points_get_a_rotation():
    x = points(10)
    rotation = single(x, x * torch.tensor([1.0, 1.0, -1.0])).rotation[0]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3).double())
    torch.testing.assert_close(torch.linalg.det(rotation), torch.tensor(1.0).double())


def test_points_on_a_line_do_not_turn_about_it():
    """Nor does a single one, nor none: the rotation is the smallest that there is."""
    along = torch.tensor([[0.0, 0.0, 1.0]]).double() * torch.arange(4)[:, None]
    about_x = torch.from_numpy(Rotation.from_euler("x", 0.3).as_matrix())
    torch.testing.assert_close(single(along, along @ about_x.T).rotation[0], about_x, atol=1e-5, rtol=0.0)
    for few in (along[:1], along[:0]):
        torch.testing.assert_close(single(few, few + 1.0).rotation[0], torch.eye(3).double())


def test_each_mesh_has_its_own():
    x = points(12)
    mesh_of = torch.arange(12) % 3
    moving = torch.where((mesh_of == 1)[:, None], x @ TURN.T, x)
    motion = RigidMotion.fit(x.float(), moving.float(), torch.ones(12), mesh_of, 3)
    torch.testing.assert_close(motion.rotation[1], TURN, atol=1e-4, rtol=0.0)
    for still in (0, 2):
        torch.testing.assert_close(motion.rotation[still], torch.eye(3).double(), atol=1e-6, rtol=0.0)
    assert motion.shift(x.float(), mesh_of).dtype == torch.float32
