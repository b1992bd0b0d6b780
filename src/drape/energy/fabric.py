"""The energies of a fabric: what a scene's cloth is made of, by a learned law, a table of it, or an analytic one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.datamodule import TrajectoryDataModule
from drape.energy.law.baked.hinges import BakedHinges
from drape.energy.law.deformation import Deformation, Stretch
from drape.energy.law.edge_law import EdgeLaw, StretchOnly
from drape.energy.law.hinge_law import HingeLaw, WithoutHinges
from drape.energy.law.load_law import load_baked, load_law
from drape.energy.law.scaled_law import at_density
from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.term import EnergyTerm
from drape.energy.terms.bending import Bending
from drape.energy.terms.dissipation import Dissipation
from drape.energy.terms.elastic import ElasticEnergy
from drape.energy.terms.hinge_elastic import Damping, HingeElastic
from drape.energy.terms.stvk import StVK
from drape.scene.material import ATTRIBUTES, Material


class Fabric(NamedTuple):
    """Energy terms of a cloth and the attributes that they read."""

    terms: Sequence[EnergyTerm]
    attributes: Float[Tensor, " attributes"]
    """The scaled vector **a**."""


def eunet(
    checkpoint: str,
    transfer: bool,
    material: Material,
    areal_density: float | None = None,
    deformation: Deformation | None = None,
) -> Fabric:
    """The learned law of a checkpoint of ``train.py``; see :class:`ElasticEnergy` for ``transfer``.

    ``areal_density``: of the cloth that it is used for [kg/m²], see :func:`at_density`. ``deformation``: what its edges
    may feel; None for all that they have learned to.

    Raises:
        DrapeError: no such checkpoint, or one that was not trained on this fabric.
    """
    law, attributes = load_law(checkpoint, material)
    return Fabric(_terms(at_density(law, material, areal_density), transfer, deformation), attributes)


def eunet_baked(
    table: str,
    transfer: bool,
    material: Material,
    areal_density: float | None = None,
    deformation: Deformation | None = None,
) -> Fabric:
    """The learned law as a table of splines, made by ``bake.py``; ``{fabric}`` in its name stands for the fabric's.

    ``areal_density`` and ``deformation`` as in :func:`eunet`.

    Raises:
        DrapeError: no such table, or that of another fabric.
    """
    law, attributes = load_baked(table.replace("{fabric}", material.name), material)
    return Fabric(_terms(at_density(law, material, areal_density), transfer, deformation), attributes)


def phys(shear_modulus: float, first_lame: float, thickness: float, bending_stiffness: float) -> Fabric:
    """PHYS, the analytic law of the self-supervised baselines: a StVK membrane and dihedral bending."""
    terms = [StVK(shear_modulus, first_lame, thickness), Bending(bending_stiffness)]
    return Fabric(terms, torch.zeros(len(ATTRIBUTES), dtype=torch.float64))


def spring_hinge(
    path: str,
    windows: int,
    instruments: Sequence[int],
    transfer: bool,
    material: Material,
    areal_density: float | None = None,
) -> Fabric:
    """The spring-hinge law fitted on ``windows`` triplets of frames of the data file at ``path``, all of one fabric.

    ``instruments``: frames from a window to the others that it is fitted with; see :meth:`SpringHingeLaw.fit`,
    :class:`HingeElastic` for ``transfer``, :func:`at_density` for ``areal_density``.

    Raises:
        DrapeError: no such file, or one without this fabric.
    """
    data = TrajectoryDataModule(path, [material.name], 1, 50, dict.fromkeys(ATTRIBUTES, 1.0), seed=None)
    fitted = SpringHingeLaw.fit(data.windows_apart(windows, 50, instruments), len(data.file.fabrics))
    law = fitted.of_fabric(data.file.fabrics.index(material.name), material, data.face_area, float(data.file.dt))
    return Fabric(_terms(at_density(law, material, areal_density), transfer, None), law.attributes)


def of_law(law: BakedHinges) -> Fabric:
    """The energies of a table that is there already, for cloths of any resolution."""
    return Fabric(_terms(law, True, None), law.attributes)


def _terms(law: EdgeLaw | HingeLaw, transfer: bool, deformation: Deformation | None) -> list[EnergyTerm]:
    stretch_only = deformation is not None and deformation.size == Stretch.size
    if isinstance(law, HingeLaw):
        law = WithoutHinges(law) if stretch_only else law
        damped = [Damping(law, transfer=transfer)] if law.damper or law.drag else []
        return [HingeElastic(law, transfer=transfer), *damped]
    if stretch_only:
        law = StretchOnly(law)
    return [ElasticEnergy(law, transfer=transfer), *([Dissipation(law)] if law.dissipates else [])]
