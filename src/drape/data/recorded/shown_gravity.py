"""Gravity estimated from the motion of recorded cloth, whatever it is made of: a check of rate, unit and axes."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from drape.data.hdf5 import GarmentFile
from drape.data.sequence import GarmentSequence
from drape.errors import DrapeError

OFF = 0.25
"""Difference between the gravity that is said to act and the one that the motion shows, as a share, at most."""
ON_A_LINE = 1e-3
"""Largest distance of pins from the line through them, as a share of the size of the cloth."""
VISIBLE = 1e-3
"""Singular values below this share of the largest are of a component of gravity that the motion does not show."""


def shown_gravity(file: GarmentFile) -> Float[np.ndarray, "3"] | None:
    """The gravity that the training sequences show [m/s²]; None if all have pins that are not on one line.

    Internal forces have neither a sum nor a moment, and pins on a line have no moment about it. So of cloth without
    pins ``Σ m a = Σ m g - d Σ m v``, of cloth with one pin ``Σ m r x a = R x g - d Σ m r x v``, R = Σ m r, r from the
    pin, and with more of them the component along their line. Least squares over all frames give g and the drag d
    [1/s] of the air.

    Raises:
        DrapeError: it differs from that of the file by more than ``OFF``.
    """
    rows, sides = [], []
    for name in file.split("train"):
        found = _equations(file.sequence(name), file.dt)
        if found is not None:
            rows.append(found[0])
            sides.append(found[1])
    if not rows:
        return None
    matrix, side = np.concatenate(rows), np.concatenate(sides)
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    seen = values > VISIBLE * values[0]
    solution = right[seen].T @ ((left.T @ side)[seen] / values[seen])
    hidden = right[~seen, :3]  # what the motion does not show is taken from what is said
    gravity = solution[:3] + hidden.T @ (hidden @ file.gravity)
    if np.linalg.norm(gravity - file.gravity) > OFF * np.linalg.norm(file.gravity):
        raise DrapeError(_wrong(file, gravity))
    return gravity


def _equations(sequence: GarmentSequence, dt: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Coefficients of (gx, gy, gz, d) and right sides, one row for each frame and component."""
    x = sequence.positions
    a = (x[2:] - 2.0 * x[1:-1] + x[:-2]) / dt**2
    v = (x[2:] - x[:-2]) / (2.0 * dt)
    mass = sequence.mass[:, None]
    if not len(sequence.pinned):
        matrix = np.broadcast_to(mass.sum() * np.eye(3), (len(a), 3, 3))
        drag, side = -(mass * v).sum(1), (mass * a).sum(1)
        return np.concatenate([matrix, drag[..., None]], -1).reshape(-1, 4), side.reshape(-1)
    pins = x[0, sequence.pinned]
    _, spread, axes = np.linalg.svd(pins - pins.mean(0), full_matrices=False)
    if len(pins) > 2 and spread[1] > ON_A_LINE * np.ptp(x[0], axis=0).max():
        return None
    about = np.eye(3) if len(pins) == 1 else axes[:1]
    r = x[1:-1] - pins.mean(0)
    arm = (mass * r).sum(1)
    matrix = np.cross(about[None], arm[:, None])  # e · (R x g) = (e x R) · g
    drag, side = (np.cross(r, mass * moved).sum(1) @ about.T for moved in (-v, a))
    return np.concatenate([matrix, drag[..., None]], -1).reshape(-1, 4), side.reshape(-1)


def _wrong(file: GarmentFile, gravity: Float[np.ndarray, "3"]) -> str:
    size, said = float(np.linalg.norm(gravity)), float(np.linalg.norm(file.gravity))
    shown = ", ".join(f"{value:.3g}" for value in gravity)
    found = f"{file.path}: the motion shows gravity of ({shown}) m/s2; expected (0, 0, -{said:.4g}); "
    down = float(-gravity[2] / max(size, 1e-12))
    if down < 0.9:
        axis = "xyz"[int(np.argmax(np.abs(gravity)))]
        return f"{found}it pulls along {axis}: set data.up_axis, or more than gravity, air and pins moves the cloth"
    rate, unit = math.sqrt(said / size) / file.dt, said / size
    return (
        f"{found}the rate or the unit is wrong: it would fit at {rate:.3g} frames per second (data.fps), or "
        f"{unit:.3g} times as large (data.scale)"
    )
