"""Operations on tensors, waits for their results, and calls to the driver of a GPU, counted by the profiler."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch.profiler import ProfilerActivity, profile

COUNTED = {
    "launches": ("cudaLaunchKernel", "cudaLaunchKernelExC", "cuLaunchKernel", "cuLaunchKernelEx", "cudaGraphLaunch"),
    "copies": ("cudaMemcpyAsync", "cudaMemsetAsync", "cudaMemcpy"),
    "synchronisations": ("cudaStreamSynchronize", "cudaDeviceSynchronize", "cudaEventSynchronize"),
}
"""Counter -> names of calls to the driver."""
VIEWS = {"as_strided", "view", "_reshape_alias", "alias", "detach", "unfold", "empty", "empty_strided", "resolve_conj"}
"""Operations that compute nothing."""
WAITS = {"_local_scalar_dense", "nonzero", "masked_select", "_unique2", "unique_dim", "unique_consecutive"}
"""Operations whose result, or its size, the program has to know before it goes on: a GPU is waited for."""


def calls(run: Callable[[], object]) -> dict[str, int]:
    """Of one ``run``: ``operations`` that compute something, ``waits``; where there is a GPU :func:`driver_calls`."""
    on_gpu = torch.cuda.is_available()
    with profile(activities=[ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if on_gpu else [])]) as profiled:
        run()
    events = [event for event in profiled.events() if event.name.startswith("aten::")]
    last = [event for event in events if not any(e.name.startswith("aten::") for e in event.cpu_children)]
    counts = {
        "operations": sum(event.name[6:] not in VIEWS for event in last),
        "waits": sum(event.name[6:] in WAITS for event in events),
    }
    return counts | (driver_calls(profiled) if on_gpu else {})


def driver_calls(profiled: profile) -> dict[str, int]:
    """The :data:`COUNTED`, and ``kernels``; the synchronisation that ends the profile is not counted."""
    made = {event.key: event.count for event in profiled.key_averages()}
    counts = {what: sum(made.get(name, 0) for name in names) for what, names in COUNTED.items()}
    kernels = sum(event.device_type == torch.autograd.DeviceType.CUDA for event in profiled.events())
    counts["synchronisations"] = max(counts["synchronisations"] - 1, 0)
    return counts | {"kernels": kernels}
