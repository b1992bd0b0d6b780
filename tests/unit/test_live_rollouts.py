"""Pictures of a simulator in training: files, loggers, and that they show what the network does."""

from __future__ import annotations

from pathlib import Path

import lightning
import numpy as np
import pytest
import torch
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger, WandbLogger
from PIL import Image
from torch import nn

from drape.data.hdf5 import GarmentFile
from drape.data.recorded_scene import START
from drape.data.sequence_loader import Watched
from drape.metrics.rollout_scores import ScoredRollout, rollout_scores
from drape.report.live_images import ROLLOUTS, RolloutImages
from drape.report.rollout_sheet import draw_rollout_sheet
from drape.scene.material import ATTRIBUTES
from drape.simulators.neural.cloths import RecordedCloths
from drape.training.simulator_training import KEPT, SimulatorTraining
from tests import garments

CLOTHS = RecordedCloths(dict.fromkeys(ATTRIBUTES, 1.0))


class Accelerates(nn.Module):
    """A network that pushes everything sideways."""

    def __init__(self, by: float):
        super().__init__()
        self.by = nn.Parameter(torch.tensor(by))

    def forward(self, step):
        return torch.zeros_like(step.x) + self.by * torch.tensor([1.0, 0.0, 0.0], dtype=step.x.dtype)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    with GarmentFile(garments.write(tmp_path_factory.mktemp("garments") / "garments.h5", frames=9)) as file:
        yield file


def rollout(file: GarmentFile, by: float, name: str = "00001", frames: int | None = None) -> ScoredRollout:
    return rollout_scores(Accelerates(by), CLOTHS, file.sequence(name), frames)


class Halted(lightning.Trainer):
    """A trainer after a validation at step 40."""

    is_global_zero, global_step, loggers = True, 40, ()

    def __init__(self, fast_dev_run: int = 0, is_global_zero: bool = True, loggers: tuple = ()):
        self.fast_dev_run, self.is_global_zero, self.loggers = fast_dev_run, is_global_zero, loggers


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), dtype=float)


def drawn(folder: Path, watched: list[ScoredRollout], **about: object) -> Path:
    module = lightning.LightningModule()
    module.watched = watched
    RolloutImages(str(folder)).on_validation_end(Halted(**about), module)
    return folder / "figures" / "rollouts.png"


def test_frames_and_scores_belong_together(file):
    """The frames are those that are scored, from the first recorded one with a velocity."""
    found = rollout(file, 3.0)
    recorded = found.sequence.positions[START:]
    assert found.x.shape == recorded.shape
    np.testing.assert_array_equal(found.x[0], recorded[0])
    error = 1e3 * np.linalg.norm(found.x - recorded, axis=-1).mean(axis=1)
    assert found.scores["error_mm"] == pytest.approx(error[1:].mean())
    assert found.scores["last_error_mm"] == pytest.approx(error[-1])
    assert len(rollout(file, 3.0, frames=2).x) == 3


def test_a_validation_leaves_a_picture(file, tmp_path):
    """Two lines of pictures for a sequence, with something in every column."""
    path = drawn(tmp_path, [rollout(file, 0.0), rollout(file, 0.0, "00002")])
    picture = pixels(path)
    one = pixels(draw_rollout_sheet([rollout(file, 0.0)], tmp_path / "one.png"))
    assert picture.shape[0] == pytest.approx(2 * one.shape[0], abs=2)
    assert picture.shape[1] == one.shape[1]
    left = 60
    for line in np.array_split(picture[:, left:], 4):
        for cell in np.array_split(line, 6, axis=1):
            assert cell.std() > 5.0
    assert list(tmp_path.joinpath("figures").iterdir()) == [path]


def test_the_picture_shows_the_prediction(file, tmp_path):
    """The lower line changes with the network, the upper one is the recorded garment and does not."""
    upper, lower = [], []
    for k, by in enumerate((0.0, 0.0, 20.0)):
        picture = pixels(drawn(tmp_path / str(k), [rollout(file, by)]))[:, 60:]
        half = picture.shape[0] // 2
        upper.append(picture[: half - 4])
        lower.append(picture[half + 4 :])
    assert np.array_equal(lower[0], lower[1])
    assert np.abs(lower[0] - lower[2]).mean() > 1.0
    assert np.array_equal(upper[0], upper[2])


def test_the_recorded_frames_have_no_error(file, tmp_path):
    """Nothing is red where the prediction is the recording; a garment 5 cm beside it is redder."""
    found = rollout(file, 0.0)
    exact = found._replace(x=found.sequence.positions[START:])
    beside = exact._replace(x=exact.x + [0.05, 0.0, 0.0])
    red = []
    for k, each in enumerate((exact, beside)):
        picture = pixels(draw_rollout_sheet([each], tmp_path / f"{k}.png"))[:, 60:]
        below = picture[picture.shape[0] // 2 :]
        red.append(int((below[..., 0] - below[..., 2] > 25).sum()))
    assert red[0] == 0
    assert red[1] > 200


@pytest.mark.parametrize("frames", [1, 3])
def test_short_sequences_fill_as_many_columns(file, tmp_path, frames):
    """Beside one that fills them all."""
    path = draw_rollout_sheet([rollout(file, 0.0, frames=frames), rollout(file, 0.0)], tmp_path / "short.png")
    picture = pixels(path)
    shown = [cell.std() > 5.0 for cell in np.array_split(picture[: len(picture) // 2, 60:], 6, axis=1)]
    assert shown == [True] * frames + [False] * (6 - frames)


def test_a_garment_that_has_flown_away_is_no_error(file, tmp_path):
    found = rollout(file, 0.0)
    drawn(tmp_path, [found._replace(x=found.x + np.linspace(0, 1e6, len(found.x))[:, None, None])])


def test_loggers_get_it_under_its_key(file, tmp_path):
    sent = []
    board = TensorBoardLogger(tmp_path)
    board.experiment.add_image = lambda key, image, step, dataformats: sent.append((key, image.shape, step))
    wandb = WandbLogger.__new__(WandbLogger)
    wandb.log_image = lambda key, images, step: sent.append((key, images, step))
    path = drawn(tmp_path, [rollout(file, 0.0)], loggers=(board, wandb, CSVLogger(tmp_path)))
    height, width, _ = pixels(path).shape
    assert sent == [(ROLLOUTS, (height, width, 3), 40), ("figures/rollouts", [str(path)], 40)]


@pytest.mark.parametrize("change", [{"fast_dev_run": 2}, {"is_global_zero": False}])
def test_trials_and_other_processes_are_silent(file, tmp_path, change):
    drawn(tmp_path, [rollout(file, 0.0)], **change)
    assert list(tmp_path.iterdir()) == []


def test_without_watched_sequences_nothing_is_drawn(tmp_path):
    drawn(tmp_path, [])
    assert list(tmp_path.iterdir()) == []


def test_a_training_keeps_the_first_sequences_of_the_last_validation(file):
    training = SimulatorTraining.__new__(SimulatorTraining)
    nn.Module.__init__(training)
    training.network, training.cloths, training.watched = Accelerates(0.0), CLOTHS, []
    logged = []
    training.log = lambda name, value, **_: logged.append(name)
    names = ["00001", "00002", "00001"]
    for first in (names, names[1:]):
        training.on_validation_epoch_start()
        for k, name in enumerate(first):
            training.validation_step(Watched(file.sequence(name)), k)
        assert [each.sequence.name for each in training.watched] == first[:KEPT]
    assert set(logged) >= {"val/error_mm", "val/ms_per_frame"}
