"""Graph networks: the formula, graphs without some edges, and how far messages travel."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from drape.errors import DrapeError
from drape.nets import mesh_graph_net
from drape.nets.mesh_graph_net import EdgeSet, MeshGraphNet, flat_schedule, hood_schedule

SIZES = {"mesh": 5, "body": 4}


class OfNodes(MeshGraphNet):
    """Only what is predicted for nodes."""

    def forward(self, nodes: Tensor, edges: dict[str, EdgeSet]) -> Tensor:
        return super().forward(nodes, edges)[0]


def make_net(schedule: list[list[str]], sizes: dict[str, int] = SIZES, width: int = 8) -> OfNodes:
    return OfNodes(3, sizes, 2, width=width, schedule=schedule).double()


def random_edges(nodes: int, edges: int, size: int, level: bool = False) -> EdgeSet:
    senders, receivers = torch.randint(0, nodes, (2, edges))
    features = torch.randn(edges, size, dtype=torch.float64)
    return EdgeSet(senders, receivers, features, torch.randint(0, 3, (edges,)) if level else None)


def make_graph(nodes: int = 10) -> tuple[Tensor, dict[str, EdgeSet]]:
    edges = {"mesh": random_edges(nodes, 24, 5), "body": random_edges(nodes, 7, 4, level=True)}
    return torch.randn(nodes, 3, dtype=torch.float64), edges


def feed_forward(first: nn.Linear, others: nn.Sequential, *parts: Tensor) -> Tensor:
    return others(first(torch.cat(parts, -1)))


def by_hand(net: MeshGraphNet, nodes: Tensor, edges: dict[str, EdgeSet]) -> Tensor:
    """One step on (mesh, body), edge by edge."""
    (step,) = net.steps
    h = net.node_encoder(nodes)
    sums = {name: torch.zeros_like(h) for name in SIZES}
    for name, edge_set in edges.items():
        e = net.edge_encoders[name](edge_set.features)
        message = step.messages[name]
        for k, (i, j) in enumerate(zip(edge_set.senders, edge_set.receivers, strict=True)):
            sums[name][j] += feed_forward(message.first, message.others, h[j], h[i], e[k])
    h = h + feed_forward(step.first, step.others, h, sums["mesh"], sums["body"])
    return net.decoder(h)


def test_one_step_by_hand():
    net = make_net(flat_schedule(1))
    nodes, edges = make_graph()
    torch.testing.assert_close(net(nodes, edges), by_hand(net, nodes, edges))


def test_edges_remember_their_messages():
    """In the second step the message of an edge depends on that of the first."""
    net = make_net(flat_schedule(2))
    nodes, edges = make_graph()
    first, second = net.steps
    h = net.node_encoder(nodes)
    latent = {
        name: EdgeSet(e.senders, e.receivers, net.edge_encoders[name](e.features), e.level) for name, e in edges.items()
    }
    e = latent["mesh"]
    expected = e.features + feed_forward(
        first.messages["mesh"].first, first.messages["mesh"].others, h[e.receivers], h[e.senders], e.features
    )
    h, latent = first(h, latent, {})
    torch.testing.assert_close(latent["mesh"].features, expected)
    h, _ = second(h, latent, {})
    torch.testing.assert_close(net(nodes, edges), net.decoder(h))


def test_edges_answer_with_what_they_remember():
    """One number for each edge of the sets asked, in their order, from its features after the last step."""
    net = MeshGraphNet(3, SIZES, 2, width=8, schedule=flat_schedule(1), answers=["body"]).double()
    nodes, edges = make_graph()
    predicted, answers = net(nodes, edges)
    latent = {n: EdgeSet(e.senders, e.receivers, net.edge_encoders[n](e.features), e.level) for n, e in edges.items()}
    _, after = net.steps[0](net.node_encoder(nodes), latent, {})
    torch.testing.assert_close(predicted, by_hand(net, nodes, edges))
    assert list(answers) == ["body"]
    torch.testing.assert_close(answers["body"], net.edge_decoders["body"](after["body"].features)[:, 0])
    assert net(nodes, {"mesh": edges["mesh"]})[1] == {}


def test_published_size():
    """About 3.85 M parameters (docs/sources.md): 22 features of nodes, 11 of edges in the mesh, 8 from the body."""
    net = MeshGraphNet(22, {"mesh": 11, "body": 8}, 3, width=128, schedule=flat_schedule(15))
    assert sum(p.numel() for p in net.parameters()) == pytest.approx(3.85e6, rel=2e-3)
    assert len(hood_schedule()) == 15


def test_messages_in_blocks_are_those_of_all_at_once(monkeypatch):
    """Without a graph, as in an animation: 24 and 7 edges in blocks of 5."""
    net = make_net(flat_schedule(2))
    nodes, edges = make_graph()
    whole = net(nodes, edges).detach()
    monkeypatch.setattr(mesh_graph_net, "BLOCK", 5)
    with torch.no_grad():
        torch.testing.assert_close(net(nodes, edges), whole)


def test_nothing_depends_on_the_order_of_nodes_and_edges():
    net = make_net([["mesh", "body"], ["mesh", "body@1"]])
    nodes, edges = make_graph()
    order = torch.randperm(len(nodes))
    place = order.argsort()
    shuffled = {}
    for name, e in edges.items():
        rows = torch.randperm(len(e))
        level = None if e.level is None else e.level[rows]
        shuffled[name] = EdgeSet(place[e.senders[rows]], place[e.receivers[rows]], e.features[rows], level)
    torch.testing.assert_close(net(nodes[order], shuffled), net(nodes, edges)[order])


def test_sets_without_edges_are_sets_that_are_not_there():
    net = make_net(flat_schedule(2))
    nodes, edges = make_graph()
    empty = random_edges(len(nodes), 0, 4)
    without = net(nodes, {"mesh": edges["mesh"]})
    torch.testing.assert_close(net(nodes, edges | {"body": empty}), without)
    assert (net(nodes, edges) - without).abs().max() > 1e-3
    assert torch.isfinite(net(nodes, {})).all()
    torch.testing.assert_close(without, _with_zero_sums(net, nodes, edges["mesh"]))


def _with_zero_sums(net: MeshGraphNet, nodes: Tensor, mesh: EdgeSet) -> Tensor:
    """As :func:`by_hand`, two steps, with zeros for what the body would have sent."""
    h, e = net.node_encoder(nodes), net.edge_encoders["mesh"](mesh.features)
    for step in net.steps:
        layers = step.messages["mesh"]
        message = feed_forward(layers.first, layers.others, h[mesh.receivers], h[mesh.senders], e)
        received = torch.zeros_like(h).index_add(0, mesh.receivers, message)
        h, e = h + feed_forward(step.first, step.others, h, received, torch.zeros_like(h)), e + message
    return net.decoder(h)


def test_a_level_takes_the_edges_that_reach_it():
    """``body@2`` on a set with levels is ``body`` on the edges of level 2, and the others keep their features."""
    nodes, edges = make_graph()
    body = edges["body"]
    assert 0 < (body.level >= 2).sum() < len(body)
    net = make_net([["mesh", "body@2"]])
    deep = edges | {"body": body.take((body.level >= 2).nonzero()[:, 0])}
    torch.testing.assert_close(net(nodes, edges), by_hand(net, nodes, deep))
    latent = EdgeSet(body.senders, body.receivers, torch.randn(len(body), 8, dtype=torch.float64), body.level)
    (part,) = [part for part in net.steps[0].parts if part.level]
    rows = (body.level >= 2).nonzero()[:, 0]
    _, after = net.steps[0](net.node_encoder(nodes), {"body": latent}, {part: rows})
    changed = (after["body"].features != latent.features).any(1)
    assert torch.equal(changed, body.level >= 2)


def chain(count: int, stride: int, size: int) -> EdgeSet:
    first = torch.arange(0, count - stride, stride)
    senders, receivers = torch.cat([first, first + stride]), torch.cat([first + stride, first])
    return EdgeSet(senders, receivers, torch.ones(len(senders), size, dtype=torch.float64))


def reached(net: MeshGraphNet, edges: dict[str, EdgeSet], count: int) -> int:
    """How many nodes along a chain a change of the first one is felt."""
    nodes = torch.randn(count, 3, dtype=torch.float64)
    changed = nodes.clone()
    changed[0] += 1.0
    with torch.no_grad():
        return int((net(nodes, edges) - net(changed, edges)).abs().amax(1).nonzero().max())


def test_messages_travel_an_edge_a_step():
    net = make_net([["mesh"]] * 4, {"mesh": 5})
    assert reached(net, {"mesh": chain(60, 1, 5)}, 60) == 4


def test_messages_travel_farther_in_a_hierarchy():
    sizes = {"mesh": 5, "coarse_1": 5, "coarse_2": 5, "body": 4}
    net = make_net(hood_schedule(1), sizes)
    edges = {"mesh": chain(61, 1, 5), "coarse_1": chain(61, 2, 5), "coarse_2": chain(61, 4, 5)}
    assert reached(net, edges, 61) == 2 + 2 + 4 + 4 + 2, "what has come to vertex 2 waits there for the way to vertex 4"


def test_an_edge_set_that_is_not_used_or_not_there():
    with pytest.raises(DrapeError, match=r"\['body', 'mesh'\].*\['body', 'coarse_1', 'mesh'\]"):
        make_net(flat_schedule(2), {"mesh": 5, "coarse_1": 5, "body": 4})
    with pytest.raises(DrapeError, match="coarse_2"):
        make_net(hood_schedule(), {"mesh": 5, "coarse_1": 5, "body": 4})
    with pytest.raises(DrapeError, match="schedule"):
        make_net([], {})
    with pytest.raises(DrapeError, match="body@x"):
        make_net([["mesh", "body@x"]])
    with pytest.raises(DrapeError, match="twice"):
        make_net([["mesh", "body", "body@1"]])
