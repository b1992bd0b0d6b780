"""Messages of Lightning that tell a user of this program nothing, or something wrong."""

from __future__ import annotations

import logging
import warnings

TIPS = "💡 Tip"
"""Beginning of Lightning's advertisements."""
WARNINGS = (
    "Experiment logs directory .* exists and is not empty",  # of a continued training; metrics_csv.py saves its rows
    "Checkpoint directory .* exists and is not empty",  # of a continued training; that is what it continues from
    r"The number of training batches \(\d+\) is smaller than the logging interval",  # steps are counted over epochs
    "Using ModelCheckpoint with manual optimization",  # saves after the update, as it should
    r"`isinstance\(treespec, LeafSpec\)` is deprecated",  # Lightning's own use of PyTorch
)
"""Beginnings of warnings, as regular expressions."""


def silence() -> None:
    """Keep back these messages, and no others, from now on."""
    for beginning in WARNINGS:
        warnings.filterwarnings("ignore", message=beginning)
    logging.getLogger("lightning.pytorch.utilities.rank_zero").addFilter(_is_no_tip)


def _is_no_tip(record: logging.LogRecord) -> bool:
    return not record.getMessage().startswith(TIPS)
