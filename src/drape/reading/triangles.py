"""From a file's polygons to triangles that can be simulated: welded, cut, wound alike, in metres, +z up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from drape.errors import DrapeError
from drape.reading.mesh_record import FileForm, MeshFile, ReadMesh
from drape.reading.polygons import triangulated
from drape.reading.weld import SHARE, exact_copies, median_edge, near_copies
from drape.reading.winding import Sheets, areas, outward


def made(
    source: MeshFile, scale: float | None = None, up_axis: str | None = None, weld: float | None = None
) -> ReadMesh:
    """Triangles of a file's polygons; whatever was changed on the way is counted in ``changes``.

    ``scale``: metres per unit, on top of what the file says of itself; None for 1. ``up_axis``: ``y`` or ``z`` in a
    file that does not say, None for what is usual there. Copies of a vertex become one, at the place of the first, in
    the order of the file: exact ones, and the two sides of seams that are at most ``weld`` [m] apart, None for 1 % of
    the median edge.

    Raises:
        DrapeError: no face, an index out of range, positions that are not finite, a scale, an axis or a distance that
            is none, a one-sided surface; the sentence opens with the path.
    """
    factor, up = _unit(source, scale), _upright(source, up_axis)
    _check(source)
    metres = to_metres(source.positions, factor, up)
    corners, _ = triangulated(source.polygons, metres[0])
    faces = source.polygons.corners[corners]
    reach = _reach(weld, metres[0], faces, source)
    exact = exact_copies(metres)
    near = near_copies(metres, exact[faces], reach) if reach > 0 else np.arange(len(exact))
    welded = near[exact]
    kept, left_out = _sound(welded[faces])
    faces = welded[faces][kept]
    if not len(faces):
        raise DrapeError(f"{source.path}: found no triangle; expected a mesh with faces; export faces, not points")
    used, faces = np.unique(faces, return_inverse=True)
    faces, points = faces.reshape(-1, 3), metres[:, used]
    vertex = np.full(len(welded), -1)
    vertex[used] = np.arange(len(used))
    faces, wound = _wound_alike(faces, points[0], source)
    seen = np.isin(np.arange(len(exact)), source.polygons.corners)
    changes = {
        "polygons cut into triangles": int((source.polygons.sizes > 3).sum()),
        "copies of vertices merged": int((exact != np.arange(len(exact)))[seen].sum()),
        f"vertices of seams up to {1e3 * reach:.3g} mm apart merged": int((near[exact] != exact)[seen].sum()),
        "loose vertices left out": int((~seen).sum()),
        **left_out,
        "faces turned to wind like their neighbours": wound,
        "edges where a piece is sewn on (three faces or more)": _sewn_on(faces),
    }
    parts = (source.polygons, factor, up, source.first, source.uv, source.materials, source.material)
    form = FileForm(vertex[welded], metres[0], *parts)
    return ReadMesh(source, points, faces, form, _parts(faces), changes)


def looking_outwards(body: ReadMesh, garment: Float[np.ndarray, "cloth 3"] | None = None) -> ReadMesh:
    """A body whose sheets are turned over where they look inwards, or away from the ``garment`` [m]."""
    points = body.positions[0]
    sheets = Sheets.of(body.faces, np.linalg.norm(areas(points, body.faces), axis=1))
    turned, said = outward(points, body.faces, sheets.of_face, garment)
    faces = np.where(turned[:, None], body.faces[:, ::-1], body.faces)
    return replace(body, faces=faces, shells=said)


def _unit(source: MeshFile, scale: float | None) -> float:
    scale = 1.0 if scale is None else scale
    if not (np.isfinite(scale) and scale > 0):
        raise DrapeError(
            f"{source.path}: scale: found {scale}; expected metres per unit of the file, as 0.01 for centimetres"
        )
    return scale * (1.0 if source.unit is None else source.unit)


def _upright(source: MeshFile, up_axis: str | None) -> str:
    if up_axis not in ("y", "z", None):
        raise DrapeError(f"{source.path}: up_axis: found {up_axis!r}; expected y or z")
    return source.up or up_axis or source.usual


def to_metres(positions: Float[np.ndarray, "... 3"], scale: float, up: str) -> Float[np.ndarray, "... 3"]:
    """Positions of a file, in metres with +z up: (x, y, z) becomes (x, -z, y) where y is up, a quarter turn about x."""
    x, y, z = np.moveaxis(scale * np.asarray(positions, np.float64), -1, 0)
    return np.stack([x, -z, y] if up == "y" else [x, y, z], axis=-1)


def _reach(weld: float | None, points: np.ndarray, faces: np.ndarray, source: MeshFile) -> float:
    if weld is None:
        return SHARE * median_edge(points, faces)
    if not (np.isfinite(weld) and weld >= 0):
        raise DrapeError(f"{source.path}: weld: found {weld}; expected metres, 0 for exact copies only")
    return weld


def _check(source: MeshFile) -> None:
    positions, corners = source.positions, source.polygons.corners
    if len(corners) == 0 or positions.size == 0:
        raise DrapeError(f"{source.path}: found no triangle; expected a mesh with faces; export faces, not points")
    if corners.min() < 0 or corners.max() >= positions.shape[1]:
        raise DrapeError(
            f"{source.path}: faces index {corners.min()}..{corners.max()}; expected 0..{positions.shape[1] - 1}, as "
            "positions has so many vertices"
        )
    bad = np.argwhere(~np.isfinite(positions).all(axis=-1))
    if len(bad):
        raise DrapeError(
            f"{source.path}: frame {bad[0][0]}, vertex {bad[0][1]}: found {positions[tuple(bad[0])]}; expected finite "
            "positions; export it again"
        )


def _sound(faces: Int[np.ndarray, "faces 3"]) -> tuple[Int[np.ndarray, " kept"], dict[str, int]]:
    """Faces with three different corners, each once."""
    different = np.flatnonzero((np.sort(faces, axis=1)[:, 1:] != np.sort(faces, axis=1)[:, :-1]).all(axis=1))
    _, first = np.unique(np.sort(faces[different], axis=1), axis=0, return_index=True)
    kept = different[np.sort(first)]
    return kept, {
        "faces without area left out": len(faces) - len(different),
        "copies of faces left out": len(different) - len(kept),
    }


def _wound_alike(faces: np.ndarray, points: np.ndarray, source: MeshFile) -> tuple[np.ndarray, int]:
    sheets = Sheets.of(faces, np.linalg.norm(areas(points, faces), axis=1))
    if len(sheets.one_sided):
        mine = np.flatnonzero(sheets.of_face == sheets.one_sided[0])
        raise DrapeError(
            f"{source.path}: found a sheet of {len(mine)} faces that has one side only, like a Möbius strip (one of "
            f"them is at {np.round(points[faces[mine[0]]].mean(axis=0), 3).tolist()} m); expected two sides; cut it"
        )
    return np.where(sheets.turned[:, None], faces[:, ::-1], faces), int(sheets.turned.sum())


def _sewn_on(faces: Int[np.ndarray, "faces 3"]) -> int:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] > 2).sum())


def _parts(faces: Int[np.ndarray, "faces 3"]) -> int:
    """Pieces that share no vertex."""
    count = faces.max() + 1
    pairs = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return int(connected_components(graph, directed=False)[0])
