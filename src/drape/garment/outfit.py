"""A figure of the project in garments worn over each other and in motion, before anything is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from drape.contact.collisions import Collisions
from drape.errors import DrapeError
from drape.figure.anny_figure import make_person
from drape.figure.anny_model import anny_body
from drape.figure.bvh import read_bvh
from drape.figure.clear_arms import clear_arms
from drape.figure.ease import ease_in
from drape.figure.figure import Figure, make_figure
from drape.figure.motions import known_motion, make_motion
from drape.figure.phenotype import Phenotype
from drape.figure.shape import FigureShape
from drape.figure.skinning import pose_vertices
from drape.garment.garment import Garment, make_garment
from drape.garment.style import known_kind, random_style
from drape.scene.obstacle import Obstacle
from drape.scene.pins import Pins

RECORDED = ".bvh"
"""Ending of the name of a motion that is read from a file."""
OF_MOTION = 1_000_003
"""Sets the random numbers of the motion apart from those of the garments."""


@dataclass(frozen=True, eq=False)
class Outfit:
    """Garments on a figure, from the inside out; frame 0 is the rest pose, in which nothing crosses."""

    figure: Figure
    garments: tuple[Garment, ...]
    transforms: Float[np.ndarray, "frames joints 4 4"]

    @property
    def rest_positions(self) -> Float[np.ndarray, "vertices 3"]:
        """Of all garments, around the figure in its rest pose [m]."""
        return np.concatenate([garment.rest_positions for garment in self.garments])

    @property
    def faces(self) -> Int[np.ndarray, "faces 3"]:
        """Of all garments, which share no vertex."""
        starts = self._starts
        return np.concatenate([garment.faces + start for garment, start in zip(self.garments, starts, strict=True)])

    @property
    def pins(self) -> Pins | None:
        """Waistbands, as the skeleton carries them; None where no garment has one."""
        pairs = [pair for pair in zip(self.garments, self._starts, strict=True) if len(pair[0].pinned)]
        if not pairs:
            return None
        vertices = np.concatenate([garment.pinned + start for garment, start in pairs])
        return Pins(vertices, np.concatenate([self._waistband(garment) for garment, _ in pairs], axis=1))

    def body(self) -> Obstacle:
        """The figure in every frame."""
        figure = self.figure
        moved = pose_vertices(figure.rest_positions, figure.bones, figure.weights, self.transforms)
        return Obstacle(figure.faces, moved)

    def _waistband(self, garment: Garment) -> Float[np.ndarray, "frames pinned 3"]:
        held = garment.pinned
        return pose_vertices(garment.rest_positions[held], garment.bones[held], garment.weights[held], self.transforms)

    @property
    def _starts(self) -> Int[np.ndarray, " garments"]:
        """Number of the first vertex of each garment."""
        counts = [len(garment.rest_positions) for garment in self.garments]
        return np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)


def make_outfit(
    shape: FigureShape | Phenotype,
    kinds: Sequence[str],
    motion: str,
    *,
    edge: float,
    body_edge: float,
    settle: int,
    frames: int,
    fps: float,
    seed: int,
    recording: Mapping[str, Any] | None = None,
) -> Outfit:
    """Garments of these kinds in random styles, each over those before it, on a figure that moves.

    ``settle`` frames lead from the rest pose to the first pose of the motion, ``frames`` more follow; the same call
    gives the same outfit. ``motion``: a name, or a BVH file, whose ``start``, ``up`` and ``names`` a ``recording``
    may say (see :func:`read_bvh`). ``edge`` and ``body_edge`` in metres.

    Raises:
        DrapeError: an unknown kind or motion, a garment that cannot be made, garments that cross each other.
    """
    for kind in kinds:
        known_kind(kind)
    recorded = motion.endswith(RECORDED)
    if not recorded:
        known_motion(motion)
    figure = _figure(shape, body_edge)
    garments: list[Garment] = []
    for number, kind in enumerate(kinds):
        style = random_style(kind, np.random.default_rng([seed, number]))
        garments.append(make_garment(kind, figure, style, edge, garments[-1] if garments else None))
    if recorded:
        transforms = read_bvh(Path(motion), figure, frames, fps, **(recording or {}))
    else:
        transforms = make_motion(motion, figure, frames, fps, np.random.default_rng([seed, OF_MOTION]))
    outfit = Outfit(figure, tuple(garments), ease_in(clear_arms(transforms, figure, fps), figure, settle))
    _check_apart(outfit, kinds)
    return outfit


def _figure(shape: FigureShape | Phenotype, edge: float) -> Figure:
    if isinstance(shape, Phenotype):
        return make_person(shape, anny_body(shape), edge)
    return make_figure(shape, edge)


def _check_apart(outfit: Outfit, kinds: Sequence[str]) -> None:
    """Cloth may lie anywhere outside of other cloth, but not through it."""
    x = outfit.rest_positions
    found = Collisions(x, outfit.faces, self_distance=1e-3, self_stiffness=1.0).crossings(x)
    if len(found.pairs):
        raise DrapeError(
            f"scene.garments: {', '.join(kinds)}: found that {found} at the start; expected garments that lie over "
            "each other; choose another order, another scene.seed or a smaller scene.edge"
        )
