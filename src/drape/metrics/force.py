"""Force residual of an energy, compared with no energy at all and with a spring-hinge law."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from drape.energy.law.spring_hinge import SpringHingeLaw
from drape.energy.law.step_energies import StepEnergies
from drape.metrics.fabric_metric import FabricMetric


class MeanForce(FabricMetric):
    """Mean over free vertices and frames of the size of a force [N]."""

    key: str
    count: Tensor
    total: Tensor

    def __init__(self, fabrics: Sequence[str]):
        super().__init__(fabrics)
        self.add_sum("count")
        self.add_sum("total")

    @abstractmethod
    def force(self, step: StepEnergies) -> Float[Tensor, "vertices 3"]:
        """The force on each vertex [N]; pinned vertices do not matter."""

    def update(self, step: StepEnergies) -> None:
        window = step.window
        size = self.force(step).detach().norm(dim=-1) * window.free
        self.count += self.per_fabric(window, window.mesh.sum_vertices(window.free.double()))
        self.total += self.per_fabric(window, window.mesh.sum_vertices(size))

    def compute(self) -> dict[str, float]:
        return self.means(self.key, self.total, self.count)


class ForceResidual(MeanForce):
    """``|m a - m g + ∂Φ/∂x|`` [N]: what the energy leaves unexplained of the equation of motion (paper, eq. 9)."""

    key = "force_residual_N"

    def force(self, step: StepEnergies) -> Float[Tensor, "vertices 3"]:
        return step.force_residual


class InertialForce(MeanForce):
    """``|m a - m g|`` [N]: the force residual of predicting no internal force, the row "nothing"."""

    key = "inertial_force_N"

    def force(self, step: StepEnergies) -> Float[Tensor, "vertices 3"]:
        return step.window.inertial_force


class SpringHingeResidual(MeanForce):
    """The force residual [N] of a spring-hinge law fitted on the same training data: the bar for a learned law."""

    key = "spring_hinge_residual_N"

    def __init__(self, fabrics: Sequence[str], law: SpringHingeLaw):
        super().__init__(fabrics)
        self.law = law

    def force(self, step: StepEnergies) -> Float[Tensor, "vertices 3"]:
        return self.law.force_residual(step.window)
