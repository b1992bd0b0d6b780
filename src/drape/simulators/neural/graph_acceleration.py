"""A graph network that predicts how cloth accelerates: MGN on the mesh alone, MGN-H with coarse levels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.errors import DrapeError
from drape.geometry.fixed_size import counted
from drape.nets.mesh_graph_net import MeshGraphNet
from drape.simulators.neural.graph_inputs import GraphInputs
from drape.simulators.neural.heading import Heading


class GraphAcceleration(nn.Module):
    """The acceleration of each vertex within a step [m/s²]; 0 at pinned ones.

    All vectors are seen from the garment (:class:`Heading`) and the prediction is turned back, so it turns with the
    scene about the vertical and does not depend on where the scene is. Published: MGN and HOOD (docs/sources.md); here
    the body is met at the closest point of its surface instead of at its nearest vertex, gravity and external force
    are one feature of the nodes, and the scales are constants instead of running statistics. To the accelerations of
    the nodes come those along what they touch, ours: a number from each edge of the mesh along itself, opposite at its
    ends, and one from the body along its normal. So a network need not learn directions: strain and contact become
    functions of one number.

    Args:
        net: makes a :class:`MeshGraphNet` from ``(size_node, sizes_edge, size_out)`` and ``answers``.
        attributes: number of attributes of a fabric.
        coarse_levels: of HOOD's hierarchy, which the schedule of ``net`` must use; 0 for MGN.
        thickness: distance from the body at which contact begins [m].
        speed: typical speed of a vertex [m/s].
        acceleration: typical acceleration of a vertex [m/s²].
        edge_length: typical length of an edge [m].
        mass: typical mass of a vertex [kg].
        reach: how near the body must be to be felt [m].

    Raises:
        DrapeError: numbers out of range, or a schedule that does not fit the coarse levels.
    """

    def __init__(
        self,
        net: Callable[..., MeshGraphNet],
        *,
        attributes: int,
        coarse_levels: int,
        thickness: float,
        speed: float,
        acceleration: float,
        edge_length: float,
        mass: float,
        reach: float = 0.03,
    ):
        super().__init__()
        positive = {"thickness": thickness, "speed": speed, "acceleration": acceleration}
        positive |= {"edge_length": edge_length, "mass": mass, "reach": reach}
        if not all(0 < value < math.inf for value in positive.values()):
            raise DrapeError(
                f"graph network: {', '.join(f'{name} {value}' for name, value in positive.items())}; expected positive "
                "finite numbers"
            )
        if coarse_levels < 0 or attributes < 0:
            raise DrapeError(
                f"graph network: coarse_levels {coarse_levels}, attributes {attributes}; expected 0 or more of each"
            )
        self.inputs = GraphInputs(
            attributes, coarse_levels, reach, thickness, speed, acceleration, edge_length, mass
        )
        self.acceleration = acceleration
        self.net = net(self.inputs.size_node, self.inputs.sizes_edge, 3, answers=("mesh", "body"))
        # An untrained network lets the cloth fly straight on, so the first steps of a self-supervised training start
        # near a plausible state and not from an exploded one.
        with torch.no_grad():
            for decoder in (self.net.decoder, *self.net.edge_decoders.values()):
                *_, weight, bias = decoder.parameters()
                weight.mul_(0.01)
                bias.zero_()

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        """In world axes and the precision of the step."""
        heading = Heading(step.x, step.mesh)
        nodes, edges, points = self.inputs.of(step, heading)
        precision = next(self.net.decoder.parameters()).dtype
        edges = {name: replace(edge_set, features=edge_set.features.to(precision)) for name, edge_set in edges.items()}
        predicted, answers = self.net(nodes.to(precision), edges)
        predicted = predicted[: step.mesh.num_vertices].to(step.x.dtype)
        predicted = heading.outward(predicted, step.mesh.mesh_of_vertex)
        predicted = predicted + _along_edges(answers["mesh"].to(step.x.dtype), step)
        if points is not None and "body" in answers:
            pushed = counted(answers["body"].to(step.x.dtype)[:, None] * points.normal, points.there)
            predicted = predicted.index_add(0, points.vertices, pushed)
        return (self.acceleration * predicted).masked_fill(~step.free[:, None], 0.0)


def _along_edges(answers: Float[Tensor, " directed_edges"], step: Step) -> Float[Tensor, "vertices 3"]:
    """The mean of the two answers of each edge, along the edge as it would be at t + dt without forces."""
    first, second = step.mesh.edges.unbind(-1)
    there, back = answers.view(2, -1)
    arm = step.inertial.index_select(0, second) - step.inertial.index_select(0, first)
    pulled = ((there + back) / 2.0)[:, None] * torch.nn.functional.normalize(arm, dim=-1)
    return torch.zeros_like(step.x).index_add(0, first, pulled).index_add(0, second, -pulled)
