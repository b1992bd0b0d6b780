"""EST on disk: the network that estimates materials of PHYS, with the scales of what it reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from drape.data.whole_file import whole_file
from drape.energy.checkpoint import versions
from drape.energy.phys_material import PhysMaterial
from drape.errors import DrapeError
from drape.nets.material_net import MaterialNet
from drape.scene.material import ATTRIBUTES, Material, attribute_vector

FORMAT = "drape material net"
VERSION = 1


def save_material_net(net: MaterialNet, attribute_scales: Mapping[str, float], path: Path | str) -> None:
    """Write the network as plain tensors and numbers; the file is whole or not there."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "attribute_scales": {name: float(attribute_scales[name]) for name in ATTRIBUTES},
        "state_dict": net.state_dict(),
        "versions": versions(),
    }
    with whole_file(Path(path)) as temporary:
        torch.save(content, temporary)


def estimated(path: Path | str, material: Material) -> PhysMaterial:
    """The material of PHYS that the network at ``path`` estimates for a fabric.

    Raises:
        DrapeError: no such file, not one of :func:`save_material_net`, another version of it, or a damaged one.
    """
    if not Path(path).is_file():
        raise DrapeError(f"{path}: no such file; expected an estimator of materials (model=est); train one")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise DrapeError(
            f"{path}: cannot be read as an estimator of materials ({type(error).__name__}); train it again"
        ) from error
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else (None, None)
    if found != (FORMAT, VERSION):
        raise DrapeError(f"{path}: found format {found}; expected {(FORMAT, VERSION)}, an estimator of materials")
    net = MaterialNet()
    try:
        net.load_state_dict(content["state_dict"])
        vector = attribute_vector(material.attributes, content["attribute_scales"])
    except (KeyError, TypeError, RuntimeError) as error:
        raise DrapeError(f"{path}: damaged: {type(error).__name__} {error}; train it again") from error
    with torch.no_grad():
        return PhysMaterial.at(net(torch.tensor([vector], dtype=torch.float64))[0])
