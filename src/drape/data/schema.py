"""The HDF5 schema of a data set of cloth in one table: sequences of garments on bodies. A sheet is one without a body.

Three formats hold it. In ``drape garments``, and in ``drape recordings``, every body, garment and sequence is a group
(see index); ``drape trajectories`` holds sheets of one mesh, as many as there may be, with all sequences in one dataset
(see sheets). Whatever the format, a file is read and written as what stands here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

GARMENTS, RECORDINGS, SHEETS = "drape garments", "drape recordings", "drape trajectories"
VERSIONS = {GARMENTS: 2, RECORDINGS: 2, SHEETS: 1}
"""That are written; those of before are read as well: earlier_friction, earlier_recordings."""
SPLITS = ("train", "test")
AGAIN = "make the file again"


@dataclass(frozen=True)
class Field:
    """One dataset. A dimension is a name (the same name has the same length everywhere) or a number."""

    name: str
    dims: tuple[str | int, ...]
    dtype: str
    unit: str
    meaning: str


FIELDS = {
    "bodies": (
        Field("rest_positions", ("body vertices", 3), "float32", "m", "rest pose, z up"),
        Field("faces", ("body faces", 3), "int64", "1", "vertex indices, winding outwards"),
        Field("bones", ("body vertices", 4), "int64", "1", "joints that carry the vertex; indices into transforms"),
        Field("weights", ("body vertices", 4), "float32", "1", "share of each of these joints; they sum to 1"),
    ),
    "garments": (
        Field("rest_positions", ("vertices", 3), "float64", "m", "rest shape, around the body's rest pose"),
        Field("faces", ("faces", 3), "int64", "1", "vertex indices, one winding for all faces"),
        Field("pinned", ("pinned",), "int64", "1", "vertices led along their recorded positions; may be none"),
        Field("mass", ("vertices",), "float64", "kg", "mass of each vertex, where they differ"),
        Field("bones", ("vertices", 4), "int64", "1", "joints that carry the vertex; indices into transforms"),
        Field("weights", ("vertices", 4), "float32", "1", "share of each of these joints; they sum to 1"),
    ),
    "sequences": (
        Field("positions", ("frames", "vertices", 3), "float32", "m", "garment; frame k is at time k * dt"),
        Field("transforms", ("frames", "joints", 4, 4), "float32", "1, m", "rest pose to posed: x' = sum_k w_k T_k x"),
        Field("body_positions", ("frames", "body vertices", 3), "float32", "m", "body; frame k is at time k * dt"),
        Field("twin", ("frames", "vertices", 3), "float32", "m", "garment, started 1e-6 m beside: the noise floor"),
    ),
}
"""Datasets of every group below ``bodies/``, ``garments/``, ``sequences/``, all of them contiguous."""

OPTIONAL = {
    "bodies": ("bones", "weights"),
    "garments": ("mass", "bones", "weights"),
    "sequences": ("positions", "transforms", "body_positions", "twin"),
}
"""Of a body: both or none, and there where a sequence stores transforms. Of a sequence on a body: exactly one of
transforms and body_positions, neither without a body; positions unless it is the motion of a body alone."""

SHEET_FIELDS = (
    Field("mesh/rest_positions", ("vertices", 3), "float32", "m", "flat rest shape"),
    Field("mesh/faces", ("faces", 3), "int64", "1", "vertex indices, one winding for all faces"),
    Field("mesh/pinned", ("pinned",), "int64", "1", "vertices that do not move"),
    Field("positions", ("sequences", "frames", "vertices", 3), "float32", "m", "frame k is at time k * dt"),
    Field("fabric", ("sequences",), "int64", "1", "index into the attribute fabrics"),
    Field("split", ("sequences",), "int8", "1", "0 train, 1 test"),
    Field("attempts", ("sequences",), "int64", "1", "1: the first random start was accepted"),
)
"""Datasets of a file of sheets: its one garment, and the sequences' positions and attributes, each for all of them."""

ATTRIBUTES = {
    "format": " or ".join(map(repr, VERSIONS)),
    "schema_version": "that of the format",
    "drape_version": "version of this package",
    "source": "what made the frames: 'blender 5.0.1', 'cloth3d', 'vto', 'recorded'",
    "seed": "sequence i, attempt k depends on (seed, i, k) only; 0 where nothing was drawn",
    "fps": "frames per second [1/s]",
    "dt": "time step 1 / fps [s]",
    "gravity": "acceleration really applied, three numbers [m/s2]",
    "up_axis": "'z'",
    "fabrics": "names of the groups below materials/; where the fabric is a number it counts in this order",
    "config": "the configuration that made the file, YAML",
}
SHEET_ATTRIBUTES = {name: meaning for name, meaning in ATTRIBUTES.items() if name != "source"} | {
    "blender_version": "version of bpy"
}

GROUP_ATTRIBUTES = {
    "bodies": {"shape": "what the body was made from, JSON"},
    "garments": {
        "kind": "sheet, tshirt, top, jumpsuit, dress, skirt, trousers, ...",
        "body": "name of the body in whose rest pose the garment was made; empty without one",
        "style": "what the garment was made from, JSON",
    },
    "sequences": {
        "garment": "name of a group below garments/; empty: the motion of a body alone",
        "body": "name of a group below bodies/; empty: a sheet",
        "fabric": "name of a group below materials/; empty without a garment",
        "motion": "what the body does, or the file that was recorded",
        "split": "'train' or 'test'",
        "attempts": "1: the first try was accepted",
        "mass_per_vertex": "[kg]; 0 without a garment",
        "friction": "coefficient of Coulomb's friction between garment and body [1]",
        "quality": "numbers of the quality control, JSON",
    },
}
TEXT_ATTRIBUTES = ("kind", "body", "garment", "fabric", "motion", "split")
JSON_ATTRIBUTES = ("shape", "style", "quality")

MATERIAL_ATTRIBUTES = {
    "preset": "name of Blender's preset file",
    "mass_per_vertex": "[kg]",
    "tension_stiffness": "Blender's number; in SI tension * fps² / mean edge length [N/m]",
    "bending_stiffness": "Blender's number",
    "tension_damping": "Blender's number",
    "bending_damping": "Blender's number",
    "air_damping": "Blender's number",
    "quality": "solver steps per frame",
}
"""Attributes that every group materials/<fabric> has; it holds all other settings of the preset as well."""
RECORDED_MATERIAL = tuple(name for name in MATERIAL_ATTRIBUTES if name not in ("preset", "quality"))
"""Of a file of recordings: ``mass_per_vertex`` is a mean, others are 0 where nothing is known."""


def plain(value: Any) -> Any:
    """An HDF5 attribute as Python values."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
