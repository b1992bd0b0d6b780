"""Tables of baked laws on disk: numpy's npz, plain arrays and one line of JSON, nothing that is executed."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch

from drape.data.whole_file import whole_file
from drape.energy.baked_law import BakedLaw
from drape.energy.certificate import Certificate
from drape.energy.cubic_spline import SplineLine, SplineTable
from drape.errors import DrapeError
from drape.scene.material import Material

FORMAT = "drape baked law"
VERSION = 1
NUMBERS = ("bends", "face_area", "dt", "stretch_scale", "speed_scale", "rest_drag", "rest_hessian")
"""What stands in the file as the arguments of :class:`BakedLaw` of the same names."""


def save_baked(law: BakedLaw, path: Path) -> None:
    """Write ``law`` and its certificate; the file is whole or not there."""
    parts = {"table": law.table, "line": law.line}
    splines = {name: {"first": part.first, "step": part.step} for name, part in parts.items() if part is not None}
    content = {name: getattr(law, name) for name in NUMBERS}
    content |= {"fabric": asdict(law.fabric), "attributes": law.attributes.tolist()}
    content |= {"format": FORMAT, "version": VERSION, "splines": splines, "certificate": asdict(law.certificate)}
    arrays = {name: part.coefficients().cpu().numpy() for name, part in parts.items() if part is not None}
    with whole_file(path) as temporary:
        np.savez_compressed(temporary, content=np.array(json.dumps(content)), **arrays)


def read_baked(path: str | Path) -> BakedLaw:
    """The law of a table.

    Raises:
        DrapeError: no such file, not a table of this program, another version of it, or a damaged one.
    """
    path = Path(path)
    if not path.is_file():
        raise DrapeError(f"{path}: no such table; python src/bake.py fabric=... table.path={path} makes one")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = json.loads(str(arrays.pop("content")))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise DrapeError(
            f"{path}: cannot be read as a table ({type(error).__name__}): damaged, or not written by src/bake.py; "
            "bake it again"
        ) from error
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else (None, None)
    if found != (FORMAT, VERSION):
        raise DrapeError(f"{path}: found format {found}; expected {(FORMAT, VERSION)}; bake it again")
    try:
        return _law(content, arrays)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise DrapeError(f"{path}: damaged: {type(error).__name__} {error}; bake it again") from error


def _law(content: dict, arrays: dict[str, np.ndarray]) -> BakedLaw:
    splines = {
        name: kind(torch.from_numpy(arrays[name]), **content["splines"][name])
        for name, kind in (("table", SplineTable), ("line", SplineLine))
        if name in content["splines"]
    }
    numbers = {name: content[name] for name in NUMBERS}
    numbers["rest_hessian"] = torch.tensor(numbers["rest_hessian"], dtype=torch.float64)
    numbers["rest_drag"] = tuple(numbers["rest_drag"])
    stored = content["certificate"].items()
    certificate = Certificate(**{key: tuple(value) if isinstance(value, list) else value for key, value in stored})
    return BakedLaw(
        fabric=Material(**content["fabric"]),
        attributes=torch.tensor(content["attributes"], dtype=torch.float64),
        table=splines["table"], line=splines.get("line"), certificate=certificate, **numbers,
    )  # fmt: skip
