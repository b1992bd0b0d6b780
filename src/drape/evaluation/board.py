"""An evaluation in TensorBoard: scores against the frame, compared with other evaluations."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from torch.utils.tensorboard import SummaryWriter

from drape.evaluation.scored_sequence import ScoredSequence, mean_by_frame
from drape.metrics.fabric_metric import OVERALL
from drape.metrics.garment_scores import SCORES

FOLDER = "tensorboard"


def write_board(scored: Sequence[ScoredSequence], folder: Path) -> Path:
    """Write ``tensorboard/``: for each score and kind (``evaluate/error_mm/dress``) the mean over sequences by frame.

    What an earlier evaluation of the same folder has written there is replaced.
    """
    path = folder / FOLDER
    shutil.rmtree(path, ignore_errors=True)
    kinds = list(dict.fromkeys(each.kind for each in scored))
    with SummaryWriter(str(path)) as writer:
        for kind in (*kinds, OVERALL):
            of_kind = [each for each in scored if kind in (each.kind, OVERALL)]
            for score in SCORES:
                for frame, mean in enumerate(mean_by_frame(of_kind, score), 1):
                    if np.isfinite(mean):
                        writer.add_scalar(f"evaluate/{score}/{kind}", mean, frame)
    return path

