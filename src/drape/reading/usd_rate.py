"""Frames per second of USD files, by OpenUSD itself: Blender, which reads the meshes, does not tell."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from drape.errors import DrapeError


def usd_rate(path: Path) -> float | None:
    """Time codes per second; 24 where the file does not say, as the format defines. None without OpenUSD (usd-core).

    Raises:
        DrapeError: a file that OpenUSD cannot open.
    """
    if importlib.util.find_spec("pxr") is None:
        return None
    from pxr import Tf, Usd

    try:
        return float(Usd.Stage.Open(str(path), Usd.Stage.LoadNone).GetTimeCodesPerSecond())
    except Tf.ErrorException as error:
        reason = str(error).splitlines()[-1].strip()
        raise DrapeError(f"{path}: OpenUSD cannot open it ({reason}); export it again") from error
