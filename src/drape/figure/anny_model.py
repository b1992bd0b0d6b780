"""A person of anny as arrays: a dense mesh, the joints of a figure, and the weights on them."""

from __future__ import annotations

import functools
import importlib.util
import warnings
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from drape.errors import DrapeError
from drape.figure.phenotype import Phenotype
from drape.figure.skeleton import JOINTS

MIDDLE = {"root": "pelvis", "spine03": "spine", "spine02": "chest", "neck01": "throat", "neck02": "skull"}
SIDE = {"clavicle": "clavicle", "upperarm01": "upper_arm", "lowerarm01": "forearm", "wrist": "hand",
        "upperleg01": "thigh", "lowerleg01": "shin", "foot": "foot"}  # fmt: skip
BONES = MIDDLE | {f"{bone}.{s}": f"{side}_{part}" for bone, part in SIDE.items()
                  for s, side in (("L", "left"), ("R", "right"))}  # fmt: skip
"""Bone of anny that begins where a joint of the figure is; the bones between follow the one above them.

The skull turns at the middle of the throat, below the chin, where garments measure it.
"""
KNUCKLE = "finger3-1"
"""Bone that begins where the palm ends."""
NEEDED = {"anny": "anny", "skimage": "scikit-image", "gpytoolbox": "gpytoolbox"}


@dataclass(frozen=True, eq=False)
class AnnyBody:
    """A person in anny's own rest pose [m]: z up, facing -y, its left side at +x."""

    positions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    """Closed, in several pieces (eyes, mouth)."""
    joints: Float[np.ndarray, "joints 3"]
    weights: Float[np.ndarray, "vertices joints"]
    """Add up to one."""
    knuckles: Float[np.ndarray, "2 3"]
    """Ends of the left and the right palm."""


def anny_body(phenotype: Phenotype) -> AnnyBody:
    """The person of these measures; loads anny, and with it torch.

    Raises:
        DrapeError: anny is missing.
    """
    check_anny()
    model = _model()
    made = model(phenotype_kwargs=asdict(phenotype))
    begins = dict(zip(model.bone_labels, made["rest_bone_heads"][0].double().numpy(), strict=True))
    places = {joint: begins[bone] for bone, joint in BONES.items()}
    return AnnyBody(
        positions=made["rest_vertices"][0].double().numpy().copy(),
        faces=np.array(model.faces.numpy(), np.int64),
        joints=np.array([places[joint] for joint in JOINTS]),
        weights=_weights_on_joints(model),
        knuckles=np.array([begins[f"{KNUCKLE}.{side}"] for side in "LR"]),
    )


def check_anny() -> None:
    """Whether people can be made.

    Raises:
        DrapeError: a package is missing.
    """
    missing = [package for module, package in NEEDED.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise DrapeError(
            f"figure: found no {' and no '.join(missing)}, which people of anny need; install with: "
            'pip install ".[people]", or choose the figure of the project (data/shape=figure, scene/figure=figure)'
        )


@functools.cache
def _model() -> Any:
    """Built from the data of the wheel at first use, within a minute or two, and kept by anny in its cache folder."""
    import anny

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about packages that would make skinning quicker, which is not used
        return anny.Anny(skinning_method="lbs")


def _weights_on_joints(model: Any) -> np.ndarray:
    """Weights of anny's bones, each added to the joint that the bone follows."""
    follows: list[int] = []
    for bone, parent in zip(model.bone_labels, model.bone_parents, strict=True):
        follows.append(JOINTS.index(BONES[bone]) if bone in BONES else follows[parent])
    found = np.zeros((len(model.vertex_bone_weights), len(JOINTS)))
    columns = np.array(follows)[model.vertex_bone_indices.numpy()]
    np.add.at(found, (np.arange(len(found))[:, None], columns), model.vertex_bone_weights.double().numpy())
    return found / found.sum(axis=1, keepdims=True)
