"""LayersNet (Shao et al. 2023) for one layer of cloth: patches, a body, and how each vertex accelerates."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from drape.energy.step import Step
from drape.errors import DrapeError
from drape.nets.layers_transformer import LayersTransformer
from drape.nets.patch_decoder import PatchDecoder
from drape.simulators.neural.heading import Heading
from drape.simulators.neural.layers_inputs import LayersInputs


class LayersAcceleration(nn.Module):
    """The acceleration of each vertex within a step [m/s²]; 0 at pinned ones.

    All vectors are seen from the garment (:class:`Heading`), positions from its mean, and the prediction is turned
    back, so it turns with the scene about the vertical and does not depend on where the scene is. Published:
    docs/sources.md, LayersNet. Here patches are made from the rest mesh (no UV map) and are told where they are at
    rest; faces of the body, of any mesh, stand for its vertices; gravity, external force and attributes are features,
    not tokens; the body near a vertex is met at the closest point of its surface; scales are constants; there is no
    wind and one layer.

    Args:
        net: makes a :class:`LayersTransformer` from ``(patch_size_in, body_size_in)``.
        attributes: number of attributes of a fabric.
        felt_reach: how near the body must be to be felt by a vertex [m].
        speed: typical speed of a vertex [m/s].
        acceleration: typical acceleration of a vertex [m/s²].
        edge_length: typical length of an edge [m].
        mass: typical mass of a vertex [kg].
        patch_size: side of a patch on the cloth at rest [m].
        patch_reach: how near other patches must be to be heard [m].
        body_reach: how near the centre of a face of the body must be to be heard by a patch [m].
        world_neighbours: how many other patches near in space a patch hears at most.
        body_neighbours: how many faces of the body a patch hears at most.

    Raises:
        DrapeError: numbers out of range.
    """

    asks_device = True
    """For the numbers of its pairs of patches, and of patches and faces."""

    def __init__(
        self,
        net: Callable[..., LayersTransformer],
        *,
        attributes: int,
        felt_reach: float,
        speed: float,
        acceleration: float,
        edge_length: float,
        mass: float,
        patch_size: float = 0.04,
        patch_reach: float = 0.4,
        body_reach: float = 0.6,
        world_neighbours: int = 16,
        body_neighbours: int = 8,
    ):
        super().__init__()
        positive = {
            "felt_reach": felt_reach, "speed": speed, "acceleration": acceleration, "edge_length": edge_length,
            "mass": mass, "patch_size": patch_size, "patch_reach": patch_reach, "body_reach": body_reach,
        }  # fmt: skip
        wrong = [f"{name} {value}" for name, value in positive.items() if not 0 < value < math.inf]
        counts = {"attributes": (attributes, 0), "world_neighbours": (world_neighbours, 1)}
        counts["body_neighbours"] = (body_neighbours, 1)
        wrong += [f"{name} {value} (at least {least})" for name, (value, least) in counts.items() if value < least]
        if wrong:
            raise DrapeError(f"LayersNet: found {', '.join(wrong)}; expected positive finite numbers")
        self.inputs = LayersInputs(
            attributes=attributes, patch_size=patch_size, patch_reach=patch_reach, world_neighbours=world_neighbours,
            body_reach=body_reach, body_neighbours=body_neighbours, felt_reach=felt_reach, speed=speed,
            acceleration=acceleration, edge_length=edge_length, mass=mass,
        )  # fmt: skip
        self.acceleration = acceleration
        self.net = net(self.inputs.size_patch, self.inputs.size_body)
        self.decoder = PatchDecoder(self.inputs.size_relative, self.net.width, self.inputs.size_vertex, self.net.width)

    def forward(self, step: Step) -> Float[Tensor, "vertices 3"]:
        """In world axes and the precision of the step."""
        heading, patches, inputs = Heading(step.x, step.mesh), step.mesh.patches(self.inputs.patch_size), self.inputs
        vertices = inputs.of_vertices(step, heading)
        bodies = inputs.of_bodies(patches, step, heading)
        of_patches = inputs.of_patches(vertices, patches, step, heading)
        embedded = self.net(
            self._cast(of_patches),
            self._cast(bodies.features),
            self._cast(bodies.frames),
            inputs.interactions(patches, bodies, step),
        )
        relative = inputs.of_candidates(patches, step, heading)
        own = [self._cast(part) for part in (vertices, inputs.near_body(step, heading))]
        predicted = self.decoder(self._cast(relative), embedded, torch.cat(own, 1), patches.candidates)
        predicted = heading.outward(self.acceleration * predicted.to(step.x.dtype), step.mesh.mesh_of_vertex)
        return predicted.masked_fill(~step.free[:, None], 0.0)

    def _cast(self, features: Tensor) -> Tensor:
        """In the precision of the parameters."""
        return features.to(self.decoder.last.weight.dtype)
