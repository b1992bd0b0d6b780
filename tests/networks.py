"""Small graph networks for tests."""

from __future__ import annotations

from functools import partial

import torch

from drape.nets.mesh_graph_net import MeshGraphNet, flat_schedule, hood_schedule
from drape.simulators.neural.graph_acceleration import GraphAcceleration

SCHEDULES = {"mgn": (flat_schedule(3), 0), "mgn_h": (hood_schedule(1), 2)}
NUMBERS = {"speed": 2.0, "acceleration": 7.0, "edge_length": 0.1, "mass": 0.2}
NUMBERS |= {"reach": 0.04, "thickness": 0.02}


def untrained(kind: str = "mgn", **changes: float) -> GraphAcceleration:
    """As a training begins."""
    schedule, levels = SCHEDULES[kind]
    torch.manual_seed(3)
    net = partial(MeshGraphNet, width=16, schedule=schedule)
    return GraphAcceleration(net, attributes=5, **(NUMBERS | {"coarse_levels": levels} | changes))


def make_network(kind: str = "mgn", **changes: float) -> GraphAcceleration:
    """With random weights in the last layers, so that predictions are of the size of the scale, 7 m/s²."""
    network = untrained(kind, **changes)
    for decoder in (network.net.decoder, *network.net.edge_decoders.values()):
        torch.nn.init.normal_(decoder[-1].weight)
    return network
