"""A training step as one CUDA graph: launched at once instead of operator by operator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import torch
from torch import Tensor, nn

from drape.data.windows import Window

WARM_UPS = 3
"""Evaluations before the capture, in which libraries choose their kernels and meshes compute what stays."""
Losses = Callable[[Window], dict[str, Tensor]]
"""Terms by name, and their weighted sum ``total``."""


class CapturedStep:
    """The losses of a window and their slopes in the parameters, replayed for other windows of the same mesh.

    Between them the GPU waits for nobody: a step of thousands of small operators is limited by their launches, which
    a graph makes one. The operators and the random numbers are those of the step without a graph.

    Args:
        losses: what is captured; it must not ask the GPU for a number, nor make an array of a size that the numbers
            in it decide.
        parameters: get their slopes.
        window: on the GPU; any of those that will be replayed.
    """

    def __init__(self, losses: Losses, parameters: Sequence[nn.Parameter], window: Window):
        self._losses, self._parameters = losses, list(parameters)
        own: dict[str, Any] = {name: value.clone() for name, value in _numbers(window).items()}
        self._window = replace(window, **own)
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(WARM_UPS):
                self._evaluate()
        torch.cuda.current_stream().wait_stream(aside)
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph):
            self._values, self._slopes = self._evaluate()

    def fits(self, window: Window) -> bool:
        """Whether this is a window of the mesh and the time step that was captured."""
        return window.mesh is self._window.mesh and window.dt == self._window.dt

    def replay(self, window: Window) -> dict[str, Tensor]:
        """The losses of ``window``; their slopes become the ``grad`` of the parameters. Both change with the next."""
        for name, value in _numbers(self._window).items():
            value.copy_(getattr(window, name))
        self._graph.replay()
        for parameter, slope in zip(self._parameters, self._slopes, strict=True):
            parameter.grad = slope
        return self._values

    def _evaluate(self) -> tuple[dict[str, Tensor], tuple[Tensor | None, ...]]:
        values = self._losses(self._window)
        slopes = torch.autograd.grad(values["total"], self._parameters, allow_unused=True)
        # fused optimisers want slopes that lie in memory as the parameters do
        slopes = tuple(slope if slope is None else slope.contiguous() for slope in slopes)
        return {name: value.detach() for name, value in values.items()}, slopes


def _numbers(window: Window) -> dict[str, Tensor]:
    """The arrays of a window, by name; its mesh and its time step stay."""
    named = {field.name: getattr(window, field.name) for field in fields(window)}
    return {name: value for name, value in named.items() if isinstance(value, Tensor)}
