"""How a sequence of a garment comes to be: repaired, drawn anew, its twin, and the part that waits for the others."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from drape.blender import garment_sequence
from drape.blender.choice import Choice
from drape.blender.dressed_body import DressedBody
from drape.blender.garment_attempt import Attempt, draw_attempt
from drape.blender.garment_sequence import DrawnGarment
from drape.blender.part import load_part, save_part
from drape.blender.sequence import make_sequence
from drape.data.hdf5 import GarmentFile
from drape.errors import DrapeError
from drape.figure.shape import FigureShape
from drape.garment.style import GarmentStyle
from tests.trajectories import header, sequences, write

FRAMES, SETTLE = 4, 3
DATA = {
    "seed": 3, "fps": 30, "gravity": 9.81, "counts": {"train": 2, "test": 1}, "bodies": {"train": 1, "test": 1},
    "kinds": ["tshirt"], "motions": {"train": ["walk"], "test": ["dance"]}, "settle": SETTLE, "frames": FRAMES,
    "twin": 1e-6, "contact": {"friction": 0.02}, "solver": {"steps": 10, "repair": 20},
    "reject": {"inside": 0.002, "self_intersection": 0.005, "stretch": 1.4, "speed": 15.0, "attempts": 3},
}  # fmt: skip
PLAN = {"data": DATA, "material": {"silk": {}}, "settings": {"silk": {"quality": 5, "mass": 0.15}}}


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    made = trimesh.creation.icosphere(2, radius)
    return np.asarray(made.vertices), np.asarray(made.faces, np.int64)


class FakeAttempt(Attempt):
    """A ball in a ball of cloth."""

    def __init__(self, rng: np.random.Generator) -> None:
        (body, body_faces), (cloth, faces) = ball(0.2), ball(0.25)
        carried = {"bones": np.zeros((len(body), 4), np.int64), "weights": np.tile([1.0, 0, 0, 0], (len(body), 1))}
        shape, style, pinned = FigureShape(), GarmentStyle(), np.arange(2)
        skinned = np.repeat(cloth[None], SETTLE + FRAMES, axis=0)
        bodies = np.repeat(body[None], SETTLE + FRAMES, axis=0)
        self.__dict__.update(  # an attempt is frozen
            figure=SimpleNamespace(rest_positions=body, faces=body_faces, shape=shape, **carried),
            garment=SimpleNamespace(
                kind="tshirt", rest_positions=cloth, faces=faces, pinned=pinned, style=style, **carried
            ),
            transforms=np.tile(np.eye(4), (SETTLE + FRAMES, 19, 1, 1)),
            number=rng.integers(1 << 40),
            twin=rng,
            skinned=skinned,
            dressed=DressedBody(cloth, faces, pinned, skinned[:, pinned], body_faces, bodies),
        )


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch):
    """``made(index, faults)``: a sequence whose k-th simulation is inside the body where ``faults[k]``."""
    monkeypatch.setattr(garment_sequence, "draw_attempt", lambda choice, data, rng, people: FakeAttempt(rng))

    def make(index: int, faults: list[bool]):
        calls: list[SimpleNamespace] = []

        def simulate(dressed, start, settings, contact, gravity, fps):
            scale = 0.5 if len(calls) < len(faults) and faults[len(calls)] else 1.0
            calls.append(SimpleNamespace(start=start, steps=settings["quality"], gravity=gravity, fps=fps))
            return np.repeat(scale * start[None], SETTLE + FRAMES, axis=0).astype(np.float32)

        draw = partial(DrawnGarment, simulate=simulate, crossing=lambda x, faces: np.zeros(len(faces), bool))
        return make_sequence(index, PLAN, draw), calls

    return make


def test_a_good_sequence_is_taken_at_once(made) -> None:
    part, calls = made(0, [])
    assert [call.steps for call in calls] == [10]  # the preset has 5
    np.testing.assert_array_equal(calls[0].gravity, [0.0, 0.0, -9.81])
    assert (part.sequence.attempts, part.sequence.quality["repaired"]) == (1, False)
    assert part.sequence.quality["refused"] == []
    assert len(part.sequence.positions) == len(part.sequence.transforms) == FRAMES
    assert (part.sequence.split, part.sequence.mass_per_vertex, part.sequence.twin) == ("train", 0.15, None)
    assert part.sequence.friction == 0.02


def test_a_refused_sequence_is_repaired_and_then_drawn_anew(made) -> None:
    part, calls = made(0, [True])
    assert [call.steps for call in calls] == [10, 20]
    assert (part.sequence.attempts, part.sequence.quality["repaired"]) == (1, True)
    assert part.sequence.quality["solver_steps"] == 20
    part, calls = made(0, [True, True])
    assert [call.steps for call in calls] == [10, 20, 10]
    assert (part.sequence.attempts, part.sequence.quality["repaired"]) == (2, False)
    assert [reason.split()[0] for reason in part.sequence.quality["refused"]] == ["inside_worst"] * 2
    with pytest.raises(DrapeError, match="refused 3 times, at last for inside_worst 1 of the vertices inside"):
        made(0, [True] * 6)


def test_a_garment_that_cannot_be_made_is_an_attempt(made, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []

    def draw(choice, data, rng, people):
        drawn.append(len(drawn))
        if len(drawn) == 1:
            raise DrapeError("garment tshirt: found 2 separate pieces")
        return FakeAttempt(rng)

    monkeypatch.setattr(garment_sequence, "draw_attempt", draw)
    part, _ = made(1, [])
    assert part.sequence.attempts == 2
    assert part.sequence.quality["refused"] == ["garment tshirt: found 2 separate pieces"]


def test_each_attempt_draws_from_seed_sequence_and_attempt(made, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []

    def draw(choice, data, rng, people):
        attempt = FakeAttempt(rng)
        drawn.append(int(attempt.number))
        return attempt

    monkeypatch.setattr(garment_sequence, "draw_attempt", draw)
    made(0, [True, True])
    made(1, [])
    expected = [np.random.default_rng([3, *key]).integers(1 << 40) for key in ((0, 1), (0, 2), (1, 1))]
    assert drawn == expected


def test_the_twin_of_a_test_sequence_starts_a_micrometre_beside_pins_included(made) -> None:
    part, calls = made(2, [])
    moved = calls[1].start - calls[0].start
    assert moved.std() == pytest.approx(1e-6, rel=0.1)
    assert np.abs(moved[:2]).min() > 0.0
    assert part.sequence.split == "test"
    assert 0 < part.sequence.quality["twin_distance"] < 1e-5


def test_pins_are_led_from_wherever_they_start() -> None:
    body, faces = ball(0.2)
    path = np.linspace(0.0, 1.0, 5)[:, None, None] * [1.0, 0.0, 0.0] + body[:2]
    dressed = DressedBody(body, faces, np.arange(2), path, faces, np.repeat(body[None], 5, axis=0))
    start = body + 1e-3
    led = dressed.led(start, 4)
    np.testing.assert_allclose(led[:2], start[:2] + [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(led[2:], start[2:])


def test_a_part_is_read_as_it_was_stored(made, tmp_path: Path) -> None:
    part, _ = made(2, [True])
    save_part(tmp_path, 2, part)
    assert [path.name for path in tmp_path.iterdir()] == ["000002.npz"]
    found = load_part(tmp_path, 2)
    for piece in ("body", "garment", "sequence"):
        stored, read = vars(getattr(part, piece)), vars(getattr(found, piece))
        assert stored.keys() == read.keys()
        for name, value in stored.items():
            np.testing.assert_equal(read[name], value)


def test_a_part_of_a_sheet_has_no_body(tmp_path: Path) -> None:
    sheet = GarmentFile(write(tmp_path / "sheets.h5", header(), sequences())).part("000001")
    save_part(tmp_path, 1, sheet)
    found = load_part(tmp_path, 1)
    assert found.body is None
    np.testing.assert_array_equal(found.garment.faces, sheet.garment.faces)
    np.testing.assert_array_equal(found.sequence.positions, sheet.sequence.positions)
    assert (found.sequence.fabric, found.sequence.attempts) == ("denim", 2)


def test_a_garment_is_drawn_on_a_body():
    with pytest.raises(DrapeError, match="found sheet, which is on no body"):
        draw_attempt(Choice("train", "sheet", "silk"), {}, np.random.default_rng(0))
