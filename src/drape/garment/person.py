"""A person who moves in one garment or several: a built-in scene, made from code in seconds."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Mapping, Sequence

from drape.errors import DrapeError
from drape.figure.anny_model import check_anny
from drape.figure.measures import is_person, shape_of
from drape.garment.style import KINDS
from drape.geometry.mesh import ClothMesh
from drape.scene.frozen_array import frozen_floats
from drape.scene.mass import mass_rule, vertex_masses
from drape.scene.material import Material
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State

NEEDED = {"skimage": "scikit-image", "gpytoolbox": "gpytoolbox"}
"""Modules that making a figure and garments imports -> packages to install."""


def person(
    garments: Sequence[str],
    motion: str,
    recording: Mapping[str, object],
    figure: Mapping[str, float],
    seed: int,
    edge: float,
    body_edge: float,
    settle: int,
    friction: float | None,
    material: Material,
    mass: Mapping[str, float | None],
    gravity: Sequence[float],
    fps: float,
    frames: int,
) -> Scene:
    """Garments, from the inside out, on a figure that goes from its rest pose into a motion within ``settle`` frames.

    The cloth starts at rest, in its rest shape, around the body in its rest pose; it is simulated from then on. The
    ``frames`` to simulate begin with those of settling, the others are the motion. Each garment is as far from the one
    below it as the first is from the body, so that none crosses another. Waistbands (skirt, trousers) are pinned and
    move with the skeleton. The garments' styles and the motion's proportions depend on ``seed`` only.

    ``figure``: measures of the project's own body (:class:`~drape.figure.shape.FigureShape`) or of a person of anny
    (:class:`~drape.figure.phenotype.Phenotype`). ``recording``: where a BVH file starts [s], what is up in it, and
    names of its joints (see :func:`read_bvh`).

    With edges of 0.0115 m the T-shirt of seed 0 has about 6000 vertices.

    Raises:
        DrapeError: packages that are missing, unknown names, measures out of range, garments that cannot be made; see
            also :func:`vertex_masses`, :class:`Scene`.
    """
    dt, down = frame_time(fps), frozen_floats(gravity, (3,), "scene.gravity")
    shape = shape_of(figure, "scene.figure")
    _check(garments, settle, frames)
    mass_rule(mass)
    _check_installed()
    if is_person(figure):
        check_anny()
    from drape.garment.outfit import make_outfit  # imports what may be missing

    print(f"making a figure, {', '.join(garments)} and the motion: some 10 seconds", file=sys.stderr, flush=True)
    moving = max(frames + 1 - settle, 1)
    outfit = make_outfit(
        shape, garments, motion, edge=edge, body_edge=body_edge, settle=settle, frames=moving, fps=fps, seed=seed,
        recording=recording,
    )  # fmt: skip
    mesh = ClothMesh.from_faces(outfit.rest_positions, outfit.faces, "scene.garments")
    return Scene(
        name="person",
        mesh=mesh,
        initial=State.at_rest(mesh.rest_positions),
        material=material,
        mass=vertex_masses(mesh, mass),
        gravity=down,
        dt=dt,
        frames=frames,
        pins=outfit.pins,
        obstacle=outfit.body(),
        friction=friction,
    )


def _check(garments: Sequence[str], settle: int, frames: int) -> None:
    if isinstance(garments, str) or not garments:
        raise DrapeError(
            f"scene.garments: found {garments!r}; expected a list of {', '.join(KINDS)}, the innermost first: "
            "scene.garments=[tshirt]"
        )
    if settle < 1:
        raise DrapeError(
            f"scene.settle: found {settle}; expected 1 frame or more from the rest pose, in which garments are made, "
            "to the motion; 30 are gentle"
        )
    if frames < 1:
        raise DrapeError(f"scene.frames: found {frames}; expected at least 1 frame to simulate")


def _check_installed() -> None:
    missing = [package for module, package in NEEDED.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise DrapeError(
            f"scene person: found no {' and no '.join(missing)}, with which figures and garments are made; install "
            f"with: pip install {' '.join(missing)} (Blender itself is not needed)"
        )
