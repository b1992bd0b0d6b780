r"""``.pc16``: Blender's PC2 point cache with half-precision numbers.

32 bytes come first (little endian): ``POINTCACHE2\0``, version (int32, 1), points (int32), start (float32), rate
(float32), samples (int32); then samples x points x 3 float16.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError

TAG = b"POINTCACHE2\0"
LAYOUT = struct.Struct("<12siiffi")
DOWNLOAD = "copy or download it again"


def pc16_shape(path: Path) -> tuple[int, int]:
    """(samples, points) of a file; its length is checked against them.

    Raises:
        DrapeError: no such file, another tag or version, another length than that of so many numbers.
    """
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; expected the frames of the garment; {DOWNLOAD}")
    size = path.stat().st_size
    with open(path, "rb") as file:
        lead = file.read(LAYOUT.size)
    if len(lead) < LAYOUT.size or lead[: len(TAG)] != TAG:
        raise DrapeError(
            f"{path}: found {size} bytes that begin with {lead[: len(TAG)]!r}; expected {TAG!r}: this is no point "
            f"cache; {DOWNLOAD}"
        )
    _, version, points, _, _, samples = LAYOUT.unpack(lead)
    if version != 1 or points < 1 or samples < 1:
        raise DrapeError(
            f"{path}: found version {version}, {points} points, {samples} samples; expected version 1 and at least one "
            f"of each; {DOWNLOAD}"
        )
    expected = LAYOUT.size + samples * points * 3 * 2
    if size != expected:
        raise DrapeError(
            f"{path}: found {size} bytes; expected {expected}, for {samples} samples of {points} points in float16; it "
            f"is cut off, or a PC2 in float32; {DOWNLOAD}"
        )
    return samples, points


def read_pc16(path: Path, start: int, stop: int) -> Float[np.ndarray, "frames points 3"]:
    """Samples ``start`` to ``stop`` (exclusive) [m]: multiples of 0.5 to 1 mm at a distance of 1 m, as stored.

    Raises:
        DrapeError: samples that are not there, a number that is not finite, or see :func:`pc16_shape`.
    """
    samples, points = pc16_shape(path)
    if not 0 <= start < stop <= samples:
        raise DrapeError(f"{path}: found {samples} samples; expected samples {start} to {stop}; ask for fewer")
    offset = LAYOUT.size + start * points * 6
    stored = np.fromfile(path, "<f2", (stop - start) * points * 3, offset=offset).reshape(stop - start, points, 3)
    finite = np.isfinite(stored).all(axis=(1, 2))
    if not finite.all():
        raise DrapeError(
            f"{path}: sample {start + int(np.argmin(finite))}: found a number that is not finite; expected positions "
            f"[m]; {DOWNLOAD}"
        )
    return stored.astype(np.float32)
