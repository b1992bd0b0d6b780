"""Whether sizes, axes and places make sense: meshes come in all units, and most files do not say which."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from drape.errors import DrapeError

SMALLEST, LARGEST = 0.01, 100.0
"""Diagonal of the bounding box of any cloth [m]."""
CLOTHES = (0.1, 6.0)
"""Longest side of clothes, from those of a doll to a bridal train [m]."""
PEOPLE = (0.3, 2.5)
"""Height of people [m]."""
RATIO = 10.0
"""Largest ratio of the sizes of a garment and the body that wears it."""
UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "decimetres": 0.1}
LIKELY = (0.25, 3.0)
"""Longest side of most clothes and bodies [m]."""


def size(positions: Float[np.ndarray, "... 3"]) -> float:
    """Diagonal of the bounding box."""
    points = positions.reshape(-1, 3)
    return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))


def check_cloth_size(
    positions: Float[np.ndarray, "vertices 3"], where: str, asked: bool = False, setting: str = "scene.scale"
) -> None:
    """Refuse a cloth whose unit cannot be the metre; ``asked``: its ``setting`` was given, unusual sizes are meant.

    Raises:
        DrapeError: smaller than 1 cm or larger than 100 m; no size of clothes, unless ``asked``.
    """
    longest = float(np.ptp(positions, axis=0).max())
    if not SMALLEST <= size(positions) <= LARGEST:
        raise DrapeError(
            f"{where}: found a cloth of {size(positions):.3g} m; expected {SMALLEST} to {LARGEST:.0f} m; "
            f"{_units(longest)}: set {setting}"
        )
    if not asked and not CLOTHES[0] <= longest <= CLOTHES[1]:
        raise DrapeError(
            f"{where}: found a cloth {longest:.3g} m long, if its unit is the metre; expected {CLOTHES[0]:g} to "
            f"{CLOTHES[1]:g} m; {_units(longest)}: set {setting}, to 1 if it is so large"
        )


def _units(longest: float) -> str:
    """Sizes that the numbers of a file would mean in other units."""
    fits = {unit: longest * scale for unit, scale in UNITS.items() if LIKELY[0] <= longest * scale <= LIKELY[1]}
    if not fits:
        return "the file seems to have another unit (0.001 for millimetres, 0.01 for centimetres)"
    told = " or ".join(f"{length:.2g} m in {unit} (scale {UNITS[unit]:g})" for unit, length in fits.items())
    return f"the file seems to have another unit: it would be {told}"


OTHER = {"z": "y", "y": "z"}
"""The axis that may be up instead."""


def check_upright(positions: Float[np.ndarray, "vertices 3"], where: str, assumed: str | None) -> None:
    """Refuse a body that lies like a person of another up axis, where one was ``assumed`` as nobody says it.

    As tall as people along y, half as deep along z or less, standing on y = 0 with z = 0 inside it.

    Raises:
        DrapeError: it does.
    """
    if assumed is None:
        return
    (_, low_y, low_z), (_, high_y, high_z) = positions.min(axis=0), positions.max(axis=0)
    tall, deep = high_y - low_y, high_z - low_z
    stands = abs(low_y if assumed == "z" else high_y) < 0.06 * tall and low_z < 0.0 < high_z
    if PEOPLE[0] <= tall <= PEOPLE[1] and 0.05 * tall < deep < 0.5 * tall and stands:
        raise DrapeError(
            f"{where}: found a body {tall:.3g} m long along y and {deep:.3g} m high along z, lying like a person whose "
            f"up axis is {OTHER[assumed]}; expected +z up; set scene.up_axis={OTHER[assumed]} "
            f"(scene.body_up_axis={OTHER[assumed]} for the body alone), or {assumed} if it does lie"
        )


def perhaps_lying(positions: Float[np.ndarray, "vertices 3"], assumed: str | None) -> list[str]:
    """Remark on a garment without a body that lies as those of another up axis do than was ``assumed``.

    For z: it is above y = 0 around z = 0; for y: below y = 0.
    """
    if assumed is None:
        return []
    positions = positions * [1.0, 1.0 if assumed == "z" else -1.0, 1.0]
    (low_x, low_y, low_z), (high_x, high_y, high_z) = positions.min(axis=0), positions.max(axis=0)
    around = abs(low_x + high_x) < 0.4 * (high_x - low_x) and low_z < 0.0 < high_z
    if not (around and low_y > max(0.2, 0.2 * (high_y - low_y))):
        return []
    return [
        f"the garment is {low_y:.3g} to {high_y:.3g} m along y and around 0 along z: perhaps {OTHER[assumed]} is up in "
        f"its file (then set scene.up_axis={OTHER[assumed]})"
    ]


def check_garment_and_body(
    garment: Float[np.ndarray, "vertices 3"],
    body: Float[np.ndarray, "body_vertices 3"],
    garment_where: str,
    body_where: str,
    assumed: tuple[str | None, str | None] = (None, None),
) -> None:
    """Refuse a garment and a body that cannot belong together; ``assumed``: what is up, where nobody says it.

    Raises:
        DrapeError: sizes that differ by more than a factor of 10; bounding boxes further apart than the body's size; a
            garment that would be around the body if one of them were turned to another up axis.
    """
    garment_size, body_size = size(garment), size(body)
    both = f"{garment_where} and {body_where}"
    if max(garment_size, body_size) > RATIO * min(garment_size, body_size):
        who = body_where if LIKELY[0] <= garment_size <= LIKELY[1] else garment_where
        longest = float(np.ptp(body if who == body_where else garment, axis=0).max())
        raise DrapeError(
            f"{both}: found sizes of {garment_size:.3g} m and {body_size:.3g} m; expected them within a factor of "
            f"{RATIO:.0f}; they seem to have different units ({who}: {_units(longest)}): set scene.scale (cloth) or "
            "scene.body_scale"
        )
    turns = (
        ("up_axis", assumed[0], _turned(garment, assumed[0]), body),
        ("body_up_axis", assumed[1], garment, _turned(body, assumed[1])),
    )
    for setting, axis, first, second in turns:
        if axis and _shared(garment, body) < 0.2 and _shared(first, second) > 0.8:
            raise DrapeError(
                f"{both}: found them beside each other, but they fit if {OTHER[axis]} is up in one of them: set "
                f"scene.{setting}={OTHER[axis]}, or scene.{setting}={axis} if they are meant so"
            )
    distance = float(np.linalg.norm(_gap(garment, body)))
    if distance > body_size:
        raise DrapeError(
            f"{both}: found the cloth {distance:.3g} m away from a body of {body_size:.3g} m; expected it on the body "
            "or near it; move one of them, or set scene.up_axis if their axes differ"
        )


def beside(garment: Float[np.ndarray, "vertices 3"], body: Float[np.ndarray, "body_vertices 3"]) -> list[str]:
    """Remark on a garment that is not above, below or around its body, and will fall past it (+z up)."""
    distance = float(np.linalg.norm(_gap(garment, body)[:2]))
    if distance == 0.0:
        return []
    return [
        f"the garment is {distance:.3g} m beside the body and falls past it; move one of them, or see scene.up_axis"
    ]


def _gap(garment: np.ndarray, body: np.ndarray) -> Float[np.ndarray, "3"]:
    """Between the bounding boxes along each axis; 0 where they overlap."""
    gap = np.maximum(garment.min(axis=0) - body.max(axis=0), body.min(axis=0) - garment.max(axis=0))
    return np.maximum(gap, 0.0)


def _shared(garment: np.ndarray, body: np.ndarray) -> float:
    """Share of the garment's bounding box that is in the body's, an eighth larger; the smallest along an axis."""
    low, high = body.min(axis=0), body.max(axis=0)
    grown = 0.125 * (high - low).max()
    length = np.minimum(garment.max(axis=0), high + grown) - np.maximum(garment.min(axis=0), low - grown)
    return float(np.clip(length / np.maximum(np.ptp(garment, axis=0), 1e-9), 0.0, 1.0).min())


def _turned(positions: np.ndarray, assumed: str | None) -> np.ndarray:
    """As they would be if the other axis were up in their file than was assumed."""
    sign = -1.0 if assumed == "y" else 1.0
    return np.stack([positions[:, 0], -sign * positions[:, 2], sign * positions[:, 1]], axis=1)
