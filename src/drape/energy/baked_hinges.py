"""The law of one fabric as splines, in memory and on disk, with a certificate of how far it is from its network."""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.whole_file import whole_file
from drape.energy.hinge_law import HingeLaw, HingeSlopes
from drape.energy.spline_plane import SplinePlane
from drape.errors import DrapeError
from drape.scene.material import Material

FORMAT = "drape baked law"
VERSION = 2
NUMBERS = ("stretch_scale", "angle_scale", "face_area", "damper", "drag")
"""What stands in the file as the arguments of :class:`BakedHinges` of the same names."""
SOFTEST = 0.1
"""Share of what the mean stiffness of a table would store, below which differences do not count as relative ones."""
ROUNDING = 1e-9
"""Relative difference of stored samples up to which the certificate of a table that is read holds."""


@dataclass(frozen=True)
class Bounds:
    """Largest shares of a :class:`Certificate` that are let through."""

    energy: float
    force: float


@dataclass(frozen=True)
class Certificate:
    """Largest relative differences between a baked law and its network, wherever the table covers.

    ``energy``: of φp; ``force``: of its slopes in Δl and Δθ, each relative to the size of a slope that a spring and a
    hinge alone have there, ``2 φp / |Δl|`` and ``2 φp / |Δθ|``, so that small deformations count as large ones do. φp
    counts as ``SOFTEST`` of :meth:`BakedHinges.usual` at least: hinges of a limp fabric may store nothing somewhere.
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

    @classmethod
    def of(cls, baked: BakedHinges, q: Float[Tensor, "samples 2"], true: HingeSlopes, **facts: object) -> Certificate:
        """Of a table, compared with what its network says at ``q``."""
        return cls(**facts, **differences(baked, q, true.energy, true.gradient))

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


def differences(
    baked: BakedHinges,
    q: Float[Tensor, "samples 2"],
    energy: Float[Tensor, " samples"],
    slopes: Float[Tensor, "samples 2"],
) -> dict[str, float]:
    """``energy`` and ``force`` of a :class:`Certificate`."""
    found = baked.slopes(q)
    size = torch.maximum(energy.abs(), SOFTEST * baked.usual(q)).clamp(min=torch.finfo(energy.dtype).tiny)
    force = (found.gradient - slopes).abs() * q.abs() / (2.0 * size[:, None])
    return {"energy": float(((found.energy - energy).abs() / size).max()), "force": float(force.max())}


class BakedHinges(HingeLaw):
    """``φp = ½ K(u, v) z² + ½ B(u, v) y²``, z = Δl/stretch_scale, y = Δθ/angle_scale, u = asinh z, v = ln(1 + y²).

    K and B are cubic splines [J] that are never negative; beyond their nodes they are constant, so that φp goes on as
    a parabola. It is the form of :class:`HingePotential`: zero at rest, with no force there.
    """

    certificate: Certificate
    samples: Float[Tensor, "samples 5"]
    """(Δl, Δθ, φp and its two slopes) of the network, at which the certificate is checked when the table is read."""

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


def save_baked(law: BakedHinges, path: Path) -> None:
    """Write ``law`` and its certificate; the file is whole or not there."""
    content = {name: getattr(law, name) for name in NUMBERS}
    content |= {"fabric": asdict(law.fabric), "attributes": law.attributes.tolist()}
    content |= {"format": FORMAT, "version": VERSION, "first": law.plane.first, "step": law.plane.step}
    content |= {"certificate": asdict(law.certificate)}
    with whole_file(path) as temporary:
        np.savez_compressed(
            temporary,
            content=np.array(json.dumps(content)),
            table=law.plane.values,
            samples=law.samples.numpy(),
        )


def read_baked(path: str | Path) -> BakedHinges:
    """The law of a table, compared at stored samples with the network that it was made from.

    Raises:
        DrapeError: no such file, not a table of this program, another version of it, or a damaged one.
    """
    path = Path(path)
    if not path.is_file():
        raise DrapeError(f"{path}: no such table; python src/bake.py fabric=... path={path} makes one")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        content = json.loads(str(arrays.pop("content")))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DrapeError(
            f"{path}: cannot be read as a table ({type(error).__name__}): damaged, or not written by src/bake.py; "
            "bake it again"
        ) from error
    found = (content.get("format"), content.get("version")) if isinstance(content, dict) else (None, None)
    if found != (FORMAT, VERSION):
        raise DrapeError(f"{path}: found format {found}; expected {(FORMAT, VERSION)}; bake it again")
    try:
        law = _law(content, arrays)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise DrapeError(f"{path}: damaged: {type(error).__name__} {error}; bake it again") from error
    q, energy, slopes = law.samples[:, :2], law.samples[:, 2], law.samples[:, 3:]
    for name, share in differences(law, q, energy, slopes).items():
        promised = getattr(law.certificate, name)
        if not share <= promised * (1.0 + ROUNDING) + ROUNDING:
            raise DrapeError(
                f"{path}: its {name} differs by {share:.1e} from that of its network, where its certificate says at "
                f"most {promised:.1e}: damaged; bake it again"
            )
    return law


def _law(content: dict, arrays: dict[str, np.ndarray]) -> BakedHinges:
    stored = content["certificate"].items()
    law = BakedHinges(
        SplinePlane(arrays["table"], tuple(content["first"]), tuple(content["step"])),
        fabric=Material(**content["fabric"]),
        attributes=torch.tensor(content["attributes"], dtype=torch.float64),
        **{name: content[name] for name in NUMBERS},
    )
    law.certificate = Certificate(**{key: tuple(value) if isinstance(value, list) else value for key, value in stored})
    law.samples = torch.from_numpy(arrays["samples"])
    return law
