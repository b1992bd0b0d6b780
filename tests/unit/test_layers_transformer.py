"""The interaction layer of LayersNet, against a dense one written out, and where it could divide by zero."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from drape.errors import DrapeError
from drape.nets.layers_transformer import (
    CLOSEST,
    BodyFrameMessages,
    InteractionLayer,
    Interactions,
    LayersTransformer,
    Streams,
)
from drape.nets.patch_decoder import PatchDecoder
from drape.nets.segments import segment_softmax

P, B, WIDTH, HEADS = 7, 5, 24, 4
SIZE = WIDTH // HEADS


def rotations(count: int) -> torch.Tensor:
    q, r = torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64))
    q = q * torch.diagonal(r, dim1=-2, dim2=-1).sign()[:, None]
    return q * torch.linalg.det(q)[:, None, None]


def interactions() -> Interactions:
    """Random edges; patch 2 hears nobody in space but the body, patch 3 nobody in space at all."""
    world, body = torch.rand(P, P) < 0.4, torch.rand(P, B) < 0.5
    world[2:4] = False
    body[2, 1], body[3] = True, False
    mesh = (torch.rand(P, P) < 0.3) | torch.eye(P, dtype=torch.bool)
    return Interactions(*(mask.nonzero().T.contiguous() for mask in (mesh, world, body)))


def dense(layer: InteractionLayer, streams: Streams, bodies, frames, edges: Interactions) -> torch.Tensor:
    """The patches after the layer: every receiver, head and sender on its own."""
    x = streams.patches
    r = (streams.receivers + layer.receiver(x)).view(P, HEADS, SIZE)
    s = (streams.senders + layer.sender(torch.cat([x, bodies]))).view(P + B, HEADS, SIZE)
    q = layer.query(x).view(P, HEADS, SIZE)
    lift = layer.body_frame.lift.weight
    heard = torch.zeros(P, HEADS, SIZE, dtype=x.dtype)
    for i in range(P):
        for h in range(HEADS):
            space = [(0, b) for a, b in edges.world.T.tolist() if a == i] + [
                (1, b) for a, b in edges.body.T.tolist() if a == i
            ]
            cloth = [(0, b) for a, b in edges.mesh.T.tolist() if a == i]
            logits, values = [], []
            for body, j in space if h < HEADS // 2 else cloth:
                sender = s[P * body + j, h]
                std = ((r[i, h] - sender).square().sum() + CLOSEST**2).sqrt() / 2
                logits.append((q[i, h] @ sender + q[i, h] @ r[i, h]) / std)
                value = (sender + r[i, h]) / (2 * std)
                if body:
                    into = lift @ frames[j] @ lift.T
                    first, second = layer.body_frame.first, layer.body_frame.second
                    value = nn.functional.silu(into @ value @ first.weight[h] + first.bias[h])
                    value = into.T @ (value @ second.weight[h] + second.bias[h])
                values.append(value)
            if values:
                heard[i, h] = torch.softmax(torch.stack(logits), 0) @ torch.stack(values)
    x = layer.attention_norm(x + layer.out(heard.flatten(1)))
    return layer.norm(x + layer.feed_forward(x))


def some_streams() -> Streams:
    return Streams(*(torch.randn(rows, WIDTH, dtype=torch.float64) for rows in (P, P, P + B)))


def test_sparse_equals_dense():
    """The layer on lists of edges equals the sums written out."""
    layer = InteractionLayer(WIDTH, HEADS).double()
    streams, edges = some_streams(), interactions()
    bodies, frames = torch.randn(B, WIDTH, dtype=torch.float64), rotations(B)
    found = layer(streams, bodies, frames, edges)
    torch.testing.assert_close(found.patches, dense(layer, streams, bodies, frames, edges))
    torch.testing.assert_close(found.receivers, streams.receivers + layer.receiver(streams.patches))
    assert found.senders.shape == (P + B, WIDTH)


def test_order_of_edges_and_senders_does_not_matter():
    """Edges and faces of the body in another order are the same network."""
    net = LayersTransformer(6, 9, width=WIDTH, heads=HEADS, layers=2).double()
    patches, bodies, frames = torch.randn(P, 6).double(), torch.randn(B, 9).double(), rotations(B)
    edges = interactions()
    order = torch.randperm(B)
    body = torch.stack([edges.body[0], torch.argsort(order)[edges.body[1]]])
    shuffled = Interactions(*(pairs[:, torch.randperm(pairs.shape[1])] for pairs in (edges.mesh, edges.world, body)))
    found = net(patches, bodies[order], frames[order], shuffled)
    torch.testing.assert_close(found, net(patches, bodies, frames, edges))


def test_all_parameters_are_used():
    """Every parameter of the network has a gradient that is not zero."""
    net = LayersTransformer(6, 9, width=WIDTH, heads=HEADS, layers=2).double()
    out = net(torch.randn(P, 6).double(), torch.randn(B, 9).double(), rotations(B), interactions())
    (out * torch.randn_like(out)).sum().backward()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in net.parameters())


def test_no_body():
    """Without senders of a body the layer runs, and a patch that hears nobody in space still has a value."""
    net = LayersTransformer(6, 9, width=WIDTH, heads=HEADS, layers=2).double()
    edges = interactions()._replace(body=torch.zeros(2, 0, dtype=torch.long))
    out = net(torch.randn(P, 6).double(), torch.zeros(0, 9).double(), torch.zeros(0, 3, 3).double(), edges)
    assert torch.isfinite(out).all()


def test_sender_at_its_receiver():
    """Where s = r values and gradients stay finite, also in float32."""
    layer = InteractionLayer(WIDTH, HEADS)
    with torch.no_grad():
        layer.sender.weight.copy_(layer.receiver.weight)
        layer.sender.bias.copy_(layer.receiver.bias)
    x = torch.randn(P, WIDTH, requires_grad=True)
    itself = torch.arange(P).expand(2, -1)
    edges = Interactions(itself, itself, torch.zeros(2, 0, dtype=torch.long))
    streams = Streams(x, torch.zeros(P, WIDTH), torch.zeros(P, WIDTH))
    out = layer(streams, torch.zeros(0, WIDTH), torch.zeros(0, 3, 3), edges).patches
    (out * torch.randn_like(out)).sum().backward()
    assert torch.isfinite(out).all()
    assert all(torch.isfinite(p.grad).all() for p in [x, *layer.parameters()] if p.grad is not None)
    assert x.grad.abs().max() < 1e3


def test_softmax_of_rows():
    """As the dense softmax, for numbers that overflow on their own; owners without rows do no harm."""
    owner = torch.tensor([2, 0, 2, 2])
    logits = torch.tensor([[1e4, 1.0], [5.0, -1e4], [1e4 + 1, 2.0], [-1e4, 3.0]], dtype=torch.float64)
    found = segment_softmax(logits, owner, 4)
    torch.testing.assert_close(found[owner == 2], torch.softmax(logits[owner == 2], 0))
    torch.testing.assert_close(found[1], torch.ones(2, dtype=torch.float64))


def test_lift_is_orthonormal_and_stays_so():
    """RᵀR = 1 at first and after steps of an optimiser."""
    messages = BodyFrameMessages(2, 8).double()
    optimiser = torch.optim.SGD(messages.parameters(), lr=1.0)
    before = messages.lift.weight.detach().clone()
    for _ in range(3):
        optimiser.zero_grad()
        messages(torch.randn(4, 2, 8).double(), rotations(4)).square().sum().backward()
        optimiser.step()
        lift = messages.lift.weight
        torch.testing.assert_close(lift.T @ lift, torch.eye(3, dtype=torch.float64))
    assert (lift - before).abs().max() > 1e-3


def test_messages_turn_with_the_body():
    """Lifted vectors and frames turned together turn the result; turned alone they do not."""
    messages = BodyFrameMessages(2, 8).double()
    lift, frames, turn = messages.lift.weight, rotations(5), rotations(1)[0]
    vectors = torch.randn(5, 2, 3).double()
    out = messages(vectors @ lift.T, frames)
    turned = messages(vectors @ turn.T @ lift.T, frames @ turn.T)
    torch.testing.assert_close(turned, out @ lift @ turn.T @ lift.T)
    assert (messages(vectors @ turn.T @ lift.T, frames) - turned).abs().max() > 1e-3


def test_decoder_is_the_mean_over_candidates():
    """As the concatenated rows through the layers one by one; nearly silent at first."""
    decoder = PatchDecoder(4, 6, 5, 8).double()
    relative, patches, own = torch.randn(5, 4).double(), torch.randn(3, 6).double(), torch.randn(2, 5).double()
    candidates = torch.tensor([[0, 0, 1, 1, 1], [0, 2, 0, 1, 2]])
    assert decoder(relative, patches, own, candidates).abs().max() < 0.1
    nn.init.normal_(decoder.last.weight)
    weight = torch.cat([decoder.relative.weight, decoder.patch.weight, decoder.own.weight], 1)
    rows = torch.cat([relative, patches[candidates[1]], own[candidates[0]]], 1)
    said = decoder.last(decoder.hidden(rows @ weight.T + decoder.relative.bias))
    expected = torch.stack([said[:2].mean(0), said[2:].mean(0)])
    torch.testing.assert_close(decoder(relative, patches, own, candidates), expected)


@pytest.mark.parametrize("sizes", [{"heads": 3}, {"width": 30}, {"width": 16}, {"layers": 0}])
def test_impossible_sizes(sizes):
    with pytest.raises(DrapeError, match="multiple of it"):
        LayersTransformer(6, 9, **({"width": 32, "heads": 8, "layers": 1} | sizes))
