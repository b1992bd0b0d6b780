"""The law of one fabric as splines, with a certificate of how far it is from its network."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.law.hinge_law import HingeLaw
from drape.errors import DrapeError
from drape.scene.material import Material

SOFTEST = 0.1
"""Share of what the mean stiffness of a table would store, below which differences do not count as relative ones."""
UNEVEN = 4000.0
"""Largest fourth difference of nodes, in differences from the network. A cubic spline through f is ``h⁴ f⁽⁴⁾/384`` away
from it halfway between nodes at a distance h, where f is smooth: ten times that is an edited node, not a law."""


@dataclass(frozen=True)
class Bounds:
    """Largest shares of a :class:`Certificate` that are let through."""

    energy: float
    force: float


@dataclass(frozen=True)
class Certificate:
    """Largest relative differences between a baked law and its network, wherever the table covers.

    ``energy``: of φp, and no less than the nodes tell (:meth:`BakedHinges.differences`); ``force``: of its slopes
    in Δl and Δθ, each relative to the size of a slope that a spring and a hinge alone have there, ``2 φp / |Δl|`` and
    ``2 φp / |Δθ|``, so that small deformations count as large ones do. φp counts as ``SOFTEST`` of
    :meth:`BakedHinges.usual` at least: hinges of a limp fabric may store nothing somewhere.
    ``constants``: of :attr:`HingeLaw.constants`.
    """

    fabric: str
    checkpoint: str
    sha256: str
    nodes: tuple[int, int]
    """Of the table, in asinh(Δl/stretch_scale) and ln(1 + (Δθ/angle_scale)²)."""
    stretch: tuple[float, float]
    """Δl that the table covers [m]."""
    seconds: float
    """That baking took."""
    energy: float
    force: float
    constants: float

    @classmethod
    def of(cls, baked: BakedHinges, true: Samples, **facts: Any) -> Certificate:
        """Of a table, compared with what its network says."""
        differences: dict[str, Any] = baked.differences(true)
        return cls(**facts, **differences)

    def check(self, bounds: Bounds) -> None:
        """Refuse a table that is too far from its network.

        Raises:
            DrapeError: a share above that of ``bounds``; what to change.
        """
        for name, bound in asdict(bounds).items():
            found = getattr(self, name)
            if not found <= bound:
                raise DrapeError(
                    f"table of {self.fabric}: {name}: found a difference of {found:.1e} from the network; expected at "
                    f"most {bound:.0e}; raise the resolution (table.step smaller)"
                )

    def text(self) -> str:
        """For a person."""
        return (
            f"{self.fabric} of {self.checkpoint} (sha256 {self.sha256[:12]}), {' x '.join(map(str, self.nodes))} "
            f"nodes, baked in {self.seconds:.1f} s\n"
            f"covers Δl from {self.stretch[0]:.3g} to {self.stretch[1]:.3g} m and all angles\n"
            f"largest relative differences from the network: energy {self.energy:.1e}, forces {self.force:.1e}"
        )


class Samples(NamedTuple):
    """Values of a network, for a table to be compared with."""

    q: Float[Tensor, "samples 2"]
    """(Δl [m], Δθ [rad])"""
    energy: Float[Tensor, " samples"]
    slopes: Float[Tensor, "samples 2"]
    constants: Float[Tensor, "3"]

    @classmethod
    def of(cls, law: HingeLaw, q: Float[Tensor, "samples 2"]) -> Samples:
        """Those of ``law`` at ``q``."""
        found = law.slopes(q)
        return cls(q, found.energy, found.gradient, law.constants)

    def every(self, stride: int) -> Samples:
        """One of ``stride`` of them."""
        return Samples(self.q[::stride], self.energy[::stride], self.slopes[::stride], self.constants)

    def differences(self, baked: BakedHinges) -> dict[str, float]:
        """``energy``, ``force`` and ``constants`` of a :class:`Certificate`."""
        found, tiny = baked.slopes(self.q), torch.finfo(self.energy.dtype).tiny
        size = torch.maximum(self.energy.abs(), SOFTEST * baked.usual(self.q)).clamp(min=tiny)
        force = (found.gradient - self.slopes).abs() * self.q.abs() / (2.0 * size[:, None])
        constants = (baked.constants - self.constants).abs() / self.constants.abs().clamp(min=tiny)
        energy = (found.energy - self.energy).abs() / size
        return {"energy": float(energy.max()), "force": float(force.max()), "constants": float(constants.max())}


class BakedHinges(HingeLaw):
    """``φp = ½ K(u, v) z² + ½ B(u, v) y²``, z = Δl/stretch_scale, y = Δθ/angle_scale, u = asinh z, v = ln(1 + y²).

    K and B are cubic splines [J] that are never negative; beyond their nodes they are constant, so that φp goes on as
    a parabola. It is the form of :class:`HingePotential`: zero at rest, with no force there.
    """

    certificate: Certificate
    samples: Samples
    """Of the network, with which the certificate is checked when the table is read."""

    def __init__(
        self,
        plane: SplinePlane,
        *,
        fabric: Material,
        attributes: Float[Tensor, " attributes"],
        stretch_scale: float,
        angle_scale: float,
        face_area: float,
        damper: float,
        drag: float,
    ):
        super().__init__(face_area, damper, drag)
        self.plane, self.fabric, self.attributes = plane, fabric, attributes
        self.stretch_scale, self.angle_scale = stretch_scale, angle_scale

    def potential(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        z, y = q[:, 0] / self.stretch_scale, q[:, 1] / self.angle_scale
        k, b = self.plane(torch.asinh(z), torch.log1p(y.square()))
        return 0.5 * (k * z.square() + b * y.square())

    def usual(self, q: Float[Tensor, "edges 2"]) -> Float[Tensor, " edges"]:
        """``½ K z² + ½ B y²`` with the means of K and B over the table [J]."""
        k, b = self.plane.values.mean((1, 2)).tolist()
        return 0.5 * (k * (q[:, 0] / self.stretch_scale).square() + b * (q[:, 1] / self.angle_scale).square())

    def differences(self, true: Samples) -> dict[str, float]:
        """Those of the samples, but of the energy at least what the nodes tell of the places between them."""
        found = true.differences(self)
        return found | {"energy": float(np.maximum(found["energy"], self.unevenness() / UNEVEN))}

    def unevenness(self) -> float:
        """Largest fourth difference of K z² and of B y² along either axis of the nodes, as a share of their sum.

        The sum counts as ``SOFTEST`` of that with the means of K and B at least.
        """
        values, (u, v) = self.plane.values, self.plane.places
        with np.errstate(over="ignore", invalid="ignore"):  # what is not a number is no difference that is allowed
            squares = np.stack(np.broadcast_arrays(np.sinh(u)[:, None] ** 2, np.expm1(v).clip(min=0.0)))
            usual = SOFTEST * (squares * values.mean((1, 2), keepdims=True)).sum(0)
            size = np.maximum((squares * values).sum(0), usual).clip(min=np.finfo(np.float64).tiny)
            along_u = np.abs(np.diff(values, 4, axis=1)) * squares[:, 2:-2] / size[2:-2]
            along_v = np.abs(np.diff(values, 4, axis=2)) * squares[:, :, 2:-2] / size[:, 2:-2]
        return float(np.max([np.max(each, initial=0.0) for each in (along_u, along_v)]))
