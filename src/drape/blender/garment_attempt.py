"""A figure, a garment and a motion drawn at random: what a sequence would show, before it is simulated. No bpy."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.blender.choice import Choice
from drape.blender.dressed_body import DressedBody
from drape.blender.garment_people import load_person
from drape.blender.plan import MOTION_FILE
from drape.errors import DrapeError
from drape.figure.anny_figure import make_person
from drape.figure.bvh import read_bvh
from drape.figure.clear_arms import clear_arms
from drape.figure.ease import ease_in
from drape.figure.figure import Figure, make_figure
from drape.figure.measures import shape_of
from drape.figure.motions import make_motion
from drape.figure.phenotype import Phenotype
from drape.figure.shape import FigureShape
from drape.figure.skinning import pose_vertices
from drape.garment.garment import Garment, make_garment
from drape.garment.style import random_style


@dataclass(frozen=True, eq=False)
class Attempt:
    """A figure in a garment and in motion."""

    figure: Figure
    garment: Garment
    transforms: Float[np.ndarray, "frames joints 4 4"]
    """From the rest pose on: the settling frames, then those to record."""
    twin: np.random.Generator
    """Draws how far to the side the twin starts."""

    @functools.cached_property
    def skinned(self) -> Float[np.ndarray, "frames vertices 3"]:
        """The garment as its weights carry it [m]."""
        garment = self.garment
        return pose_vertices(garment.rest_positions, garment.bones, garment.weights, self.transforms)

    @functools.cached_property
    def dressed(self) -> DressedBody:
        """Input of Blender."""
        figure, garment = self.figure, self.garment
        return DressedBody(
            rest_positions=garment.rest_positions,
            faces=garment.faces,
            pinned=garment.pinned,
            pin_positions=self.skinned[:, garment.pinned],
            body_faces=figure.faces,
            body_positions=pose_vertices(figure.rest_positions, figure.bones, figure.weights, self.transforms),
        )


def draw_attempt(choice: Choice, data: Mapping, rng: np.random.Generator, people: Path | None = None) -> Attempt:
    """The figure of ``choice`` in a garment of random style and with a random motion; ``data``: the config node.

    ``people``: the folder of :func:`~drape.blender.garment_people.save_people`, which people of anny come from.

    Raises:
        DrapeError: no such garment can be made on this figure, or a motion file cannot be read.
    """
    if choice.body is None:
        raise DrapeError(f"data.kinds: found {choice.kind}, which is on no body; expected garments")
    styles, motions, twin = rng.spawn(3)
    figure = figure_of(choice.body, data, people)
    garment = make_garment(choice.kind, figure, random_style(choice.kind, styles), data["edge"]["garment"])
    if choice.motion.endswith(MOTION_FILE):
        transforms = read_bvh(Path(choice.motion), figure, data["frames"], data["fps"])
    else:
        transforms = make_motion(choice.motion, figure, data["frames"], data["fps"], motions)
    transforms = clear_arms(transforms, figure, data["fps"])
    return Attempt(figure, garment, ease_in(transforms, figure, data["settle"]), twin)


def figure_of(body: int, data: Mapping, people: Path | None = None) -> Figure:
    """Figure number ``body`` of a data set; see :func:`drawn_shape`."""
    return _kept_figure(drawn_shape(body, data), data["edge"]["body"], people and people / f"{body:03d}.npz")


def drawn_shape(body: int, data: Mapping) -> FigureShape | Phenotype:
    """Measures of body number ``body``: drawn uniformly from ``data.shape``, by (seed, body) only."""
    rng = np.random.default_rng([data["seed"], body])
    return shape_of(
        {measure: float(rng.uniform(*data["shape"][measure])) for measure in sorted(data["shape"])}, "data.shape"
    )


@functools.lru_cache(maxsize=64)
def _kept_figure(shape: FigureShape | Phenotype, edge: float, person: Path | None) -> Figure:
    """Several sequences show the same figure."""
    if not isinstance(shape, Phenotype):
        return make_figure(shape, edge)
    if person is None:
        raise DrapeError("data.shape: found a person of anny without the folder that people are stored in")
    return make_person(shape, load_person(person), edge)
