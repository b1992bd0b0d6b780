"""The sum of the energies that a scene requires, and no others: its minimum is the next frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from torch import Tensor, nn

from drape.energy.step import Step
from drape.energy.term import EnergyTerm, Stencils, array
from drape.energy.terms.contact import Contact, SurfaceContact
from drape.energy.terms.free_motion import ExternalForce, Gravity, Inertia
from drape.energy.terms.friction import Friction
from drape.energy.terms.ipc import Barrier
from drape.linalg.stencil_sum import Filled, StencilSum
from drape.scene.scene import Scene


class Evaluation(NamedTuple):
    """An incremental potential at one point."""

    energy: float
    """Sum over terms and cloths [J]."""
    gradient: Float[Tensor, "vertices 3"]
    """Minus the force on each vertex [N]."""
    terms: dict[str, float]
    """Energy of each term [J], by its name."""
    stored: float
    """Sum over the terms that store energy [J]: what the cloths have by where they are."""
    rounding: float
    """Differences of the energy that mean nothing [J]."""


def terms_of(
    fabric: Sequence[EnergyTerm], contact: Contact | None, friction: float | None, *, gravity: bool, external: bool
) -> list[EnergyTerm]:
    """Summands of an incremental potential, in the order of all tables; no term that costs and adds nothing.

    Args:
        fabric: the energies of its material.
        contact: with a body; None where there is none.
        friction: coefficient μ on the body; 0 or None leaves the term out.
        gravity: whether there is any.
        external: whether a constant force acts on the vertices.
    """
    terms = [Inertia(), *([Gravity()] if gravity else []), *([ExternalForce()] if external else []), *fabric]
    if contact is not None:
        terms += [contact, *([Friction(friction, contact)] if friction else [])]
    return terms


class IncrementalPotential(nn.Module):
    """``E(x') = inertia + Σ energies`` [J]; an implicit Euler step minimises it (paper, eq. 11).

    Build it with :meth:`for_scene`; a term that the scene does not ask for is not in it. ``reasons`` says for each term
    why it is there.
    """

    def __init__(self, terms: Sequence[EnergyTerm], reasons: dict[str, str] | None = None):
        super().__init__()
        self.terms = cast(Sequence[EnergyTerm], nn.ModuleList(terms))  # of any modules, as far as types say
        self.reasons = reasons or {}
        self._stencils = {rough: StencilSum() for rough in (True, False)}

    @classmethod
    def for_scene(
        cls, scene: Scene, fabric: Sequence[EnergyTerm], contact: Contact | None = None
    ) -> IncrementalPotential:
        """The terms that ``scene`` requires, with those of its ``fabric`` and this ``contact`` or its defaults."""
        contact = contact or SurfaceContact()
        touching = None if scene.obstacle is None else contact.enlarged(scene.enlarged)
        pulled, pushed = bool(np.any(scene.gravity)), scene.external_force is not None
        terms = terms_of(fabric, touching, scene.friction, gravity=pulled, external=pushed)
        beside = contact.beside(scene)
        reasons = {term.name: _reason(term, scene) for term in terms} | {term.name: reason for term, reason in beside}
        return cls([*terms, *(term for term, _ in beside)], reasons)

    def with_laws_in(self, dtype: torch.dtype) -> IncrementalPotential:
        """Itself, with the laws of its fabric evaluated in this precision."""
        for term in self.terms:
            if term.law is not None:
                term.law.to(dtype)
        return self

    @property
    def contact(self) -> Contact | None:
        """The contact term, where the scene has a body."""
        return next((term for term in self.terms if isinstance(term, Contact)), None)

    @property
    def barrier(self) -> Barrier | None:
        """The term that lets nothing cross, where there is one."""
        return next((term for term in self.terms if isinstance(term, Barrier)), None)

    @property
    def names(self) -> list[str]:
        """The names of the terms."""
        return [term.name for term in self.terms]

    def forward(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Float[Tensor, " meshes"]:
        """Energy of each cloth [J], differentiable in ``x_next``."""
        return torch.stack([term(x_next, step) for term in self.terms]).sum(0)

    def evaluate(self, x_next: Float[Tensor, "vertices 3"], step: Step) -> Evaluation:
        """Energy, gradient and the energy of each term; no graph."""
        made = step.once((self, "kernels"), lambda: [(t, t.kernel(step), t.relative_rounding) for t in self.terms])
        x, summed, rounding = array(x_next), np.zeros(x_next.shape), 0.0
        energies: dict[str, float] = {}
        total: Tensor | None = None
        for term, kernel, relative in made:
            if kernel is not None:
                energies[term.name], slope = kernel(x)
                summed += slope
            else:
                energy, gradient = term.energy_and_gradient(x_next, step)
                energies[term.name] = float(energy.sum())
                total = gradient if total is None else total + gradient
            rounding += relative * abs(energies[term.name])
        known = torch.from_numpy(summed).to(x_next)
        gradient = known if total is None else known + total
        stored = float(sum(energies[term.name] for term in self.terms if term.stores))
        return Evaluation(float(sum(energies.values())), gradient, energies, stored, rounding)

    def hessian(self, x_next: Float[Tensor, "vertices 3"], step: Step, *, rough: bool = False) -> sparse.csr_array:
        """A positive definite approximation of the Hessian, ``3 vertices`` square; ``rough``: sparser if possible.

        Only the upper triangle is there.
        """
        pieces: list[Stencils | Filled] = []
        others: list[sparse.csr_array] = []
        for term in self.terms:
            better, loose = None if rough else term.hessian(x_next, step), term.loose_hessian(x_next, step)
            if better is None:
                pieces += term.stencils(x_next, step)
            others += [part for part in (better, loose) if part is not None]
        return sum(others, start=self._stencils[rough].upper(pieces, len(x_next)))


def _reason(term: EnergyTerm, scene: Scene) -> str:
    """Reason for which ``scene`` requires a term."""
    match term:
        case Inertia():
            return "the cloth has mass"
        case Gravity():
            return f"gravity is {np.linalg.norm(scene.gravity):.4g} m/s²"
        case ExternalForce() if scene.external_force is not None:
            return f"a constant force of {np.linalg.norm(scene.external_force.sum(0)):.4g} N in all"
        case Contact() if scene.obstacle is not None:
            sharp = term.sharp_points(scene)
            asked = "" if sharp is None else f", {len(sharp)} sharp points of it, for which the cloth is too coarse"
            return f"a body of {len(scene.obstacle.faces)} faces{asked}"
        case Friction():
            return f"the coefficient of friction is {scene.friction:.4g}"
    return f"the fabric is {scene.material.name}"
