"""Checkpoints of neural simulators: plain containers, checked by an example when they are loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import torch
from hydra.errors import InstantiationException
from torch import Tensor, nn

from drape import __version__
from drape.config import build_from_file
from drape.config.resolvers import SHIPPED
from drape.energy.law.checkpoint import FORMAT, TOLERANCE, read_checkpoint, versions
from drape.energy.step import ObstacleStep, Step
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import Material
from drape.scene.scene import Scene
from drape.simulators.neural.cloths import Cloths
from drape.simulators.neural.neural import NeuralSimulator
from drape.stored import reading

BUILT = ("model", "contact")
"""Config groups whose objects a checkpoint may ask for."""
APART = ("mesh", "obstacle", "touching", "fabric")
"""Parts of a step that an example does not have as they are."""


class Trained(NamedTuple):
    """Content of a checkpoint."""

    network: nn.Module
    cloths: Cloths
    training: dict[str, Any]
    """Its description: row, label, ablation, scale, seed, iterations, seconds, parameters, command."""


def training_name(training: Mapping[str, Any]) -> str:
    """Name of a described training: the user's own where one was given, that of its row in files of before."""
    return training.get("name", training["row"])


def describe_simulator(
    config: dict[str, Any], training: dict[str, Any], network: nn.Module, step: Step, material: Material
) -> dict:
    """Self-description of a checkpoint; ``step``, of one garment of ``material``, becomes its example."""
    with torch.no_grad():
        predicted = network(step)
    tensors = {f.name: getattr(step, f.name) for f in fields(step) if f.name not in APART}
    body = None if step.obstacle is None else {f.name: getattr(step.obstacle, f.name) for f in fields(step.obstacle)}
    return {
        "format": FORMAT,
        "simulator": config["model"],
        "training": training,
        "config": config,
        "versions": versions(),
        "example": {
            "rest_positions": step.mesh.rest_positions.cpu(),
            "faces": step.mesh.faces.cpu(),
            "fabric": {"name": material.name, **material.attributes},
            "step": _on_cpu(tensors),
            "body": None if body is None else _on_cpu(body),
            "acceleration": predicted.cpu(),
        },
    }


def load_simulator(path: str | Path) -> Trained:
    """The simulator of a checkpoint of ``train.py``, after its stored example has been predicted again.

    The file that was read last is read again only when it has changed.

    Raises:
        DrapeError: no such checkpoint, one of an energy, or the example differs.
    """
    path = Path(path)
    return _read(path, path.stat().st_mtime_ns if path.is_file() else None)


@lru_cache(maxsize=1)
def _read(path: Path, _changed: int | None) -> Trained:
    with reading(path, "train again"):
        return _trained(read_checkpoint(path), path)


def _trained(content: dict[str, Any], path: Path) -> Trained:
    described = content["drape"]
    if "simulator" not in described:
        raise DrapeError(
            f"{path}: found the checkpoint of an energy; expected one of a simulator, from python src/train.py "
            "model=mgn_s_eunet or its like; energies are for energy=eunet"
        )
    prefix = "network."
    state = {k.removeprefix(prefix): v for k, v in content["state_dict"].items() if k.startswith(prefix)}
    try:
        network, cloths = (
            build_from_file(_shipped_here(described["simulator"][name]), BUILT, f"{path}: simulator.{name}")
            for name in ("network", "cloths")
        )
        network.load_state_dict(state)
    except (InstantiationException, RuntimeError) as error:
        raise DrapeError(
            f"{path}: its network cannot be built by this program ({str(error).splitlines()[0]}); it was written by "
            f"version {described['versions']['drape']}, this is {__version__}: use that version, or train again"
        ) from error
    network.eval().requires_grad_(False)
    _check_example(network, cloths, described["example"], path)
    return Trained(network, cloths, dict(described["training"]))


def neural(checkpoint: str, scene: Scene, device: str = "cpu") -> NeuralSimulator:
    """The trained simulator of ``checkpoint`` for ``scene``; see :func:`load_simulator` for errors."""
    trained = load_simulator(checkpoint)
    return NeuralSimulator(trained.network, trained.cloths, scene, device)


def _shipped_here(node: object) -> object:
    """The ``node`` of a config with the files that come with the program where they are on this machine."""
    if isinstance(node, Mapping):
        return {key: _shipped_here(value) for key, value in node.items()}
    if isinstance(node, str) and Path(node).parts[-3:-1] == SHIPPED.parts[-2:]:
        return str(SHIPPED / Path(node).name)
    return node


def _check_example(network: nn.Module, cloths: Cloths, example: dict[str, Any], path: str | Path) -> None:
    mesh = ClothMesh.from_faces(example["rest_positions"].numpy(), example["faces"].numpy())
    body = None if example["body"] is None else ObstacleStep(**example["body"])
    material = Material.from_settings(example["fabric"]["name"], example["fabric"])
    fabric = cloths.terms(material)
    step = Step(mesh=MeshBatch.from_meshes([mesh]), obstacle=body, fabric=fabric, **example["step"])
    with torch.no_grad():
        predicted = network(step)
    difference = float((predicted - example["acceleration"]).norm() / example["acceleration"].norm().clamp(min=1e-12))
    if not difference < TOLERANCE:
        raise DrapeError(
            f"{path}: the accelerations of the stored example differ by {difference:.1e} of their size here (at most "
            f"{TOLERANCE:.0e} expected); the program has changed since: use the version that wrote the file, or train "
            "again"
        )


def _on_cpu(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value.cpu() if isinstance(value, Tensor) else value for name, value in values.items()}
