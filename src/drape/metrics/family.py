"""All metrics of a learned energy, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from torchmetrics import Metric, MetricCollection

from drape.energy.spring_hinge import SpringHingeLaw
from drape.metrics.contrastive import ContrastiveViolations, VertexInequalities
from drape.metrics.energy_error import EnergyError
from drape.metrics.force import ForceResidual, InertialForce, SpringHingeResidual
from drape.metrics.rest_state import RestState
from drape.metrics.stiffness import StretchStiffness


def energy_metrics(
    fabrics: Sequence[str],
    *,
    contrastive: VertexInequalities | None = None,
    tension: Mapping[str, float] | None = None,
    law: SpringHingeLaw | None = None,
) -> MetricCollection:
    """The metrics of an energy; ``compute()`` gives one flat dictionary ``quantity_unit/fabric`` -> number.

    Always: ``energy_error``, ``force_residual``, ``inertial_force`` and ``rest_state``. ``violations`` needs the
    contrastive loss whose inequalities are counted, ``stretch_stiffness`` Blender's tension stiffness of each fabric,
    ``spring_hinge`` the fitted law; what is not given is not measured.
    """
    metrics: dict[str, Metric | MetricCollection] = {
        "energy_error": EnergyError(fabrics),
        "force_residual": ForceResidual(fabrics),
        "inertial_force": InertialForce(fabrics),
        "rest_state": RestState(fabrics),
    }
    if contrastive is not None:
        metrics["violations"] = ContrastiveViolations(fabrics, contrastive)
    if tension is not None:
        metrics["stretch_stiffness"] = StretchStiffness(fabrics, tension)
    if law is not None:
        metrics["spring_hinge"] = SpringHingeResidual(fabrics, law)
    return MetricCollection(metrics, compute_groups=False)
