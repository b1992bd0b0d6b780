"""The HDF5 schema of a data set of garments on moving bodies, in one table; garment_index checks a file against it."""

from __future__ import annotations

from drape.data.schema import Field

FORMAT = "drape garments"
VERSION = 2
"""Files of version 1 are read as well; see garment_version."""
SPLITS = ("train", "test")

ATTRIBUTES = {
    "format": repr(FORMAT),
    "schema_version": str(VERSION),
    "drape_version": "version of this package",
    "source": "what made the frames: 'blender 5.0.1', 'cloth3d', 'vto'",
    "seed": "sequence i, attempt k depends on (seed, i, k) only; 0 where nothing was drawn",
    "fps": "frames per second [1/s]",
    "dt": "time step 1 / fps [s]",
    "gravity": "acceleration really applied, three numbers [m/s2]",
    "up_axis": "'z'",
    "fabrics": "names of the groups below materials/",
    "config": "the configuration that made the file, YAML",
}

GROUP_ATTRIBUTES = {
    "bodies": {"shape": "what the body was made from, JSON"},
    "garments": {
        "kind": "tshirt, top, jumpsuit, dress, skirt, trousers, ...",
        "body": "name of the body in whose rest pose the garment was made",
        "style": "what the garment was made from, JSON",
    },
    "sequences": {
        "garment": "name of a group below garments/; empty: the motion of a body alone",
        "body": "name of a group below bodies/",
        "fabric": "name of a group below materials/; empty without a garment",
        "motion": "what the body does",
        "split": "'train' or 'test'",
        "attempts": "1: the first try was accepted",
        "mass_per_vertex": "[kg]; 0 without a garment",
        "friction": "coefficient of Coulomb's friction between garment and body [1]",
        "quality": "numbers of the quality control, JSON",
    },
}
JSON_ATTRIBUTES = ("shape", "style", "quality")

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
    "garments": ("bones", "weights"),
    "sequences": ("positions", "transforms", "body_positions", "twin"),
}
"""Of a body: both or none, and there where a sequence stores transforms. Of a sequence: exactly one of transforms and
body_positions; positions unless it is the motion of a body alone."""
