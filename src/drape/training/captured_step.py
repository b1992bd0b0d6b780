"""A training step as one CUDA graph: launched at once instead of operator by operator."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn

from drape.geometry.mesh_batch import MeshBatch
from drape.geometry.surface_points import SurfacePoints

WARM_UPS = 3
"""Evaluations before the capture, in which libraries choose their kernels and meshes compute what stays."""
CHECKED_EVERY = 10
"""Steps between two looks at the losses on a GPU, which has to wait for them; checkpoints are written after one."""
MOST = 64
"""Graphs that are kept; what fits none of them goes operator by operator from then on."""
Inputs = TypeVar("Inputs")
"""A dataclass of arrays, numbers and meshes, and of such."""


class CapturedStep(Generic[Inputs]):
    """The losses of a step and their slopes in the parameters, replayed for other inputs of the same :func:`kind`.

    Between them the GPU waits for nobody: a step of thousands of small operators is limited by their launches, which
    a graph makes one. The operators and the random numbers are those of the step without a graph.

    Args:
        losses: what is captured, whose ``total`` has slopes; it must not ask the GPU for a number, nor make an array
            of a size that the numbers in it decide.
        parameters: get their slopes.
        inputs: on the GPU; any of those that will be replayed.
        pool: memory that is shared with graphs that never run at the same time.
    """

    def __init__(
        self,
        losses: Callable[[Inputs], dict[str, Tensor]],
        parameters: Sequence[nn.Parameter],
        inputs: Inputs,
        pool: Any = None,
    ):
        self._losses, self._parameters = losses, list(parameters)
        self._inputs = _changed(inputs, Tensor.clone)
        self._arrays, self._kind = arrays(self._inputs), kind(self._inputs)
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(WARM_UPS):
                self._evaluate()
        torch.cuda.current_stream().wait_stream(aside)
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph, pool=pool):
            self._values, self._slopes = self._evaluate()

    def fits(self, inputs: Inputs) -> bool:
        """Whether these are inputs of the kind that was captured."""
        return kind(inputs) == self._kind

    def replay(self, inputs: Inputs) -> dict[str, Tensor]:
        """The losses of ``inputs``; their slopes become the ``grad`` of the parameters. Both change with the next."""
        torch._foreach_copy_(self._arrays, arrays(inputs))
        self._graph.replay()
        for parameter, slope in zip(self._parameters, self._slopes, strict=True):
            parameter.grad = slope
        return self._values

    def _evaluate(self) -> tuple[dict[str, Tensor], tuple[Tensor | None, ...]]:
        values = self._losses(self._inputs)
        slopes = torch.autograd.grad(values["total"], self._parameters, allow_unused=True)
        # fused optimisers want slopes that lie in memory as the parameters do
        slopes = tuple(slope if slope is None else slope.contiguous() for slope in slopes)
        return {name: value.detach() for name, value in values.items()}, slopes


class CapturedSteps(Generic[Inputs]):
    """A :class:`CapturedStep` for each kind of inputs, made when the first of them come; ``MOST`` at most."""

    def __init__(self, losses: Callable[[Inputs], dict[str, Tensor]], parameters: Sequence[nn.Parameter]):
        self._losses, self._parameters = losses, list(parameters)
        self._made: dict[Hashable, CapturedStep[Inputs]] = {}
        self._pool: Any = None

    def of(self, inputs: Inputs) -> CapturedStep[Inputs] | None:
        """The step that fits; None where it would be one too many."""
        key = kind(inputs)
        if key not in self._made and len(self._made) < MOST:
            self._pool = self._pool or torch.cuda.graph_pool_handle()
            self._made[key] = CapturedStep(self._losses, self._parameters, inputs, self._pool)
        return self._made.get(key)


def arrays(inputs: object) -> list[Tensor]:
    """All that changes from step to step, in a fixed order."""
    return [leaf for leaf in _leaves(inputs) if isinstance(leaf, Tensor)]


def kind(inputs: object) -> Hashable:
    """All that stays: sizes of arrays, numbers, and which meshes and modules they are."""
    return tuple(_standing(leaf) for leaf in _leaves(inputs))


def _standing(leaf: object) -> Hashable:
    if isinstance(leaf, Tensor):
        return leaf.shape, leaf.dtype, leaf.device
    return leaf if leaf is None or isinstance(leaf, float | int | str) else id(leaf)


def _parts(value: object) -> dict[str, Any] | None:
    """The fields of a dataclass; meshes stay as they are."""
    if isinstance(value, MeshBatch | SurfacePoints) or not is_dataclass(value):
        return None
    return {field.name: getattr(value, field.name) for field in fields(value)}


def _leaves(value: object) -> list[object]:
    parts = _parts(value)
    if parts is None and not isinstance(value, tuple | list):
        return [value]
    return [leaf for part in (value if parts is None else parts.values()) for leaf in _leaves(part)]  # type: ignore


def _changed(value: Any, change: Callable[[Tensor], Tensor]) -> Any:
    """The same with all arrays changed."""
    if isinstance(value, Tensor):
        return change(value)
    parts = _parts(value)
    if parts is not None:
        return replace(value, **{name: _changed(part, change) for name, part in parts.items()})
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(_changed(part, change) for part in value))
    return value
