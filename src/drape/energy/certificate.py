"""How far a baked law is from its network: measured off the nodes, stored with the table, refused where too far."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from drape.energy.edge_law import EdgeLaw
from drape.errors import DrapeError

REST_STRETCH = 4.0
"""Largest |Δl| that counts as near rest, in stretch scales: where 90 % of the edges of the training data are."""
REST_ANGLE = math.radians(3.0)
SAMPLES = 20_000
"""In each of the regions."""


@dataclass(frozen=True)
class Bounds:
    """Largest shares of a :class:`Certificate` that are let through."""

    energy: float
    force: float
    rest_energy: float
    rest_force: float


@dataclass(frozen=True)
class Certificate:
    """Largest differences between a baked law and its network, as shares of the range of what is compared.

    Forces are the derivatives in Δl, α and β, each against its own range. Near rest the ranges are those of a box of
    |Δl| < 4 stretch scales, |α|, |β| < 3°, and of boxes a tenth and a hundredth as large; the worst of the three.
    """

    fabric: str
    checkpoint: str
    sha256: str
    nodes: tuple[int, int, int]
    """Of the table, in Δl, α and β."""
    stretch: tuple[float, float]
    """Δl that the table covers [m]."""
    speed: float
    """Fastest edge that the spline of the drag covers [m/s]."""
    seconds: float
    """That baking took."""
    energy: float
    force: tuple[float, float, float]
    energy_range: float
    """[J]"""
    force_range: tuple[float, float, float]
    """[N, J, J]"""
    rest_energy: float
    rest_force: tuple[float, float, float]
    drag: float
    drag_slope: float
    lowest: float
    """Least φp found [J]."""
    curvature_outside: float
    """Least ∂²φp/∂Δl² found outside the table [N/m]; from 0 on: convex there."""

    def check(self, bounds: Bounds) -> None:
        """Refuse a table that is too far from its network.

        Raises:
            DrapeError: a share above that of ``bounds``; what to change.
        """
        worst = {"energy": max(self.energy, self.drag), "force": max(*self.force, self.drag_slope)}
        worst |= {"rest_energy": self.rest_energy, "rest_force": max(self.rest_force)}
        for name, bound in asdict(bounds).items():
            if not worst[name] <= bound:
                raise DrapeError(
                    f"table of {self.fabric}: {name}: found a difference of {worst[name]:.1e} from the network; "
                    f"expected at most {bound:.0e}; raise the resolution (table.step smaller, table.angles larger)"
                )

    def text(self) -> str:
        """For a person."""
        force, rest = (", ".join(f"{share:.1e}" for share in shares) for shares in (self.force, self.rest_force))
        size = " x ".join(map(str, self.nodes))
        return (
            f"{self.fabric} of {self.checkpoint} (sha256 {self.sha256[:12]}), {size} nodes, baked in "
            f"{self.seconds:.1f} s\n"
            f"covers Δl from {self.stretch[0]:.3g} to {self.stretch[1]:.3g} m, all angles, up to {self.speed:.3g} m/s\n"
            f"largest differences from the network, as shares of the range:\n"
            f"  energy {self.energy:.1e}   forces in Δl, α, β {force}\n"
            f"  near rest: energy {self.rest_energy:.1e}   forces {rest}\n"
            f"  drag {self.drag:.1e}   its slope {self.drag_slope:.1e}\n"
            f"lowest energy {self.lowest:.2g} J; least curvature outside the table {self.curvature_outside:.3g} N/m"
        )


class Differences:
    """Measures the network ``law`` of a fabric against its baked form on random deformations and speeds."""

    def __init__(self, law: EdgeLaw, attributes: Float[Tensor, " attributes"], baked: EdgeLaw, seed: int):
        self.law, self.attributes, self.baked = law, attributes, baked
        self.random = torch.Generator().manual_seed(seed)

    def measure(self, stretch: tuple[float, float], stretch_scale: float, speed: float) -> dict[str, object]:
        """The measured fields of a :class:`Certificate`."""
        wide = self._compare(self._wide(stretch, stretch_scale))
        boxes = [torch.tensor([REST_STRETCH * stretch_scale, REST_ANGLE, REST_ANGLE]) * 0.1**k for k in range(3)]
        rest = [self._compare(self._uniform(-1.0, 1.0, 3) * box) for box in boxes]
        drag, drag_slope = self._drag(speed)
        return {
            "energy": wide["energy"],
            "force": wide["force"],
            "energy_range": wide["energy_range"],
            "force_range": wide["force_range"],
            "rest_energy": max(box["energy"] for box in rest),
            "rest_force": tuple(max(box["force"][k] for box in rest) for k in range(3)),
            "drag": drag,
            "drag_slope": drag_slope,
            "lowest": min(region["lowest"] for region in (wide, *rest)),
            "curvature_outside": self._curvature(stretch),
        }

    def _uniform(self, low: float, high: float, *columns: int) -> Tensor:
        return low + (high - low) * torch.rand(SAMPLES, *columns, generator=self.random, dtype=torch.float64)

    def _wide(self, stretch: tuple[float, float], scale: float) -> Float[Tensor, "samples 3"]:
        """Everything that the table covers, Δl even in asinh; a third each at any angles, bent, and flat."""
        low, high = (math.asinh(end / scale) for end in stretch)
        angles = self._uniform(-math.pi, math.pi, 2)
        angles[::3] *= 0.2
        angles[1::3] *= 0.02
        return torch.cat([scale * self._uniform(low, high, 1).sinh(), angles], 1)

    def _compare(self, q: Float[Tensor, "samples 3"]) -> dict[str, object]:
        attributes = self.attributes.expand(len(q), -1)
        true = self.law.potential_slopes(q, attributes, hessian=False)
        found = self.baked.potential_slopes(q, attributes, hessian=False)
        energy_range, force_range = _range(true.energy), _range(true.gradient)
        force = (found.gradient - true.gradient).abs().amax(0)
        # an energy that does not see the angles has no range of forces there
        share = torch.where(force_range > 0, force / force_range, 0.0)
        return {
            "energy": float((found.energy - true.energy).abs().max() / energy_range),
            "force": tuple(share.tolist()),
            "energy_range": float(energy_range),
            "force_range": tuple(force_range.tolist()),
            "lowest": float(found.energy.min()),
        }

    def _drag(self, fastest: float) -> tuple[float, float]:
        if not self.law.dissipates:
            return 0.0, 0.0
        speed = fastest * self._uniform(-12.0, 0.0).exp()
        attributes = self.attributes.expand(len(speed), -1)
        true, found = (law.drag_slopes(speed, attributes) for law in (self.law, self.baked))
        ranges = [max(float(_range(part)), 1e-300) for part in true]  # where nothing is lost there is no range
        return tuple(float((a - b).abs().max()) / size for a, b, size in zip(true, found, ranges, strict=True))

    def _curvature(self, stretch: tuple[float, float]) -> float:
        q = torch.cat([self._uniform(0.0, 5.0, 1).exp(), self._uniform(-math.pi, math.pi, 2)], 1)
        q[:, 0] *= torch.tensor(stretch, dtype=q.dtype).repeat(SAMPLES // 2)
        slopes = self.baked.potential_slopes(q, self.attributes.expand(len(q), -1), hessian=True)
        return float(slopes.hessian[:, 0, 0].min())


def _range(values: Tensor) -> Tensor:
    return values.amax(0) - values.amin(0)
