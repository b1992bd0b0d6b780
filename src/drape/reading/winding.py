"""Consistent orientation of faces: alike within each sheet, outwards on bodies."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

NEARLY_CLOSED = 0.3
"""Share of the area of a sheet that its openings have at most, if what is inside can be told from its volume."""
CLEAR = 0.75
"""Share of the points near an open sheet that are on one side of it, if this side is to be its outside."""


class Sheets(NamedTuple):
    """Faces that hang together over edges of exactly two faces."""

    of_face: Int[np.ndarray, " faces"]
    """Sheet of each face, numbered by their first faces."""
    turned: Bool[np.ndarray, " faces"]
    """Faces to be turned so that each sheet looks one way, that of the larger part of its area."""
    one_sided: Int[np.ndarray, " some"]
    """Sheets that have no two sides (a Möbius strip)."""

    @classmethod
    def of(cls, faces: Int[np.ndarray, "faces 3"], area: Float[np.ndarray, " faces"]) -> Sheets:
        """Each face stands twice in a graph, as it is and turned; neighbours that look alike are linked."""
        count = len(faces)
        first, second, alike = _neighbours(faces)
        start = np.concatenate([first, first + count])
        end = np.concatenate([second + count * ~alike, second + count * alike])
        graph = coo_array((np.ones(len(start)), (start, end)), shape=(2 * count, 2 * count))
        _, side = connected_components(graph, directed=False)
        plain = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
        sheets, sheet = connected_components(plain, directed=False)
        _, begin = np.unique(sheet, return_index=True)
        turned = side[:count] != side[begin[sheet]]
        mostly = np.bincount(sheet, np.where(turned, area, -area), minlength=sheets) > 0
        turned ^= mostly[sheet]
        rank = np.argsort(np.argsort(begin))
        one_sided = np.unique(rank[sheet[side[:count] == side[count:]]])
        return cls(rank[sheet], turned, one_sided)


def _neighbours(faces: Int[np.ndarray, "faces 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of faces at edges of exactly two, and whether they run along it in opposite directions, as they should."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    face = np.tile(np.arange(len(faces)), 3)
    _, inverse, times = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.reshape(-1)
    order = np.argsort(inverse, kind="stable")
    order = order[times[inverse[order]] == 2].reshape(-1, 2)
    forward = directed[:, 0] < directed[:, 1]
    return face[order[:, 0]], face[order[:, 1]], forward[order[:, 0]] != forward[order[:, 1]]


def areas(points: Float[np.ndarray, "points 3"], faces: Int[np.ndarray, "faces 3"]) -> Float[np.ndarray, "faces 3"]:
    """Area vectors: along the normals, as long as the areas."""
    x = points[faces]
    return 0.5 * np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


def outward(
    points: Float[np.ndarray, "points 3"],
    faces: Int[np.ndarray, "faces 3"],
    sheet: Int[np.ndarray, " faces"],
    garment: Float[np.ndarray, "cloth 3"] | None,
) -> tuple[Bool[np.ndarray, " faces"], tuple[str, ...]]:
    """Faces of a body to be turned so that it looks outwards, and a sentence for each sheet of which some are.

    A sheet that is closed, or nearly, encloses a volume, which must be positive (but for a hollow inside another
    sheet); the outside of an open one, as of a floor, is where the garment is.
    """
    turned, said = np.zeros(len(faces), bool), []
    enclosed = [_volume(points, faces[sheet == number]) for number in range(sheet.max() + 1)]
    near = np.zeros(0, np.int64)
    if garment is not None and None in enclosed:
        near = sheet[igl.point_mesh_squared_distance(garment, points, faces)[1]]
    for number, volume in enumerate(enclosed):
        mine = sheet == number
        if volume is not None:
            wrong, why = volume < 0 and not _is_hollow(points, faces, mine, sheet, enclosed), "they looked inwards"
        elif garment is not None and (near == number).any():
            wrong, why = _is_behind(garment[near == number], points, faces[mine]), "the garment is on their other side"
        else:
            wrong = False
        if wrong:
            turned |= mine
            said.append(f"sheet {number + 1} of {len(enclosed)} was turned over ({int(mine.sum())} faces: {why})")
    return turned, tuple(said)


def _volume(points: np.ndarray, faces: np.ndarray) -> float | None:
    """Enclosed, openings covered by fans around their middle; None where they are large."""
    area = areas(points, faces)
    total = np.linalg.norm(area, axis=1).sum()
    if total == 0 or np.linalg.norm(area.sum(axis=0)) > NEARLY_CLOSED * total:
        return None
    x = points[faces] - points[faces[0, 0]]
    volume = np.einsum("fi,fi->", x[:, 0], np.cross(x[:, 1], x[:, 2]))
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = len(points)
    missing = directed[~np.isin(directed @ [1, count], directed[:, ::-1] @ [1, count])]
    if len(missing):
        graph = coo_array((np.ones(len(missing)), missing.T), shape=(count, count))
        _, hole = connected_components(graph, directed=False)
        ends = points[missing] - points[faces[0, 0]]
        label, weight = hole[missing[:, 0]], np.bincount(hole[missing[:, 0]])
        middle = [np.bincount(label, ends[:, 0, axis])[label] / weight[label] for axis in range(3)]
        volume += np.einsum("fi,fi->", np.stack(middle, axis=1), np.cross(ends[:, 1], ends[:, 0]))
    return None if abs(volume) < 1e-6 * total**1.5 else float(volume) / 6.0


def _is_hollow(
    points: np.ndarray, faces: np.ndarray, mine: np.ndarray, sheet: np.ndarray, enclosed: list[float | None]
) -> bool:
    """A sheet that looks inwards is right inside another one that looks outwards: the inner side of a thick wall."""
    outer = [number for number, volume in enumerate(enclosed) if volume is not None and volume > 0]
    around = faces[np.isin(sheet, outer)]
    if not len(around):
        return False
    inside = igl.winding_number(points, around, points[np.unique(faces[mine])[:1]])
    return bool(inside[0] > 0.5)


def _is_behind(garment: np.ndarray, points: np.ndarray, faces: np.ndarray) -> bool:
    side = igl.signed_distance(garment, points, faces, sign_type=igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL)[0]
    return bool(np.mean(side < 0) > CLEAR)
