"""The law of one fabric as splines on disk: what is read is what was baked, or a sentence."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from drape.data.whole_file import whole_file
from drape.energy.law.baked.hinges import BakedHinges, Certificate, Samples
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.errors import DrapeError
from drape.scene.material import ATTRIBUTES, Material

FORMAT = "drape baked law"
VERSION = 3
NUMBERS = ("stretch_scale", "angle_scale", "face_area", "damper", "drag")
"""Numbers in the file: arguments of :class:`BakedHinges` of the same names."""
SHAPES = {
    **dict.fromkeys(NUMBERS, ()),
    "table": (2, "nodes", "nodes"),
    "first": (2,),
    "step": (2,),
    "attributes": (len(ATTRIBUTES),),
    "samples": ("samples", 5),
    "constants": (3,),
}
"""Of every number that is used; a word stands for any number from 1 on."""
POSITIVE = ("stretch_scale", "angle_scale", "face_area", "step")
ANY_SIGN = ("first", "samples")
ROUNDING = 1e-9
"""Relative difference of stored samples up to which the certificate of a table that is read holds."""


def save_baked(law: BakedHinges, path: Path) -> None:
    """Write ``law`` and its certificate; the file is whole or not there."""
    content = {name: getattr(law, name) for name in NUMBERS}
    content |= {"fabric": asdict(law.fabric), "attributes": law.attributes.tolist()}
    content |= {"format": FORMAT, "version": VERSION, "first": law.plane.first, "step": law.plane.step}
    content |= {"certificate": asdict(law.certificate)}
    q, energy, slopes, constants = law.samples
    arrays = {
        "content": np.array(json.dumps(content)),
        "table": law.plane.values,
        "samples": torch.cat([q, energy[:, None], slopes], 1).numpy(),
        "constants": constants.numpy(),
    }
    with whole_file(path) as temporary:
        np.savez_compressed(temporary, **arrays, digest=np.array(_digest(arrays)))


def read_baked(path: str | Path) -> BakedHinges:
    """The law of a table, after its numbers and its certificate were checked.

    Every number is as it was written (a digest of all), is one that a law can have, and at stored samples the table
    differs from the network that it was made from by no more than its certificate says; between them its nodes are as
    even as a table that exact has to be.

    Raises:
        DrapeError: no such file, not a table of this program, another version of it, or a damaged or edited one.
    """
    path = Path(path)
    content, arrays = _read(path)
    try:
        numbers = {name: np.asarray(arrays[name] if name in arrays else content[name]) for name in SHAPES}
        for name, value in numbers.items():
            _check(path, name, value)
        law = _law(content, numbers)
    except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        if isinstance(error, DrapeError):
            raise
        raise DrapeError(f"{path}: damaged: {type(error).__name__} {error}; bake it again") from error
    _check_content(path, law)
    for name, share in law.differences(law.samples).items():
        promised = getattr(law.certificate, name)
        if not share <= promised * (1.0 + ROUNDING) + ROUNDING < np.inf:
            raise DrapeError(
                f"{path}: {name}: found a difference of {share:.1e} from its network; expected at most {promised:.1e}, "
                "as its certificate says: damaged or edited; bake it again"
            )
    return law


def _read(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Content of a table of this program and version, unchanged."""
    if not path.is_file():
        raise DrapeError(f"{path}: no such table; python src/bake.py fabric=... path={path} makes one")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = json.loads(str(arrays["content"]))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DrapeError(
            f"{path}: cannot be read as a table ({type(error).__name__}): damaged, or not written by src/bake.py; "
            "bake it again"
        ) from error
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else (None, None)
    if found != (FORMAT, VERSION):
        raise DrapeError(f"{path}: found format {found}; expected {(FORMAT, VERSION)}; bake it again")
    written = str(arrays.pop("digest", ""))
    if written != _digest(arrays):
        raise DrapeError(
            f"{path}: found other numbers than were written with its certificate; expected a table as src/bake.py "
            "leaves it: damaged or edited; bake it again"
        )
    return content, arrays


def _digest(arrays: dict[str, np.ndarray]) -> str:
    """SHA-256 of all that is stored: names, types, shapes and bytes."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return digest.hexdigest()


def _check(path: Path, name: str, value: np.ndarray) -> None:
    """Refuse what no law can have: another shape, what is not a number or not finite, the wrong sign."""
    wanted = SHAPES[name]
    fits = value.ndim == len(wanted) and value.size > 0
    fits = fits and all(isinstance(size, str) or size == found for size, found in zip(wanted, value.shape, strict=True))
    if not fits or value.dtype.kind not in ("iu" if name == "first" else "fiu"):
        kind = "whole numbers" if name == "first" else "numbers"
        raise DrapeError(
            f"{path}: {name}: found {value.dtype} of shape {value.shape}; expected {kind} of shape {wanted}; "
            "bake it again"
        )
    sign = "above 0" if name in POSITIVE else "of any sign" if name in ANY_SIGN else "from 0 on"
    right = {"above 0": value > 0, "of any sign": True, "from 0 on": value >= 0}[sign]
    wrong = ~(np.isfinite(value) & right)
    if wrong.any():
        raise DrapeError(f"{path}: {name}: found {value[wrong][0]}; expected finite numbers {sign}; bake it again")


def _check_content(path: Path, law: BakedHinges) -> None:
    """Refuse a fabric that cannot be, and a certificate that is none."""
    if not isinstance(law.fabric.name, str):
        raise DrapeError(f"{path}: fabric: found the name {law.fabric.name!r}; expected a text; bake it again")
    numbers = {name: value for name, value in asdict(law.fabric).items() if name != "name" and value is not None}
    for name in ("energy", "force", "constants"):
        if type(getattr(law.certificate, name)) not in (int, float):
            raise DrapeError(f"{path}: certificate.{name}: found no number; bake it again")
    for name, value in numbers.items():
        if type(value) not in (int, float) or not 0 <= value < np.inf:
            raise DrapeError(f"{path}: {name}: found {value!r}; expected a finite number from 0 on; bake it again")


def _law(content: dict, numbers: dict[str, np.ndarray]) -> BakedHinges:
    stored = content["certificate"].items()
    law = BakedHinges(
        SplinePlane(numbers["table"], tuple(content["first"]), tuple(content["step"])),
        fabric=Material(**content["fabric"]),
        attributes=torch.tensor(content["attributes"], dtype=torch.float64),
        **{name: content[name] for name in NUMBERS},
    )
    facts: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in stored}
    law.certificate = Certificate(**facts)
    samples, constants = torch.from_numpy(numbers["samples"]), torch.from_numpy(numbers["constants"])
    law.samples = Samples(samples[:, :2], samples[:, 2], samples[:, 3:], constants)
    return law
