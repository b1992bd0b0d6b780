"""The rest shape of recorded cloth: what it would be without any force."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from drape.data.motion import edge_strain
from drape.data.recorded.sequence import Recording
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh
from drape.reading.files import MESHES, read_file
from drape.reading.triangles import made
from drape.scene.proportions import check_cloth_size

STRAINED = 0.2
"""Median strain of all edges in all frames from which on a rest shape is that of another cloth."""
FIRST = "first"
"""``data.rest`` of sequences that begin at rest, without strain and flat."""


class RestShapes:
    """The node ``data.rest``: null (the files say it), ``first``, a mesh file, or a folder of them, one a topology.

    Raises:
        DrapeError: no such file or folder, or a mesh that cannot be read.
    """

    def __init__(self, data: Mapping) -> None:
        self.first, self.scaled = data["rest"] == FIRST, data["scale"] is not None
        self.meshes: list[tuple[Path, np.ndarray, np.ndarray]] = []
        if data["rest"] is None or self.first:
            return
        place = Path(data["rest"])
        if not place.exists():
            raise DrapeError(
                f"data.rest: {place}: no such file or folder; expected first, a mesh, or a folder of meshes"
            )
        files = sorted(file for file in place.iterdir() if file.suffix.lower() in MESHES) if place.is_dir() else [place]
        for file in files:
            read = made(read_file(file, wanted=data["rest_object"]), data["scale"], data["up_axis"])
            self.meshes.append((file, read.positions[0], read.faces))

    def mesh(self, recording: Recording) -> ClothMesh:
        """The cloth of a recording at rest.

        Raises:
            DrapeError: none is known, or one of another mesh, of a size that cannot be metres, or strained everywhere.
        """
        rest, where = self._positions(recording)
        check_cloth_size(rest, str(where), self.scaled, "data.scale")
        mesh = ClothMesh.from_faces(rest.astype(np.float32), recording.faces, name=str(where))
        strain = float(np.median(np.abs(edge_strain(recording.positions, mesh))))
        if strain > STRAINED:
            raise DrapeError(
                f"{recording.path}: half of the edges are {100 * strain:.0f} % or more longer or shorter than in the "
                "rest "
                f"shape ({where}); expected the same cloth in the same unit; give its own rest shape: data.rest"
            )
        return mesh

    def _positions(self, recording: Recording) -> tuple[Float[np.ndarray, "vertices 3"], Path | str]:
        if self.first:
            return recording.positions[0], f"{recording.path}: frame 0"
        for file, positions, faces in self.meshes:
            if np.array_equal(faces, recording.faces) and len(positions) == recording.positions.shape[1]:
                return positions, file
        if self.meshes:
            raise DrapeError(
                f"{recording.path}: found {recording.positions.shape[1]} vertices and {len(recording.faces)} faces; "
                f"expected the faces of a mesh of data.rest ({', '.join(file.name for file, _, _ in self.meshes)}), in "
                "the same order; export the rest shape as the sequence was exported"
            )
        if recording.rest is None:
            raise DrapeError(
                f"{recording.path}: found no rest shape; expected the cloth without any force: a mesh with the same "
                "faces "
                "(data.rest=rest.obj), rest_positions in npz or HDF5, or data.rest=first where sequences begin at rest"
            )
        return recording.rest, f"{recording.path}: rest_positions"
