"""The spring-hinge law fitted to recorded frames: the analytic law that every learned one has to beat."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.data.windows import Window
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.baked.spline_plane import SplinePlane
from drape.energy.law.deformation import StretchHinge
from drape.energy.law.hinge_law import fabrics_damper
from drape.errors import DrapeError
from drape.geometry.edge_geometry import TINY, EdgeGeometry
from drape.scene.material import ATTRIBUTES, Material

COEFFICIENTS = (
    "spring_before_N_per_m",
    "spring_now_N_per_m",
    "spring_next_N_per_m",
    "hinge_before_J",
    "hinge_now_J",
    "hinge_next_J",
    "damper_kg_per_s",
    "drag_kg_per_s",
)
"""k₋, k₀, k₊, b₋, b₀, b₊, c, d of :class:`SpringHingeLaw`."""
ROUNDS = 15
"""Of reweighting, at most."""
SETTLED = 1e-4
"""Relative change of the coefficients in a round at which the fit ends."""
FLOOR = 1e-3
"""Residuals count as at least this share of the mean force of the fabric."""


class SpringHingeLaw(nn.Module):
    """Forces of edges that are springs and of inner edges that are hinges, eight coefficients for each fabric.

    With the energies ``Σ ½Δl²`` of edges and ``Σ ½Δθ²`` of inner edges, Δl and Δθ being the changes of length [m] and
    dihedral angle [rad] from rest, and their forces ``s = -∂/∂x Σ½Δl²`` and ``h = -∂/∂x Σ½Δθ²``, the force on vertex i
    in the equation of motion of recorded frames t-1, t, t+1 is

        f_i = k₋ s(t-1) + k₀ s(t) + k₊ s(t+1) + b₋ h(t-1) + b₀ h(t) + b₊ h(t+1)
              + c Σ_j ((v_j - v_i)·y) y - d v_i   [N]

    with ``v = (x(t+1) - x(t))/dt``, the other ends j of its edges and their directions y at t, the axial damper c and
    the drag d [kg/s]. That forces of several frames act is the recorder's doing
    (:class:`drape.energy.law.timing.Timing`); the spring constant of the fabric is ``k₋ + k₀ + k₊``
    [N/m], the stiffness of its hinges ``b₋ + b₀ + b₊`` [J].
    """

    coefficients: Float[Tensor, "fabrics 8"]

    def __init__(self, coefficients: Float[Tensor, "fabrics 8"]):
        super().__init__()
        self.register_buffer("coefficients", coefficients)

    @classmethod
    def fit(cls, windows: Iterable[Sequence[Window]], num_fabrics: int) -> SpringHingeLaw:
        """Fit the equation of motion ``f = m a - m g`` on the free vertices; see :func:`balanced`.

        Each window comes alone, or with others of the same cloth some frames away, whose :func:`force_basis` are the
        instruments then: noise on positions makes springs look soft, since each strain that is seen is part noise, but
        the noise of other frames has nothing to do with it.

        The coefficients of a fabric of which there is no window are NaN.

        Raises:
            DrapeError: no windows, or nothing moves in them.
        """
        seen: dict[int, list[tuple[Tensor, Tensor, Tensor]]] = {}
        for window, *others in windows:
            basis, force = force_basis(window).cpu(), window.inertial_force.cpu()
            instruments = torch.cat([force_basis(other).cpu() for other in others], 1) if others else basis
            fabric = window.fabric[window.mesh.mesh_of_vertex].masked_fill(~window.free, -1).cpu()
            for number in set(window.fabric.tolist()):
                here = fabric == number
                seen.setdefault(number, []).append((basis[here], force[here], instruments[here]))
        coefficients = torch.full((num_fabrics, len(COEFFICIENTS)), torch.nan, dtype=torch.float64)
        for number, parts in seen.items():
            basis, force, instruments = (torch.cat(part) for part in zip(*parts, strict=True))
            if bool((basis.abs() > TINY).any()):
                coefficients[number] = balanced(basis, force, instruments)
        if bool(coefficients.isnan().all()):
            raise DrapeError("spring-hinge law: nothing moves in the training windows; expected moving cloth to fit it")
        return cls(coefficients)

    def forward(self, window: Window) -> Float[Tensor, "vertices 3"]:
        """The force f on each vertex [N].

        Raises:
            DrapeError: a fabric that the law was not fitted on.
        """
        coefficients = self.coefficients[window.fabric]
        if bool(coefficients.isnan().any()):
            unknown = sorted(set(window.fabric[coefficients.isnan().any(-1)].tolist()))
            raise DrapeError(f"spring-hinge law: not fitted on the fabrics number {unknown}; fit it on data with them")
        coefficients = coefficients[window.mesh.mesh_of_vertex]
        return (coefficients[:, None] @ force_basis(window))[:, 0]

    @property
    def stiffness(self) -> Float[Tensor, "fabrics 2"]:
        """``k₋ + k₀ + k₊`` [N/m] and ``b₋ + b₀ + b₊`` [J] of each fabric."""
        return torch.stack([self.coefficients[:, :3].sum(1), self.coefficients[:, 3:6].sum(1)], 1)

    def force_residual(self, window: Window) -> Float[Tensor, "vertices 3"]:
        """``m a - m g - f`` [N]; 0 at pins. The same as ``StepEnergies.force_residual`` is of an energy."""
        return (window.inertial_force - self(window)) * window.free[:, None]

    def of_fabric(self, number: int, material: Material, face_area: float, dt: float) -> BakedHinges:
        """``φp = ½(k₋ + k₀ + k₊) Δl² + ½(b₋ + b₀ + b₊) Δθ²`` [J] of an edge of one fabric, with its drag and damper.

        A constant needs a table of a single node. Coefficients below 0 count as 0: no step may gain energy from them.

        Args:
            number: of the fabric among those fitted.
            material: its settings.
            face_area: mean area of the faces of the mesh fitted on [m²].
            dt: between the frames fitted on [s].
        """
        stiffness = self.stiffness[number].clamp(min=0.0).cpu().numpy()
        damper, drag = self.coefficients[number, 6:].clamp(min=0.0).tolist()
        return BakedHinges(
            SplinePlane(stiffness[:, None, None], first=(0, 0), step=(1.0, 1.0)),
            fabric=material,
            attributes=torch.zeros(len(ATTRIBUTES), dtype=torch.float64),
            stretch_scale=1.0,
            angle_scale=1.0,
            face_area=face_area,
            damper=fabrics_damper(damper, stiffness[0], dt),
            drag=drag,
        )


def force_basis(window: Window) -> Float[Tensor, "vertices coefficients 3"]:
    """The force on each vertex for each coefficient being 1, the others 0."""
    mesh, v = window.mesh, window.v_next
    with torch.enable_grad():
        x = torch.stack([window.x_prev, window.x, window.x_next]).detach().requires_grad_()
        geometry = EdgeGeometry(x, mesh)
        energies = 0.5 * StretchHinge()(geometry).square().sum((0, 1))
        springs, hinges = (-torch.autograd.grad(energy, x, retain_graph=True)[0] for energy in energies)
    first, second = mesh.edges.unbind(-1)
    direction = geometry.direction[1].detach()
    pull = ((v[second] - v[first]) * direction).sum(-1, keepdim=True) * direction
    damper = torch.zeros_like(v).index_add(0, first, pull).index_add(0, second, -pull)
    return torch.stack([*springs, *hinges, damper, -v], 1)


def balanced(
    basis: Float[Tensor, "vertices n 3"], force: Float[Tensor, "vertices 3"], instruments: Float[Tensor, "vertices m 3"]
) -> Float[Tensor, " n"]:
    """The c of ``force = Σ_k c_k basis_k`` by two-stage least squares, reweighted.

    The basis is replaced by what its ``instruments`` say of it, ``P = Z (Zᵀ W Z)⁻¹ Zᵀ W B``, and c solves
    ``Pᵀ W (force - B c) = 0``. With noise on the basis that is not on the instruments c is right on the mean, where
    that of least squares, which have the basis for their instruments, is too small (Wooldridge, Econometric Analysis
    of Cross Section and Panel Data, 2010, chapter 5). Each vertex has the weight of one over its last residual, which
    counts as ``FLOOR`` of the mean force at least, so that distances are minimised: squares would let a few violent
    windows decide. A coefficient that the data do not show is 0.
    """
    floor = (FLOOR * force.norm(dim=-1).mean()).clamp(min=torch.finfo(force.dtype).eps)
    (basis, scale), (instruments, _) = _scaled(basis), _scaled(instruments)
    found, weight = scale.new_zeros(len(scale)), torch.ones_like(force[:, 0])
    for _ in range(ROUNDS):
        weighted = weight[:, None, None] * instruments
        of_instruments, of_basis = (torch.einsum("vik,vjk->ij", weighted, other) for other in (instruments, basis))
        first = torch.linalg.pinv(of_instruments, rtol=1e-12, hermitian=True) @ of_basis
        moment = first.T @ torch.einsum("vik,vk->i", weighted, force)
        before, found = found, torch.linalg.pinv(first.T @ of_basis, rtol=1e-12, hermitian=True) @ moment
        if (found - before).norm() <= SETTLED * found.norm():
            break
        weight = 1.0 / (force - torch.einsum("vik,i->vk", basis, found)).norm(dim=-1).clamp(min=floor)
    return found * scale


def _scaled(basis: Float[Tensor, "vertices n 3"]) -> tuple[Float[Tensor, "vertices n 3"], Float[Tensor, " n"]]:
    """Each function of size 1, and by what it was multiplied; 0 stays 0."""
    size = basis.square().sum((0, 2)).sqrt()
    scale = torch.where(size > 0, 1.0 / size, 0.0)
    return basis * scale[:, None], scale
