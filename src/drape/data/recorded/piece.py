"""Pins and masses of a recorded piece of cloth."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from drape.data.recorded.sequence import Recording
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.scene.frozen_array import frozen_indices
from drape.scene.mass import RULES, vertex_areas, vertex_masses
from drape.scene.proportions import size

STILL = "still"
"""``data.pins`` where pins are the vertices that do not move."""
SAME_PLACE = 1e-6
"""Motion of a vertex that is still, as a share of the size of the cloth: what rounding in files makes of none."""
HELD = 0.01
"""Motion of a pin that is named, as a share of the size of the cloth, up to which it counts as noise."""
LEAST_MOTION = 0.02
"""Of the vertex that moves most, as a share of the size of the cloth: less is no motion to learn from."""

LIGHTEST, HEAVIEST = 0.005, 50.0
"""Of a fabric [kg/m²]: Blender's, whose masses belong to vertices, weigh up to 21."""


def pinned_vertices(
    recording: Recording, mesh: ClothMesh, pins: str | Sequence[int] | None
) -> Int[np.ndarray, " pinned"]:
    """The node ``data.pins``: ``still`` (those that do not move in the sequence), a list of vertices, or null.

    Raises:
        DrapeError: a cloth that hardly moves, pins that move, an index that it does not have, or no free vertex.
    """
    moved = np.linalg.norm(recording.positions - recording.positions[0], axis=-1).max(axis=0) / size(
        mesh.rest_positions
    )
    if moved.max() < LEAST_MOTION:
        raise DrapeError(
            f"{recording.path}: no vertex moves further than {100 * moved.max():.2g} % of the size of the cloth; "
            "expected cloth that swings or falls, as a law is learned from motion; leave this sequence out"
        )
    if pins is None or pins == STILL:
        return np.flatnonzero(moved <= SAME_PLACE) if pins == STILL else np.array([], np.int64)
    if isinstance(pins, str):
        raise DrapeError(f"data.pins: found {pins!r}; expected {STILL}, a list of vertices, or null for none")
    if not len(pins):
        return np.array([], np.int64)
    vertices = np.unique(frozen_indices(pins, (None,), "data.pins"))
    if vertices.min() < 0 or vertices.max() >= mesh.num_vertices:
        raise DrapeError(
            f"{recording.path}: data.pins: found {vertices.min()}..{vertices.max()}; expected "
            f"0..{mesh.num_vertices - 1}"
        )
    if moved[vertices].max() > HELD:
        raise DrapeError(
            f"{recording.path}: data.pins: vertex {vertices[moved[vertices].argmax()]} moves by "
            f"{100 * moved[vertices].max():.2g} % of the size of the cloth; expected pins that stay, as the work of "
            "a hand that leads them is not known; name those that stay, or record with pins at rest"
        )
    if len(vertices) == mesh.num_vertices:
        raise DrapeError(f"{recording.path}: data.pins: found all vertices; expected some that are free")
    return vertices


def fabric_of(name: str, fabric: str | Mapping[str, str]) -> str:
    """The node ``data.fabric``: the name of one fabric, or names with the pattern of their sequences.

    Raises:
        DrapeError: a sequence that no pattern or more than one fits.
    """
    if isinstance(fabric, str):
        return fabric
    fitting = [key for key, pattern in fabric.items() if fnmatch.fnmatchcase(name, pattern)]
    if len(fitting) != 1:
        raise DrapeError(
            f"data.fabric: sequence {name}: found {', '.join(fitting) or 'no fabric'} for it; expected one of "
            f"{', '.join(f'{key} ({pattern})' for key, pattern in fabric.items())}"
        )
    return fitting[0]


def masses(
    recording: Recording, mesh: ClothMesh, fabric: str, mass: Mapping[str, object]
) -> Float[np.ndarray, " vertices"]:
    """Mass of each vertex [kg]: the file's own, or by one rule of the node ``data.mass``; a number, or one a fabric.

    Raises:
        DrapeError: no mass, two, or one that is not positive.
    """
    rules = {rule: value.get(fabric) if isinstance(value, Mapping) else value for rule, value in mass.items()}
    rules = {rule: value for rule, value in rules.items() if value is not None}
    count = len(rules) + (recording.mass is not None)
    if count != 1 or set(rules) - set(RULES):
        own = "" if recording.mass is None else "mass in the file"
        raise DrapeError(
            f"{recording.path}: found {', '.join(filter(None, [own, *rules])) or 'no mass'}; expected exactly one of "
            "data.mass.areal_density (kg/m2), data.mass.per_vertex (kg) and an array mass in npz or HDF5; weigh a "
            f"piece of {fabric} and divide by its area"
        )
    if recording.mass is None:
        ((rule, value),) = rules.items()
        if not isinstance(value, int | float) or not np.isfinite(value) or value <= 0:
            raise DrapeError(f"data.mass.{rule}: found {value!r} for {fabric}; expected a positive number")
        return _plausible(vertex_masses(mesh, {rule: float(value)}), mesh, recording)
    if not (recording.mass > 0).all():
        raise DrapeError(
            f"{recording.path}: mass: found {recording.mass.min()} at vertex {recording.mass.argmin()}; expected the "
            "mass of every vertex [kg], of pinned ones too"
        )
    return _plausible(recording.mass, mesh, recording)


def _plausible(mass: Float[np.ndarray, " vertices"], mesh: ClothMesh, recording: Recording) -> np.ndarray:
    density = float(mass.sum() / vertex_areas(mesh).sum())
    if not LIGHTEST <= density <= HEAVIEST:
        raise DrapeError(
            f"{recording.path}: found {density:.3g} kg/m2; expected {LIGHTEST} to {HEAVIEST:.0f} (silk "
            "0.08, denim 0.4); masses are in kilograms: 200 g/m2 are 0.2"
        )
    return mass
