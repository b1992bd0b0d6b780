"""Checkpoints that explain themselves: plain containers, loaded without executing anything, checked by an example."""

from __future__ import annotations

from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
from hydra.errors import InstantiationException
from torch import Tensor

from drape import __version__
from drape.config import build_from_file
from drape.data.whole_file import whole_file
from drape.data.windows import Window
from drape.energy.law.eunet import EUNet
from drape.energy.law.step_energies import StepEnergies
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.stored import reading

FORMAT = 1
"""Version of what ``checkpoint["drape"]`` holds."""
TOLERANCE = 1e-4
"""Relative difference of energy and forces up to which an example counts as reproduced."""


def versions() -> dict[str, str]:
    """Versions of this program and of what its numbers depend on."""
    return {"drape": __version__} | {name: version(name) for name in ("torch", "lightning", "numpy")}


def describe(config: dict[str, Any], energy: EUNet, window: Window) -> dict[str, Any]:
    """Self-description of a checkpoint: config, versions, and the energy and forces of one window as an example."""
    step = StepEnergies(energy, window, training=False)
    return {
        "format": FORMAT,
        "config": config,
        "versions": versions(),
        "example": {
            "rest_positions": window.mesh.rest_positions.cpu(),
            "faces": window.mesh.faces.cpu(),
            "num_meshes": window.mesh.num_meshes,
            "window": {f.name: getattr(window, f.name) for f in fields(window) if f.name != "mesh"},
            "change": step.change.detach().cpu(),
            "gradient": step.gradient.detach().cpu(),
        },
    }


def load_energy(path: str | Path) -> EUNet:
    """The energy of a checkpoint, in evaluation mode, after its stored example has been evaluated again.

    Raises:
        DrapeError: not a checkpoint of this program or of this format, or the example's energy or forces differ.
    """
    with reading(path, "train again"):
        return _load(read_checkpoint(path), path)


def _load(content: dict[str, Any], path: str | Path) -> EUNet:
    prefix = "energy."
    state = {k.removeprefix(prefix): v for k, v in content["state_dict"].items() if k.startswith(prefix)}
    try:
        energy = build_from_file(content["drape"]["config"]["model"], ("model", "net"), f"{path}: config.model")
        energy.load_state_dict(state)
    except (InstantiationException, RuntimeError) as error:
        made = content["drape"]["versions"]["drape"]
        raise DrapeError(
            f"{path}: its energy cannot be built by this program ({str(error).splitlines()[0]}); it was written by "
            f"version {made}, this is {__version__}: use that version, or train again"
        ) from error
    energy.eval().requires_grad_(False)
    _check_example(energy, content["drape"]["example"], path)
    return energy


def write_shareable(path: str | Path, target: str | Path) -> None:
    """Write a checkpoint with all that :func:`load_energy` needs and nothing of the machine that trained it.

    Optimizer states are left out, and of the configuration what names folders (callbacks, loggers).
    """
    content = read_checkpoint(path)
    described = dict(content["drape"])
    described["config"] = {k: v for k, v in described["config"].items() if k not in ("callbacks", "logger", "trainer")}
    with whole_file(Path(target)) as temporary:
        torch.save({"state_dict": content["state_dict"], "drape": described}, temporary)


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """The plain content of a checkpoint; ``weights_only``, so nothing in the file is executed.

    Raises:
        DrapeError: no such file, not a checkpoint of this program, or one of another format.
    """
    if not Path(path).is_file():
        raise DrapeError(f"{path}: no such checkpoint; a run keeps them in its folder checkpoints/ (last.ckpt)")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise DrapeError(f"{path}: cannot be read as a checkpoint ({type(error).__name__}); train again") from error
    if not isinstance(content, dict) or "drape" not in content:
        raise DrapeError(f"{path}: not a checkpoint of drape; expected one written by python src/train.py")
    with reading(path, "train again"):
        found = content["drape"].get("format")
        if found != FORMAT:
            raise DrapeError(f"{path}: checkpoint format {found}; this program reads {FORMAT}; train again")
        _check_tensors(content["state_dict"], f"{path}: state_dict")
        _check_tensors(content["drape"]["example"], f"{path}: example")
    return content


def _check_tensors(tree: dict[str, Any], where: str) -> None:
    """Refuse tensors that are not finite, at any depth."""
    for name, value in tree.items():
        if isinstance(value, dict):
            _check_tensors(value, f"{where}.{name}")
        elif isinstance(value, Tensor) and not torch.isfinite(value).all():
            raise DrapeError(f"{where}.{name}: found numbers that are not finite; expected those of a training")


def _check_example(energy: EUNet, example: dict[str, Any], path: str | Path) -> None:
    for name, value in example["window"].items():
        if not isinstance(value, float if name == "dt" else Tensor):
            raise DrapeError(f"{path}: example.window.{name}: found a {type(value).__name__}; expected numbers")
    count = example["num_meshes"]
    vertices, faces = len(example["rest_positions"]) // count, len(example["faces"]) // count
    mesh = ClothMesh.from_faces(example["rest_positions"][:vertices].numpy(), example["faces"][:faces].numpy())
    window = Window(mesh=MeshBatch.from_meshes([mesh] * count), **example["window"])
    step = StepEnergies(energy, window, training=False)
    for name, found in {"energy": (step.change, "change"), "forces": (step.gradient, "gradient")}.items():
        value, expected = found[0].detach(), example[found[1]]
        difference = float((value - expected).abs().max() / expected.abs().max())
        if not difference < TOLERANCE:
            raise DrapeError(
                f"{path}: the {name} of the stored example differ by {difference:.1e} of their size here (at most "
                f"{TOLERANCE:.0e} expected); the program has changed since: use the version that wrote the file, "
                "or train again"
            )
