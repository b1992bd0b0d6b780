"""Fabrics of the garments of a training step, and the numbers that a network gets of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from drape.data.garment_rollout import GarmentRollout
from drape.energy.fabric import Fabric
from drape.energy.term import EnergyTerm
from drape.scene.material import Material, attribute_vector


class Cloth(NamedTuple):
    """The cloth of a batch of garments."""

    attributes: Float[Tensor, "meshes attributes"]
    """Inputs of the network for each garment's fabric."""
    mass: Float[Tensor, " vertices"]
    """[kg]"""
    terms: Sequence[EnergyTerm]
    """The elastic and dissipated energies of the fabric; all garments of a batch share it. [] where none is needed."""
    external_force: Float[Tensor, "vertices 3"] | None = None
    """[N] in all steps of a rollout, besides gravity."""


class Known(NamedTuple):
    """A fabric as a trained simulator knows it."""

    attributes: Float[Tensor, " attributes"]
    areal_density: float | None
    """[kg/m²] instead of the masses of the scene; None: those."""


@runtime_checkable
class Cloths(Protocol):
    """Source of the cloth of a training step."""

    def draw(self, rollout: GarmentRollout, materials: Mapping[str, Material], generator: torch.Generator) -> Cloth:
        """The cloth of the garments of ``rollout``; ``materials`` are the fabrics of the data, by name."""
        ...

    def of(self, material: Material) -> Known:
        """Inputs of the network for a fabric when it animates."""
        ...

    def terms(self, material: Material) -> Sequence[EnergyTerm]:
        """The energies of a fabric that a simulator is trained with; none where it is shown recorded garments."""
        ...


class RecordedCloths:
    """Each garment of the fabric that it was recorded with: for supervised training. No energies."""

    def __init__(self, attribute_scales: Mapping[str, float]):
        self.attribute_scales = dict(attribute_scales)

    def draw(self, rollout: GarmentRollout, materials: Mapping[str, Material], generator: torch.Generator) -> Cloth:
        return _cloth(rollout, [materials[name] for name in rollout.fabrics], self, [])

    def of(self, material: Material) -> Known:
        return Known(_vector(material, self.attribute_scales), None)

    def terms(self, material: Material) -> Sequence[EnergyTerm]:
        return []


class LearnedCloths:
    """All garments of a batch of the fabric of one of them, with the energies of its learned law, which is not trained.

    Masses are those per vertex that the data have for the fabric.

    Args:
        attribute_scales: divisors of the vector **a** of a fabric.
        energy: makes the energies of a ``material``; called once for each fabric.
        force: largest external force on each garment [N/kg]; see :func:`forced`.
    """

    def __init__(self, attribute_scales: Mapping[str, float], energy: Callable[..., Fabric], force: float = 0.0):
        self.attribute_scales = dict(attribute_scales)
        self._energy, self.force = energy, force
        self._fabrics: dict[str, Fabric] = {}

    def draw(self, rollout: GarmentRollout, materials: Mapping[str, Material], generator: torch.Generator) -> Cloth:
        names = rollout.fabrics
        name = names[int(torch.randint(len(names), (), generator=generator))]
        terms = [term.to(rollout.x.device) for term in self.terms(materials[name])]
        cloth = _cloth(rollout, [materials[name]] * rollout.mesh.num_meshes, self, terms)
        return forced(cloth, rollout, self.force, generator)

    def terms(self, material: Material) -> Sequence[EnergyTerm]:
        if material.name not in self._fabrics:
            self._fabrics[material.name] = self._energy(material=material)
        terms = self._fabrics[material.name].terms
        for term in terms:
            term.requires_grad_(False)
        return terms

    def of(self, material: Material) -> Known:
        return Known(_vector(material, self.attribute_scales), None)


def forced(cloth: Cloth, rollout: GarmentRollout, largest: float, generator: torch.Generator) -> Cloth:
    """The cloth with a constant force on each garment, a direction and up to ``largest`` [N/kg] at random.

    The paper (appendix) draws such forces and does not say which; 0 draws none.
    """
    if largest == 0.0:
        return cloth
    mesh = rollout.mesh
    direction = torch.nn.functional.normalize(torch.randn(mesh.num_meshes, 3, generator=generator), dim=-1)
    per_mass = (largest * torch.rand(mesh.num_meshes, 1, generator=generator) * direction).to(cloth.mass)
    return cloth._replace(external_force=cloth.mass[:, None] * per_mass[mesh.mesh_of_vertex])


def _vector(material: Material, scales: Mapping[str, float]) -> Float[Tensor, " attributes"]:
    return torch.tensor(attribute_vector(material.attributes, scales), dtype=torch.float64)


def _cloth(
    rollout: GarmentRollout, materials: Sequence[Material], cloths: Cloths, terms: Sequence[EnergyTerm]
) -> Cloth:
    device = rollout.x.device
    mass = torch.tensor([each.mass_per_vertex for each in materials], dtype=torch.float64, device=device)
    attributes = torch.stack([cloths.of(each).attributes for each in materials]).to(device)
    return Cloth(attributes, mass[rollout.mesh.mesh_of_vertex], terms)
