"""Numbers of a material: one for all cloths of a batch, or one for each."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from drape.energy.step import Step
from drape.errors import DrapeError

PerMesh = float | Float[Tensor, " meshes"]
"""A number for all meshes of a batch, or one for each of them."""


def hold(term: nn.Module, name: str, value: PerMesh) -> None:
    """Make ``value`` the attribute ``name`` of a term; a tensor goes along to other devices and precisions."""
    if isinstance(value, Tensor):
        term.register_buffer(name, value, persistent=False)
    else:
        setattr(term, name, value)


def everywhere(condition: bool | Bool[Tensor, "..."]) -> bool:
    """Whether a condition on such numbers holds for all meshes."""
    return bool(condition.all()) if isinstance(condition, Tensor) else condition


def of_pieces(
    value: PerMesh, step: Step, vertex: Int[Tensor, " pieces"], dtype: torch.dtype
) -> float | Float[Tensor, " pieces"]:
    """The number of the mesh that each piece (face, hinge) belongs to by one ``vertex`` of it; a float stays one.

    Raises:
        DrapeError: another count of numbers than of meshes.
    """
    if not isinstance(value, Tensor):
        return value
    if len(value) != step.mesh.num_meshes:
        raise DrapeError(
            f"material: found {len(value)} numbers for a batch of {step.mesh.num_meshes} meshes; expected one for each "
            "mesh, or a single float"
        )
    return value.to(dtype)[step.mesh.mesh_of_vertex[vertex]]
