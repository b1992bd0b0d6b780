"""What a training goes on from, who may go on, and which errors of the system are sentences."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest
import torch

from drape.config.entry_point import refusal
from drape.errors import DrapeError
from drape.training.continuation import LOCK, alone, newest
from tests.energies import PAPER, make_energy, write_checkpoint


def test_two_trainings_in_one_folder(tmp_path: Path):
    with alone(tmp_path):
        with pytest.raises(DrapeError, match="another training is at work there"), alone(tmp_path):
            pass
        assert (tmp_path / LOCK).exists()
    with alone(tmp_path):
        pass


def test_a_torn_checkpoint_is_passed_over(tmp_path: Path, cloth_batch, capsys):
    assert newest(tmp_path) is None
    for number, name in enumerate(("step_1", "step_2", "last")):
        write_checkpoint(tmp_path / f"{name}.ckpt", make_energy("mlp", "none").float(), PAPER, cloth_batch)
        os.utime(tmp_path / f"{name}.ckpt", (number, number))
    assert newest(tmp_path) == tmp_path / "last.ckpt"
    whole = (tmp_path / "last.ckpt").read_bytes()
    (tmp_path / "last.ckpt").write_bytes(whole[: len(whole) // 2])
    assert newest(tmp_path) == tmp_path / "step_2.ckpt"
    torch.save({"state_dict": {}}, tmp_path / "step_2.ckpt")
    assert newest(tmp_path) == tmp_path / "step_1.ckpt"
    assert "last.ckpt: cannot be read as a checkpoint" in capsys.readouterr().err


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_no_space_is_a_sentence_whoever_says_it(number):
    for error in (OSError(number, os.strerror(number), "a"), RuntimeError(f"unable to write (errno = {number})")):
        assert "make space on the disk" in refusal(error)


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES])
def test_no_place_is_a_sentence_whoever_says_it(number):
    for error in (OSError(number, "no", "a/b"), RuntimeError(f"[Errno {number}] cannot create")):
        assert refusal(error).startswith("cannot use")
    assert refusal(RuntimeError("a fault of the program")) is None
