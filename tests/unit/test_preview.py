"""What a stored animation looks like without Blender: in the picture, upright, nearer things in front."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drape.data.animation_hdf5 import AnimationFile
from drape.data.look import Look, fabric_colour, upright
from drape.report.preview import preview, preview_film
from drape.report.raster import BACKGROUND, Surface, draw
from drape.scene.camera import MARGIN, Camera
from drape.scene.obstacle import Obstacle
from tests.animations import header, write

SQUARE = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def straight_on(distance: float = 4.0) -> Camera:
    """It looks along +y; x is right, z is up; at ``distance`` half a metre is a half angle of 1 / 8."""
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]).T
    return Camera(np.array([0.0, -distance, 0.0]), axes, np.array([0.5, 0.5]))


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("place", [0.0, 1e4])
def test_the_camera_sees_everything_and_no_more(aspect: float, place: float) -> None:
    rng = np.random.default_rng(1)
    clouds = [rng.normal(size=(50, 3)) * [1.0, 0.3, 2.0] + place for _ in range(4)]
    camera = Camera.framing(clouds, aspect)
    seen = np.concatenate([camera.project(cloud) for cloud in clouds])
    assert (seen[:, 2] > 0).all()
    assert np.abs(seen[:, :2]).max() == pytest.approx(MARGIN, rel=1e-6)
    tight = np.abs(seen[:, :2]).max(axis=0).argmax()
    assert seen[:, tight].min() == pytest.approx(-seen[:, tight].max(), rel=1e-6)  # as near one side as the other
    assert camera.half_angles[0] / camera.half_angles[1] == pytest.approx(aspect)
    np.testing.assert_allclose(camera.axes.T @ camera.axes, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("down", [*np.eye(3), *-np.eye(3)])
def test_gravity_pulls_down_in_the_picture(down: np.ndarray) -> None:
    rotation = upright(9.81 * down)
    np.testing.assert_allclose(rotation @ down, [0.0, 0.0, -1.0])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_upright_already() -> None:
    for gravity in ([0.0, 0.0, -9.81], [0.0, 0.0, 0.0], [0.1, 0.2, -9.0]):
        np.testing.assert_array_equal(upright(np.array(gravity)), np.eye(3))


def test_a_square_covers_its_pixels_and_nothing_else() -> None:
    picture = draw([Surface(SQUARE, FACES, RED)], straight_on(), 80, 60)
    covered = (np.abs(picture - BACKGROUND) > 0.02).any(axis=-1)
    expected = np.zeros((60, 80), bool)
    expected[15:45, 20:60] = True
    np.testing.assert_array_equal(covered, expected)
    assert len(np.unique(picture[15:45, 20:60].reshape(-1, 3), axis=0)) == 1


def test_the_nearer_surface_hides_the_farther_whatever_the_order() -> None:
    near, far = Surface(0.5 * SQUARE - [0, 1, 0], FACES, RED), Surface(SQUARE, FACES, GREEN)
    pictures = [draw(order, straight_on(), 80, 60) for order in ([near, far], [far, near])]
    np.testing.assert_array_equal(*pictures)
    middle, edge = pictures[0][30, 40], pictures[0][17, 22]
    assert middle[0] > 0.3 > middle[1]
    assert edge[1] > 0.3 > edge[0]


def test_surfaces_that_cross_meet_in_a_line() -> None:
    tilted = SQUARE @ np.array([[1, 1, 0], [0, 0, 0], [0, 0, 1.0]])  # nearer on the left
    picture = draw([Surface(tilted, FACES, RED), Surface(SQUARE, FACES, GREEN)], straight_on(), 80, 60)
    assert (picture[30, 22:39, 0] > picture[30, 22:39, 1]).all()
    assert (picture[30, 42:58, 1] > picture[30, 42:58, 0]).all()


def test_behind_the_camera_or_without_area_nothing_is_drawn() -> None:
    for positions in (SQUARE - [0, 9, 0], SQUARE * [0, 1, 1], SQUARE + [90, 0, 0]):
        picture = draw([Surface(positions, FACES, RED)], straight_on(), 40, 30)
        assert (picture == np.float32(BACKGROUND)).all()


def test_a_wide_floor_does_not_make_the_cloth_small(tmp_path: Path) -> None:
    floor = Obstacle(np.array([[0, 1, 2], [0, 2, 3]]), 50.0 * SQUARE[None][..., [0, 2, 1]] - [0, 0, 0.5])
    write(tmp_path / "floor.h5", header(obstacle=floor))
    write(tmp_path / "none.h5", header(body=False))
    with AnimationFile(tmp_path / "floor.h5") as one, AnimationFile(tmp_path / "none.h5") as other:
        np.testing.assert_array_equal(Look(one).camera(1.5).position, Look(other).camera(1.5).position)
        np.testing.assert_array_equal(Look(one).box, Look(other).box)


def test_strip_and_film(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", header(8, dt=1 / 60))
    strip = np.asarray(Image.open(preview(path, tmp_path / "out" / "strip.png")).convert("RGB"), float) / 255
    assert strip.shape[1] > 6 * 150
    panels = np.array_split(strip, 6, axis=1)
    blue = np.array(fabric_colour("denim"))
    for panel in panels:
        hue = panel / np.maximum(panel.max(axis=-1, keepdims=True), 1e-9)
        fabric = np.abs(hue - blue / blue.max()).max(axis=-1) < 0.05
        assert 0.04 < fabric.mean() < 0.8
    assert np.abs(panels[0][:, :150] - panels[-1][:, :150]).mean() > 0.01
    film = Image.open(preview_film(path, tmp_path / "a.gif", height=60))
    assert film.n_frames == 4  # every second: 30 frames per second are shown
    durations = []
    for frame in range(film.n_frames):
        film.seek(frame)
        durations.append(film.info["duration"])
    assert sum(durations) == pytest.approx(1000 * 8 / 60, abs=10)
    assert sorted(p.name for p in tmp_path.rglob("*.*")) == ["a.gif", "a.h5", "strip.png"]
