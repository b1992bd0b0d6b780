"""Standing on the ground: soles at z = 0, and the foot that carries the body stays where it is."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from drape.figure.figure import Figure
from drape.figure.skinning import pose_vertices

SMOOTHING = 0.04
"""Over time [s]: the lowest vertex changes suddenly from one foot to the other."""
CONTACT = 0.005
"""Vertices lower than this above the lowest one carry the body [m]."""


def stand(
    transforms: Float[np.ndarray, "frames joints 4 4"],
    figure: Figure,
    fps: float,
    flight: Float[np.ndarray, " frames"],
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Move the body so that its lowest vertex is ``flight`` [m] above z = 0 and does not slide along the ground."""
    posed = pose_vertices(figure.rest_positions, figure.bones, figure.weights, transforms)
    lowest = posed[:, :, 2].min(axis=1)
    carries = np.exp(-(posed[:, :, 2] - lowest[:, None]) / CONTACT)
    both = np.minimum(carries[1:], carries[:-1])  # on the ground before and after the step
    slide = np.einsum("fv,fvc->fc", both, np.diff(posed[:, :, :2], axis=0)) / both.sum(axis=1, keepdims=True)
    on_ground = np.exp(-np.maximum(flight[1:], flight[:-1]) / CONTACT)
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(-slide * on_ground[:, None], axis=0)])
    moved = transforms.copy()
    moved[:, :, 2, 3] += (flight - smooth(lowest, fps))[:, None]
    moved[:, :, :2, 3] += smooth(path, fps)[:, None]
    return moved


def smooth(values: Float[np.ndarray, "frames *rest"], fps: float) -> Float[np.ndarray, "frames *rest"]:
    """Gaussian over :data:`SMOOTHING`; the ends are continued as mirror images through their last values."""
    reach = min(int(np.ceil(4 * SMOOTHING * fps)), len(values) - 1)
    if reach < 1:
        return values
    before = 2 * values[:1] - values[reach:0:-1]
    after = 2 * values[-1:] - values[-2 : -2 - reach : -1]
    padded = np.concatenate([before, values, after])
    return gaussian_filter1d(padded, SMOOTHING * fps, axis=0, truncate=4.0)[reach : reach + len(values)]
