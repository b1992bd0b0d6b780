"""Tabulate the trained law of one fabric as splines."""

from __future__ import annotations

import copy
import itertools
import math
import time
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from tqdm import tqdm

from drape.energy.baked_law import BakedLaw
from drape.energy.certificate import Certificate, Differences
from drape.energy.cubic_spline import SplineLine, SplineTable, coefficients
from drape.energy.edge_law import NetworkLaw, Slopes
from drape.errors import DrapeError
from drape.scene.material import Material

BEYOND = 8
"""Nodes outside the range: what is assumed of the spline's ends has faded where the range begins."""
CHUNK = 16384
"""Deformations evaluated at once."""


@dataclass(frozen=True)
class Resolution:
    """What a table covers, and how finely.

    Args:
        stretch: least and largest Δl, in longest edges of the mesh learned on.
        step: distance of nodes in asinh(Δl / stretch_scale).
        angles: nodes around a full turn.
        speed: fastest edge [m/s].
        speed_step: distance of nodes in asinh(speed / speed_scale).

    Raises:
        DrapeError: a range without rest inside, steps that are not positive, or fewer than four angles.
    """

    stretch: tuple[float, float]
    step: float
    angles: int
    speed: float
    speed_step: float

    def __post_init__(self) -> None:
        low, high = self.stretch
        if not (math.isfinite(low) and math.isfinite(high) and low < 0 < high):
            raise DrapeError(f"table.stretch: found [{low}, {high}]; expected a negative and a positive number")
        for name in ("step", "speed", "speed_step"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise DrapeError(f"table.{name}: found {value}; expected a number above 0")
        if self.angles < 4:
            raise DrapeError(f"table.angles: found {self.angles}; expected at least 4 nodes around a turn")


def bake(
    law: NetworkLaw,
    attributes: Float[Tensor, " attributes"],
    resolution: Resolution,
    *,
    fabric: Material,
    checkpoint: str = "",
    sha256: str = "",
    progress: bool = False,
) -> BakedLaw:
    """The law of the fabric with these ``attributes`` as splines, with its certificate.

    At rest energy, force and stiffness are the network's, exactly.
    """
    began = time.perf_counter()
    law = copy.deepcopy(law).double()
    longest = 2.0 * math.sqrt(law.face_area)  # the hypotenuse of half a square
    stretch = tuple(end * longest for end in resolution.stretch)
    scale = law.energy.potential.stretch_scale
    rest = law.potential_slopes(torch.zeros(1, 3, dtype=torch.float64), attributes[None], hessian=True)
    stationary = not (rest.energy.any() or rest.gradient.any())
    form = rest.hessian[0] * stationary
    u, first = _nodes([math.asinh(end / scale) for end in stretch], resolution.step)
    angles = resolution.angles if law.bends else 1
    values = _values(law, attributes, scale * np.sinh(u), angles, form, scale, progress)
    table = coefficients(values, periodic_axes=(1, 2))
    _match_rest(table, -first, resolution.step, rest, form, scale)
    least = -0.5 * float(form[0, 0]) * scale**2  # below it the parabola outside would open downwards
    table[[0, -1]] = table[[0, -1]].clip(min=least)
    line, rest_drag, speed_scale = _drag(law, attributes, resolution)
    baked = BakedLaw(
        fabric=fabric, bends=law.bends, face_area=law.face_area, dt=law.dt, attributes=attributes,
        stretch_scale=scale, speed_scale=speed_scale, rest_hessian=form, rest_drag=rest_drag,
        table=SplineTable(torch.from_numpy(table).float(), first, resolution.step), line=line,
    )  # fmt: skip
    seconds = time.perf_counter() - began
    baked.certificate = Certificate(
        fabric=fabric.name, checkpoint=checkpoint, sha256=sha256, nodes=table.shape, stretch=stretch,
        speed=resolution.speed, seconds=seconds,
        **Differences(law, attributes, baked, seed=0).measure(stretch, scale, resolution.speed),
    )  # fmt: skip
    return baked


def _nodes(ends: list[float], step: float) -> tuple[Float[np.ndarray, " nodes"], int]:
    """Multiples of ``step`` that cover ``ends`` and go beyond, and the number of the first."""
    first, last = math.floor(ends[0] / step) - BEYOND, math.ceil(ends[1] / step) + BEYOND
    return step * np.arange(first, last + 1), first


def _values(
    law: NetworkLaw,
    attributes: Tensor,
    stretch: Float[np.ndarray, " nodes"],
    angles: int,
    form: Float[Tensor, "3 3"],
    scale: float,
    progress: bool,
) -> Float[np.ndarray, "nodes angles angles"]:
    """``S = (φp - ½ yᵀ H y) / (1 + z²)`` at the nodes (see :class:`BakedLaw`)."""
    turn = torch.arange(angles, dtype=torch.float64) * (2.0 * math.pi / angles)
    q = torch.cartesian_prod(torch.from_numpy(stretch), turn, turn)
    parts = []
    for part in tqdm(q.split(CHUNK), desc="evaluating the network", disable=None if progress else True):
        with torch.no_grad():
            energy = law.potential(part, attributes.expand(len(part), -1))
        y = torch.cat([part[:, :1], part[:, 1:].sin()], 1)
        parts.append((energy - 0.5 * (y @ form * y).sum(-1)) / (1.0 + (part[:, 0] / scale).square()))
    return torch.cat(parts).view(len(stretch), angles, angles).numpy()


def _match_rest(
    table: Float[np.ndarray, "nodes angles angles"],
    node: int,
    step: float,
    rest: Slopes,
    form: Float[Tensor, "3 3"],
    scale: float,
) -> None:
    """Change the coefficients around rest as little as makes S and its derivatives up to second order exact."""
    angles = table.shape[1]
    turn = 2.0 * math.pi / angles
    at_node = [
        [np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-0.5, 0.0, 0.5]) / h, np.array([1.0, -2.0, 1.0]) / h**2]
        for h in (step, turn, turn)
    ]
    around = np.ix_(range(node - 1, node + 2), [-1, 0, 1], [-1, 0, 1])
    if angles == 1:  # S does not depend on them
        at_node[1:] = [[np.ones(1)]] * 2
        around = np.ix_(range(node - 1, node + 2), [0], [0])
    units = np.array([scale, 1.0, 1.0])  # dΔl/du = scale at rest
    energy, gradient = rest.energy.numpy()[0], rest.gradient[0].numpy() * units
    hessian = (rest.hessian[0] - form).numpy() * np.outer(units, units)
    hessian[0, 0] -= 2.0 * energy  # of the factor 1 + z²
    rows, targets = [], []
    for orders in itertools.product(*(range(len(weights)) for weights in at_node)):
        axes = [axis for axis, order in enumerate(orders) for _ in range(order)]
        if len(axes) <= 2:
            weights = [at_node[axis][order] for axis, order in enumerate(orders)]
            rows.append(np.einsum("i,j,k->ijk", *weights).ravel())
            targets.append((energy, gradient, hessian)[len(axes)][tuple(axes)])
    rows, present = np.stack(rows), table[around].ravel()
    change, *_ = np.linalg.lstsq(rows, np.array(targets) - rows @ present, rcond=None)
    table[around] = (present + change).reshape(table[around].shape)


