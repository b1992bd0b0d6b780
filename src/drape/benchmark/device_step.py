"""A training step on a GPU, operator by operator and as one graph: time, launches, synchronisations."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping

import torch
from torch import Tensor
from torch.profiler import ProfilerActivity, profile

from drape.benchmark.calls import driver_calls
from drape.benchmark.measured import Row
from drape.data.windows import Window
from drape.energy.law.eunet import EUNet
from drape.loss.term import LossTerm, loss_values
from drape.training.captured_step import CapturedStep

WARM_UP = 5
"""Steps that are not counted."""


class DeviceStep:
    """Phases of a step [ms], the GPU waited for after each; steps a second without waiting; calls to the driver.

    Each twice: ``eager``, operator by operator, and ``captured``, forward and backward as one graph, which takes no
    time apart from the replay. Steps are those of the training without Lightning around them.
    """

    def __init__(self, energy: EUNet, loss: Mapping[str, LossTerm], windows: Iterator[Window], device: torch.device):
        self.energy, self.loss = energy.to(device), {name: term.to(device) for name, term in loss.items()}
        self.windows, self.device = windows, device
        self.parameters = list(self.energy.parameters())
        self.optimizer = torch.optim.Adam(self.parameters, lr=1e-6, fused=True)
        self.captured = CapturedStep(self._losses, self.parameters, self._window())

    def measure(self, repeats: int) -> list[Row]:
        """A row for each phase and count, its values eager and captured."""
        columns = {}
        for name, slopes in {"eager": self._eager, "captured": self.captured.replay}.items():
            rows = [self._phases(slopes) for _ in range(WARM_UP + repeats)][WARM_UP:]
            values = {f"{phase} [ms]": statistics.median(row[phase] for row in rows) for phase in rows[0]}
            began = time.perf_counter()
            for _ in range(repeats):
                self._step(slopes)
            torch.cuda.synchronize()
            values["steps a second"] = repeats / (time.perf_counter() - began)
            columns[name] = values | self._counts(slopes)
        return [
            {"what": what, "eager": columns["eager"][what], "captured": columns["captured"][what]}
            for what in columns["eager"]
        ]

    def _window(self) -> Window:
        return next(self.windows).to(self.device)

    def _losses(self, window: Window) -> dict[str, Tensor]:
        return loss_values(self.energy, self.loss, window)

    def _eager(self, window: Window) -> None:
        self.optimizer.zero_grad()
        self._losses(window)["total"].backward()

    def _step(self, slopes: Callable[[Window], object]) -> None:
        slopes(self._window())
        self.optimizer.step()

    def _phases(self, slopes: Callable[[Window], object]) -> dict[str, float]:
        marks = [_now()]
        window = self._window()
        marks.append(_now())
        slopes(window)
        marks.append(_now())
        self.optimizer.step()
        marks.append(_now())
        names = ("data", "forward and backward", "optimizer")
        phases = {name: 1e3 * (end - start) for name, start, end in zip(names, marks[:-1], marks[1:], strict=True)}
        return phases | {"step": sum(phases.values())}

    def _counts(self, slopes: Callable[[Window], object]) -> dict[str, int]:
        """Calls to the driver in one step; the one that ends the profile is not counted."""
        with profile(activities=[ProfilerActivity.CPU, ProfilerActivity.CUDA]) as profiled:
            self._step(slopes)
        return driver_calls(profiled)


def _now() -> float:
    torch.cuda.synchronize()
    return time.perf_counter()
