"""Tabulate the trained law of one fabric as splines."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.baked.hinges import BakedHinges, Certificate, Samples
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.law.hinge_law import NetworkHinges
from drape.errors import DrapeError
from drape.scene.material import Material

BEYOND = 8
"""Nodes outside the range: what is assumed of the spline's ends has faded where the range begins."""
SAMPLES = 20_000
"""Deformations at which a table is compared with its network."""
KEPT = 256
"""Of them, that are stored with the table, to be evaluated again when it is read."""


@dataclass(frozen=True)
class Resolution:
    """Range and spacing of a table; the dihedral angle is covered in full.

    Args:
        stretch: least and largest Δl, in longest edges of the mesh learned on.
        step: distance of nodes in asinh(Δl / stretch_scale) and in ln(1 + (Δθ / angle_scale)²).

    Raises:
        DrapeError: a range without rest inside, or a step that is not positive.
    """

    stretch: Sequence[float]
    step: float

    def __post_init__(self) -> None:
        low, high = self.stretch if len(self.stretch) == 2 else (math.nan, math.nan)
        if not (math.isfinite(low) and math.isfinite(high) and low < 0 < high):
            raise DrapeError(f"table.stretch: found {list(self.stretch)}; expected a negative and a positive number")
        if not (math.isfinite(self.step) and self.step > 0):
            raise DrapeError(f"table.step: found {self.step}; expected a number above 0")


def bake(
    law: NetworkHinges, resolution: Resolution, *, fabric: Material, checkpoint: str = "", sha256: str = ""
) -> BakedHinges:
    """The law of a fabric as splines, with its certificate. At rest energy and forces are the network's, exactly."""
    began = time.perf_counter()
    law = copy.deepcopy(law).double()
    units = law.units
    scales = units.scales[0], (*units.scales, 1.0)[1]
    longest = 2.0 * math.sqrt(law.face_area)  # the hypotenuse of half a square
    low, high = resolution.stretch
    stretch = low * longest, high * longest
    u, first_u = _nodes([math.asinh(end / scales[0]) for end in stretch], resolution.step)
    v, first_v = _nodes([0.0, math.log1p((math.pi / scales[1]) ** 2)], resolution.step)
    seen = torch.cartesian_prod(torch.from_numpy(u), torch.from_numpy(v))
    with torch.no_grad():
        stiffness = law.stiffness(seen).T.reshape(2, len(u), len(v))
    plane = SplinePlane(stiffness.numpy(), (first_u, first_v), (resolution.step, resolution.step))
    baked = BakedHinges(
        plane, fabric=fabric, attributes=law.attributes, stretch_scale=scales[0], angle_scale=scales[1],
        face_area=law.face_area, damper=law.damper, drag=law.drag,
    )  # fmt: skip
    true = Samples.of(law, _deformations(stretch, scales))
    baked.certificate = Certificate.of(
        baked, true, fabric=fabric.name, checkpoint=checkpoint, sha256=sha256, nodes=plane.nodes, stretch=stretch,
        seconds=time.perf_counter() - began,
    )  # fmt: skip
    baked.samples = true.every(SAMPLES // KEPT)
    return baked


def _nodes(ends: list[float], step: float) -> tuple[Float[np.ndarray, " nodes"], int]:
    """Multiples of ``step`` that cover ``ends`` and go beyond, and the number of the first."""
    first, last = math.floor(ends[0] / step) - BEYOND, math.ceil(ends[1] / step) + BEYOND
    return step * np.arange(first, last + 1), first


def _deformations(stretch: tuple[float, float], scales: tuple[float, float]) -> Float[Tensor, "samples 2"]:
    """Everything that a table covers, even in its coordinates."""
    random = torch.Generator().manual_seed(0)
    share = torch.rand(SAMPLES, 3, generator=random, dtype=torch.float64)
    low, high = (math.asinh(end / scales[0]) for end in stretch)
    angle = torch.expm1(share[:, 1] * math.log1p((math.pi / scales[1]) ** 2)).sqrt() * scales[1]
    angle = angle * torch.where(share[:, 2] < 0.5, -1.0, 1.0)
    return torch.stack([scales[0] * (low + (high - low) * share[:, 0]).sinh(), angle], 1)