def _drag(
    law: NetworkLaw, attributes: Tensor, resolution: Resolution
) -> tuple[SplineLine | None, tuple[float, float], float]:
    """The spline D, (d₀, d₁) and the speed scale (see :class:`BakedLaw`)."""
    if not law.dissipates:
        return None, (0.0, 0.0), 1.0
    scale = law.energy.units["dissipation"].speed_scale
    y = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    energy = law.drag(scale * y, attributes[None])
    (slope,) = torch.autograd.grad(energy.sum(), y, create_graph=True)
    (second,) = torch.autograd.grad(slope.sum(), y)
    start, slope = energy.item(), slope.item()
    w, first = _nodes([0.0, math.asinh(resolution.speed / scale)], resolution.speed_step)
    y = torch.from_numpy(np.sinh(w))
    with torch.no_grad():
        energy = law.drag(scale * y, attributes.expand(len(y), -1))
    values = ((energy - start - slope * y) / y.square()).numpy()
    values[-first] = 0.5 * float(second)
    line = coefficients(values)
    if start == slope == 0.0 and (values >= 0.0).all():
        line = line.clip(min=0.0)  # the spline of such coefficients is never negative either
    return SplineLine(torch.from_numpy(line).float(), first, resolution.speed_step), (start, slope), scale
