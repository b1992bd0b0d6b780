"""Garments of the analytic law PHYS: trained on all its materials, animated with the one that a fabric is most like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from drape.data.garment_rollout import GarmentRollout
from drape.energy.phys_material import PhysMaterial
from drape.energy.term import EnergyTerm
from drape.errors import DrapeError
from drape.geometry.fixed_size import is_fixed
from drape.geometry.mesh_batch import MeshBatch
from drape.scene.material import Material
from drape.simulators.neural.cloths import Cloth, Known, forced


class PhysCloths:
    """All garments of a batch of one material, drawn from HOOD's ranges (docs/sources.md), weighed by their areas.

    Args:
        estimates: numbers of :class:`PhysMaterial` by the name of a fabric, as EST has found them; None: HOOD's
            defaults for every fabric.
        force: largest external force on each garment [N/kg]; see :func:`drape.simulators.neural.cloths.forced`.

    Raises:
        DrapeError: estimates that are no material; later, a fabric without an estimate.
    """

    def __init__(self, estimates: Mapping[str, Mapping[str, float]] | None, force: float = 0.0):
        self.force, self._estimates = force, None
        self._drawn: dict[tuple[int, torch.device], Sequence[EnergyTerm]] = {}
        if estimates is not None:
            self._estimates = {name: _material(name, numbers) for name, numbers in estimates.items()}

    def draw(self, rollout: GarmentRollout, materials: Mapping[str, Material], generator: torch.Generator) -> Cloth:
        material, mesh = PhysMaterial.sampled(generator), rollout.mesh
        share = mesh.rest_faces.area / 3.0
        area = share.new_zeros(mesh.num_vertices).index_add(0, mesh.faces.flatten(), share.repeat_interleave(3))
        attributes = material.inputs().to(rollout.x.device).expand(mesh.num_meshes, -1)
        cloth = Cloth(attributes, material.areal_density * area, self._terms(material, mesh))
        return forced(cloth, rollout, self.force, generator)

    def _terms(self, material: PhysMaterial, mesh: MeshBatch) -> Sequence[EnergyTerm]:
        """On a device the same terms in each draw, with other numbers in their arrays: steps are recorded with them."""
        device = mesh.edges.device
        if not is_fixed(device):
            return material.terms()
        drawn = [term.to(device) for term in material.terms(mesh.num_meshes)]
        kept = self._drawn.setdefault((mesh.num_meshes, device), drawn)
        for term, new in zip(kept, drawn, strict=True):
            for buffer, value in zip(term.buffers(), new.buffers(), strict=True):
                buffer.copy_(value)
        return kept

    def of(self, material: Material) -> Known:
        known = self.material(material.name)
        return Known(known.inputs(), known.areal_density)

    def terms(self, material: Material) -> Sequence[EnergyTerm]:
        return self.material(material.name).terms()

    def material(self, fabric: str) -> PhysMaterial:
        """The material that stands for a fabric."""
        if self._estimates is None:
            return PhysMaterial.default()
        if fabric not in self._estimates:
            raise DrapeError(
                f"cloths: found no estimate for {fabric}; expected one of {', '.join(self._estimates)}; estimate it "
                "with python src/train.py model=est, or take model/cloths=phys, HOOD's defaults"
            )
        return self._estimates[fabric]


def _material(fabric: str, numbers: Mapping[str, float]) -> PhysMaterial:
    wrong = set(numbers) ^ set(PhysMaterial._fields)
    if wrong or not all(value > 0 for value in numbers.values()):
        raise DrapeError(
            f"cloths.estimates.{fabric}: found {dict(numbers)}; expected positive numbers for "
            f"{', '.join(PhysMaterial._fields)}"
        )
    return PhysMaterial(**{name: float(value) for name, value in numbers.items()})
