"""``info.mat``: who moves how, and wears what, in one sequence of CLOTH3D."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.io import loadmat

from drape.errors import DrapeError

GENDERS = ("female", "male")
"""``gender`` counts in this order."""
FIELDS = ("gender", "poses", "shape", "trans", "outfit", "zrot")


@dataclass(frozen=True, eq=False)
class SequenceInfo:
    """One sequence: motion and shape of its SMPL body, and the fabrics of its garments."""

    gender: str
    poses: Float[np.ndarray, "frames 72"]
    """Axis-angle of every joint relative to its parent [rad]."""
    shape: Float[np.ndarray, " shapes"]
    trans: Float[np.ndarray, "frames 3"]
    """Position of the root joint [m]; z is up."""
    fabrics: Mapping[str, str]
    """Garment -> fabric, in CLOTH3D's words."""
    tightness: tuple[float, ...]
    zrot: float
    """Angle by which the rest meshes were turned about z, and the frames were not [rad]."""

    @property
    def num_frames(self) -> int:
        return len(self.poses)


def read_info(path: Path) -> SequenceInfo:
    """Read an ``info.mat``. MATLAB drops dimensions of length one: those of a single frame are put back.

    Raises:
        DrapeError: no such file, no MATLAB file, a field that is missing or of another shape.
    """
    if not path.is_file():
        raise DrapeError(f"{path}: no such file; expected a sequence of CLOTH3D; copy or download it again")
    try:
        found = loadmat(path, simplify_cells=True)
    except Exception as error:  # a damaged file may fail in any way
        raise DrapeError(
            f"{path}: cannot be read as a MATLAB file ({type(error).__name__}: {error}); copy or download it again"
        ) from error
    missing = [name for name in FIELDS if name not in found]
    if missing:
        names = sorted(name for name in found if not name.startswith("__"))
        raise DrapeError(
            f"{path}: found the fields {', '.join(names) or 'none'}; expected {', '.join(FIELDS)}; missing "
            f"{', '.join(missing)}; copy or download it again"
        )
    poses = _numbers(path, "poses", found["poses"], 72)
    trans = _numbers(path, "trans", found["trans"], 3)
    if len(poses) != len(trans):
        raise DrapeError(
            f"{path}: found {len(poses)} frames of poses and {len(trans)} of trans; expected the same number"
        )
    return SequenceInfo(
        gender=_gender(path, found["gender"]),
        poses=poses,
        shape=_numbers(path, "shape", found["shape"], None)[0],
        trans=trans,
        fabrics=_fabrics(path, found["outfit"]),
        tightness=tuple(np.atleast_1d(np.asarray(found.get("tightness", ()), np.float64)).tolist()),
        zrot=float(_numbers(path, "zrot", found["zrot"], 1)[0, 0]),
    )


def _numbers(path: Path, name: str, value: Any, rows: int | None) -> Float[np.ndarray, "frames rows"]:
    """A matrix of a column per frame, as rows of frames; None: a single vector of any length."""
    try:
        columns = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise DrapeError(f"{path}: {name}: found {type(value).__name__}; expected numbers") from None
    if rows is None:
        columns = columns.reshape(-1, 1)
    elif columns.size == rows:
        columns = columns.reshape(rows, 1)
    if columns.ndim != 2 or columns.shape[0] != (rows or columns.shape[0]) or columns.size == 0:
        raise DrapeError(
            f"{path}: {name}: found shape {np.shape(value)}; expected ({rows}, frames), or ({rows},) for one frame"
        )
    if not np.isfinite(columns).all():
        raise DrapeError(f"{path}: {name}: found a number that is not finite; copy or download the file again")
    return np.ascontiguousarray(columns.T)


def _gender(path: Path, value: object) -> str:
    number = np.asarray(value).reshape(-1)
    if len(number) != 1 or number[0] not in (0, 1):
        raise DrapeError(f"{path}: gender: found {value!r}; expected 0 (female) or 1 (male)")
    return GENDERS[int(number[0])]


def _fabrics(path: Path, outfit: object) -> dict[str, str]:
    if not isinstance(outfit, Mapping) or not all(isinstance(worn, Mapping) for worn in outfit.values()):
        raise DrapeError(f"{path}: outfit: found {type(outfit).__name__}; expected a struct of garments with a fabric")
    without = [garment for garment, worn in outfit.items() if not isinstance(worn.get("fabric"), str)]
    if without:
        raise DrapeError(f"{path}: outfit.{without[0]}: found no fabric; expected its name, such as cotton")
    return {garment: worn["fabric"] for garment, worn in outfit.items()}
