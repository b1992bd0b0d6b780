"""What of a recording a training sees: stride, noise of the training split only, the same in every window."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from drape.data.datamodule import TrajectoryDataModule
from drape.data.observation import Observation
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES
from tests.trajectories import header, sequences, write


def module(path: Path, **seen: float) -> TrajectoryDataModule:
    scales = dict.fromkeys(ATTRIBUTES, 1.0)
    return TrajectoryDataModule(str(path), ["silk", "denim"], 2, 2, scales, seed=0, observation=Observation(**seen))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("observation") / "cloth.h5"
    write(target, header(), sequences(frames=8))
    return target


def test_every_second_frame_is_seen_and_time_is_that_between_them(path: Path) -> None:
    data = module(path, stride=2)
    assert data._windows_of.tolist() == [4] * 4
    window = data.windows(data.train_sequences, np.array([1]))
    frames = torch.from_numpy(data.file.sequences[data.train_sequences[0]].positions).double()
    for x, frame in ((window.x_prev, 1), (window.x, 3), (window.x_next, 5)):
        assert torch.equal(x, frames[frame])
    assert window.dt == pytest.approx(2 * data.file.dt)


def test_a_vertex_has_one_noise_in_a_frame_and_it_has_the_size_that_was_asked_for(path: Path) -> None:
    data, noise = module(path, noise=0.01), 0.01
    first, second = (data.windows(data.train_sequences, np.array([start])) for start in (0, 1))
    assert torch.equal(first.x_next, second.x)
    there = torch.from_numpy(data.file.sequences[data.train_sequences[0]].positions).double()
    off = torch.cat([first.x_prev - there[0], first.x - there[1], first.x_next - there[2]])
    assert off.std() == pytest.approx(noise, rel=0.2)
    assert abs(float(off.mean())) < 3 * noise / off.numel() ** 0.5
    again = module(path, noise=0.01, seed=1).windows(data.train_sequences, np.array([0]))
    assert not torch.equal(again.x, first.x)


def test_the_test_split_is_as_recorded(path: Path) -> None:
    data = module(path, noise=0.01)
    window = data.windows(data.test_sequences, np.array([0]))
    assert torch.equal(window.x, torch.from_numpy(data.file.sequences[data.test_sequences[0]].positions[1]).double())


def test_more_frames_between_than_there_are_is_a_sentence(path: Path) -> None:
    with pytest.raises(DrapeError, match="8 frames in a sequence; a window needs 9"):
        module(path, stride=4)


@pytest.mark.parametrize("seen", [{"noise": -1.0}, {"noise": float("nan")}, {"stride": 0}])
def test_what_cannot_be_seen_is_a_sentence(seen: dict[str, float]) -> None:
    with pytest.raises(DrapeError, match=f"observation.{next(iter(seen))}: found"):
        Observation(**seen)


def test_windows_apart_are_of_the_same_sequence_some_frames_away(path: Path) -> None:
    data = module(path)
    batches = list(data.windows_apart(100, 4, [1, 2]))
    frames = [torch.from_numpy(data.file.sequences[number].positions).double() for number in data.train_sequences]
    wanted = [positions[start] for positions in frames for start in (2, 3)]
    assert torch.equal(torch.cat([batch[0].x_prev for batch in batches]), torch.cat(wanted))
    for column, shift in enumerate((-1, 1, -2, 2), start=1):
        moved = [positions[start + shift] for positions in frames for start in (2, 3)]
        assert torch.equal(torch.cat([batch[column].x_prev for batch in batches]), torch.cat(moved))
    with pytest.raises(DrapeError, match="8 frames a sequence; windows with others 3 frames before and after need 9"):
        next(data.windows_apart(1, 1, [3]))
