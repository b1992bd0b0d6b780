"""A small square of cloth at the extremes of what can be asked of a solver."""

from __future__ import annotations

import numpy as np

from drape.errors import DrapeError
from drape.geometry.grid import square_grid
from drape.geometry.mesh import ClothMesh
from drape.scene.mass import vertex_masses
from drape.scene.material import Material
from drape.scene.pins import Pins
from drape.scene.scene import Scene, frame_time
from drape.scene.state import State

HUNG = ("fps", "frames", "edge", "mass", "needles", "pins", "far")
"""Cases that hang by two corners, from horizontal, in gravity."""
FREE = ("stretch", "scramble", "folded", "collapsed", "speed")
"""Cases without gravity, pins or anything else from outside."""
GRAVITY = 9.81
"""[m/s²]"""


def extreme(
    case: str,
    edge: float,
    resolution: int,
    pattern: str,
    areal_density: float,
    material: Material,
    fps: float,
    frames: int,
    seed: int,
) -> Scene:
    """The ``case``, a name and a number; all else is as the other arguments say.

    Hung by two corners: ``fps`` frames a second; that many ``frames``; ``edge`` [m], at rest; ``mass`` times
    ``areal_density``; ``needles``, triangles of this ratio of length to width at rest, of the same mass; ``pins`` that
    many sides of the cloth apart; ``far``, this many metres from the origin along each axis. Free: ``stretch`` by this
    factor; ``scramble``, every vertex moved at random by that many sides of the cloth; ``folded`` along the middle by
    that many degrees; ``collapsed`` to a point (0) or onto a line (1, 2: x or y axis); ``speed`` [m/s].

    Args:
        case: name and number, as in ``stretch 10``.
        edge: between neighbouring vertices at rest [m].
        resolution: vertices along a side.
        pattern: of the diagonals, see :func:`square_grid`.
        areal_density: [kg/m²]
        material: the fabric.
        fps: frames a second.
        frames: to simulate.
        seed: of the random numbers.

    Raises:
        DrapeError: an unknown case; see also :func:`square_grid`, :func:`vertex_masses`, :class:`Scene`.
    """
    name, value = _read(case)
    changed = {"fps": fps, "frames": frames, "edge": edge, "mass": 1.0, "needles": 1.0} | {name: value}
    size = changed["edge"] * (resolution - 1)
    mesh = _squeezed(square_grid(size, resolution, pattern), changed["needles"])
    rest = mesh.rest_positions.astype(np.float64)
    hung = name in HUNG
    x = rest.copy() if hung else _moved(rest, name, value, size, seed)
    pins = None
    if hung:
        corners = [0, resolution - 1]
        x[corners] *= value if name == "pins" else 1.0
        x += [value, -value, value] if name == "far" else [0.0, 0.0, 0.0]
        pins = Pins.fixed(corners, x)
    return Scene(
        name=f"extreme, {case}",
        mesh=mesh,
        initial=State(x, np.full_like(x, value if name == "speed" else 0.0) * [1.0, 0.0, 0.0]),
        material=material,
        mass=vertex_masses(mesh, {"areal_density": areal_density * changed["mass"] * changed["needles"]}),
        gravity=np.array([0.0, 0.0, -GRAVITY if hung else 0.0]),
        dt=frame_time(changed["fps"]),
        frames=int(changed["frames"]),
        pins=pins,
    )


def _read(case: str) -> tuple[str, float]:
    name, _, number = case.partition(" ")
    known = ", ".join((*HUNG, *FREE))
    try:
        value = float(number)
    except ValueError:
        value = np.nan
    if name not in (*HUNG, *FREE) or not np.isfinite(value):
        raise DrapeError(f"scene.case: found {case!r}; expected a name among {known} and a number, as in 'stretch 10'")
    return name, value


def _squeezed(mesh: ClothMesh, ratio: float) -> ClothMesh:
    """The same triangles, ``ratio`` times shorter along y."""
    return ClothMesh.from_faces(mesh.rest_positions / np.array([1.0, ratio, 1.0], np.float32), mesh.faces, "needles")


def _moved(rest: np.ndarray, name: str, value: float, size: float, seed: int) -> np.ndarray:
    """First positions of a free case."""
    x = rest.copy()
    if name == "stretch":
        x *= value
    elif name == "scramble":
        x += value * size * np.random.default_rng(seed).normal(size=x.shape)
    elif name == "folded":
        right, angle = x[:, 0] > 0, np.deg2rad(value)
        x[right] = np.stack([x[right, 0] * np.cos(angle), x[right, 1], x[right, 0] * np.sin(angle)], axis=1)
    elif name == "collapsed":
        kept: dict[float, list[float]] = {0: [0.0, 0.0, 0.0], 1: [1.0, 0.0, 0.0], 2: [0.0, 1.0, 0.0]}
        if value not in kept:
            raise DrapeError(f"scene.case: found 'collapsed {value:g}'; expected 0, 1 or 2")
        x *= np.array(kept[value])
    return x
