"""One sequence of CLOTH3D, as it goes into a data set of garments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drape.data.cloth3d.bodies import Bodies, PosedBody
from drape.data.cloth3d.info_mat import SequenceInfo, read_info
from drape.data.cloth3d.pc16 import pc16_shape, read_pc16
from drape.data.cloth3d.rest_mesh import read_rest_mesh
from drape.data.stored_part import Part, StoredBody, StoredGarment, StoredSequence
from drape.errors import DrapeError
from drape.geometry.mesh import ClothMesh

KINDS = {"Tshirt": "tshirt", "Top": "top", "Jumpsuit": "jumpsuit", "Dress": "dress"}
"""CLOTH3D's names of the four garments of the paper, and ours. A sequence has exactly one of them."""
FEWEST = 3
"""Frames: two to start from, one to compare with."""


@dataclass(frozen=True, eq=False)
class SequenceReader:
    """Reads sequences below ``root``: frames ``first`` to ``stop`` (exclusive), or to the end of a shorter one."""

    root: Path
    bodies: Bodies
    first: int
    stop: int
    fabrics: Mapping[str, Mapping]
    """Settings by fabric; a sequence of another fabric is refused."""
    friction: float
    splits: Mapping[str, str]
    """Sequence -> ``train`` or ``test``."""

    def read(self, name: str) -> Part:
        """Sequence ``name``.

        Raises:
            DrapeError: a file or a field that is missing or damaged, another garment or fabric, too few frames.
        """
        folder = self.root / name
        info = read_info(folder / "info.mat")
        worn = _garment(folder, info)
        fabric = self._fabric(folder, info, worn)
        stop = self._stop(folder, info, worn)
        mesh = read_rest_mesh(folder / f"{worn}.obj", info.zrot)
        relative = self._frames(folder, worn, mesh, stop)
        body = self.bodies.body(name, info, self.first, stop)
        return Part(
            _stored_body(body, info),
            _stored_garment(name, worn, mesh, info),
            StoredSequence(
                name=name,
                body=name,
                garment=name,
                fabric=fabric,
                motion="motion capture",
                split=self.splits[name],
                mass_per_vertex=float(self.fabrics[fabric]["mass_per_vertex"]),
                friction=self.friction,
                positions=(relative + info.trans[self.first : stop, None]).astype(np.float32),
                body_positions=body.positions.astype(np.float32),
            ),
        )

    def _fabric(self, folder: Path, info: SequenceInfo, worn: str) -> str:
        fabric = info.fabrics[worn].lower()
        if fabric not in self.fabrics:
            raise DrapeError(
                f"{folder / 'info.mat'}: outfit.{worn}.fabric: found {info.fabrics[worn]!r}; expected one of "
                f"{', '.join(self.fabrics)}, whose settings are known; add it to data.fabrics"
            )
        return fabric

    def _stop(self, folder: Path, info: SequenceInfo, worn: str) -> int:
        """The end of the frames that are there."""
        path = folder / f"{worn}.pc16"
        samples, _ = pc16_shape(path)
        if samples != info.num_frames:
            raise DrapeError(
                f"{path}: found {samples} frames; expected {info.num_frames}, as info.mat has so many poses; download "
                "the sequence again"
            )
        stop = min(self.stop, samples)
        if stop - self.first < FEWEST:
            raise DrapeError(
                f"{path}: found {samples} frames; expected at least {self.first + FEWEST}, as frames {self.first} to "
                f"{self.stop} are asked for; set data.frames"
            )
        return stop

    def _frames(self, folder: Path, worn: str, mesh: ClothMesh, stop: int) -> np.ndarray:
        path = folder / f"{worn}.pc16"
        points = pc16_shape(path)[1]
        if points != mesh.num_vertices:
            raise DrapeError(
                f"{path}: found {points} points a frame; expected {mesh.num_vertices}, as {worn}.obj has so many "
                "vertices; download the sequence again"
            )
        return read_pc16(path, self.first, stop)


def _garment(folder: Path, info: SequenceInfo) -> str:
    worn = [garment for garment in info.fabrics if garment in KINDS]
    if len(worn) != 1:
        raise DrapeError(
            f"{folder / 'info.mat'}: outfit: found {', '.join(info.fabrics) or 'nothing'}; expected exactly one of "
            f"{', '.join(KINDS)}, the garments of the paper"
        )
    return worn[0]


def _stored_body(body: PosedBody, info: SequenceInfo) -> StoredBody:
    shape = {"model": body.model, "gender": info.gender, "betas": info.shape.tolist()}
    return StoredBody(body.rest_positions, body.faces, shape=shape)


def _stored_garment(name: str, worn: str, mesh: ClothMesh, info: SequenceInfo) -> StoredGarment:
    style = {"tightness": list(info.tightness), "zrot": info.zrot, "outfit": sorted(info.fabrics)}
    rest = mesh.rest_positions.astype(np.float64)
    return StoredGarment(KINDS[worn], name, rest, mesh.faces, style=style)
