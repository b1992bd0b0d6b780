"""Random start of a sequence: a bent and turned sheet, and what accelerates it before the recording begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

WAVES = 3
"""Half waves of curvature across the sheet: the smoothness of a bend."""
SAMPLES = 512
"""Points at which a bend is integrated (trapezoidal rule)."""


@dataclass(frozen=True, eq=False)
class InitialState:
    """Start of a sequence; Blender lets it move for ``preroll`` frames before the recording."""

    positions: Float[np.ndarray, "vertices 3"]
    """Positions at rest (velocity 0) [m]."""
    preroll: int
    """Frames between the start and the first recorded frame."""
    push: Float[np.ndarray, " 3"]
    """Acceleration added to gravity during the pre-roll only [m/s²]."""


def random_state(
    rest_positions: Float[np.ndarray, "vertices 3"],
    pinned: Int[np.ndarray, " pinned"],
    ranges: Mapping[str, Any],
    bending_stiffness: float,
    rng: np.random.Generator,
) -> InitialState:
    """A sheet bent into a cylinder (so without strain), turned about its pinned edge, and pushed.

    The axis of the cylinder has a random direction in the sheet. Its profile is a plane curve of curvature κ(u) with
    ``∫|κ| du <= turning`` and ``|κ| <= curvature / size``. A plane curve that turns by less than 180 degrees cannot
    meet itself, so the sheet does not pass through itself at the start. A bend across the pinned edge brings the pins
    closer together than they are at rest. The angle about the pinned edge is counted from hanging straight down.

    A stiff sheet that starts strongly bent shivers faster than the frame rate can show, which no law of the frames can
    explain: ``turning`` is at most ``stiff_turning / √(bending stiffness)``, a bound on the bending energy.

    ``ranges`` is the config node ``data.start``: ``turning`` and ``stiff_turning`` [degrees, largest], ``curvature``
    [1, largest], ``swing`` [degrees] and ``preroll`` [frames] as [lowest, highest], ``push`` [m/s², largest]. Uniform,
    except for the shape of the bend and the direction of the push (Gaussian).
    """
    size = float(np.ptp(rest_positions[:, :2], axis=0).max())
    turning = min(ranges["turning"], ranges["stiff_turning"] / np.sqrt(max(bending_stiffness, 1e-9)))
    bent = _bend(rest_positions.astype(np.float64), np.radians(turning), ranges["curvature"] / size, rng)
    swing = np.radians(rng.uniform(*ranges["swing"]))
    positions = _hang(bent, pinned, swing)
    direction = rng.normal(size=3)
    push = rng.uniform(0.0, ranges["push"]) * direction / np.linalg.norm(direction)
    low, high = ranges["preroll"]
    return InitialState(positions, int(rng.integers(low, high + 1)), push)


def _bend(rest: np.ndarray, turning: float, largest: float, rng: np.random.Generator) -> np.ndarray:
    """Bend the flat sheet over a cylinder whose axis makes a random angle with x; lengths in the sheet are kept."""
    angle = rng.uniform(0.0, np.pi)
    along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    offset = rest @ across
    u = np.linspace(offset.min(), offset.max(), SAMPLES)
    phase = np.pi * (u - u[0]) / (u[-1] - u[0])
    amplitude, shift = rng.normal(size=WAVES), rng.uniform(0.0, 2.0 * np.pi, size=WAVES)
    waves = np.arange(WAVES)
    curvature = (amplitude[:, None] * np.cos(waves[:, None] * phase + shift[:, None])).sum(axis=0)
    curvature *= turning * rng.uniform() / _integral(np.abs(curvature), u)[-1]
    peak = np.abs(curvature).max()
    if peak > largest:
        curvature *= largest / peak
    slope = _integral(curvature, u)
    profile = np.stack([_integral(np.cos(slope), u), _integral(np.sin(slope), u)])
    where = [np.interp(offset, u, values) for values in profile]
    return (rest @ along)[:, None] * along + where[0][:, None] * across + where[1][:, None] * np.array([0.0, 0.0, 1.0])


def _integral(values: np.ndarray, u: np.ndarray) -> np.ndarray:
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(u)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _hang(positions: np.ndarray, pinned: np.ndarray, swing: float) -> np.ndarray:
    """Put the line between the first and the last pin on the x axis and turn the sheet about it.

    At ``swing`` 0 the centre of the sheet is straight below that line.
    """
    first, last = positions[pinned[0]], positions[pinned[-1]]
    x = (last - first) / np.linalg.norm(last - first)
    centred = positions - 0.5 * (first + last)
    down = centred.mean(axis=0)
    down = down - (down @ x) * x
    down /= np.linalg.norm(down)
    local = centred @ np.stack([x, np.cross(down, x), down], axis=1)
    cos, sin = np.cos(swing), np.sin(swing)
    return np.stack([local[:, 0], cos * local[:, 1] + sin * local[:, 2], sin * local[:, 1] - cos * local[:, 2]], axis=1)
