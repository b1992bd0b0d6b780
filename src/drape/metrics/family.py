"""The metrics of a learned energy, as ``conf/metrics/energy.yaml`` lists them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping

from torchmetrics import MetricCollection

from drape.errors import DrapeError
from drape.metrics.fabric_metric import FabricMetric


def energy_metrics(makers: Mapping[str, Callable[..., FabricMetric]], known: Mapping[str, object]) -> MetricCollection:
    """The metrics of an energy; ``compute()`` gives one flat dictionary ``quantity_unit/fabric`` -> number.

    Args:
        makers: by name, what makes a metric of those of ``known`` that it asks for.
        known: of the data: ``fabrics`` (names, in order), ``tension`` (Blender's tension stiffness of each), ``law``
            (a spring-hinge law, fitted).

    Raises:
        DrapeError: a metric asks for something else.
    """
    return MetricCollection({name: _made(name, make, known) for name, make in makers.items()}, compute_groups=False)


def _made(name: str, make: Callable[..., FabricMetric], known: Mapping[str, object]) -> FabricMetric:
    asked = inspect.signature(make).parameters
    open_ones = [key for key, argument in asked.items() if argument.default is argument.empty and key not in known]
    if open_ones:
        raise DrapeError(
            f"conf: metrics.{name}: found no value for {', '.join(open_ones)}; expected one in its option, as the data "
            f"only give {', '.join(known)}"
        )
    return make(**{key: known[key] for key in asked if key in known})
