"""`propnet`: the propagation network of the paper (sections on preliminaries and physics prediction).

Object and relation encoders, five steps in which every relation passes on what its two objects and its own latent
say, residual on objects, and a velocity head. Layers over concatenated inputs are split, so that each part is
computed where it lives, on an object once and not on each of its relations: the same function, several times cheaper.
"""

import itertools
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pushgraph.graph.propnet_graph import EDGE_FEATURES, NODE_FEATURES


@runtime_checkable
class Graph(Protocol):
    """What is propagated through: features, and the nodes that every edge leads to and comes from."""

    @property
    def nodes(self) -> Float[Tensor, "nodes node_features"]:
        """Of every node."""

    @property
    def edges(self) -> Float[Tensor, "edges edge_features"]:
        """Of every edge."""

    @property
    def receiver(self) -> Int[Tensor, " edges"]:
        """The node it leads to."""

    @property
    def sender(self) -> Int[Tensor, " edges"]:
        """The node it comes from."""


class Propagated(NamedTuple):
    """Motion of every node in its own frame, in units of features, and what the edges passed on last."""

    motion: Float[Tensor, "nodes freedoms"]
    effects: Float[Tensor, "edges hidden"]


class PropagationNetwork(nn.Module):
    """The paper's network. freedoms: of every node, 3 in the plane, 6 in space."""

    def __init__(
        self,
        hidden: int = 256,
        steps: int = 5,
        dropout: float = 0.1,
        node_features: int = len(NODE_FEATURES),
        edge_features: int = len(EDGE_FEATURES),
        freedoms: int = 3,
    ) -> None:
        super().__init__()
        self.steps = steps
        self.object_encoder = _mlp(node_features, hidden, 2)
        self.relation_encoder = _mlp(edge_features, hidden, 3)
        self.relation_from_objects = nn.Linear(hidden, 2 * hidden, bias=False)
        self.relation_from_relation = nn.Linear(hidden, hidden)
        self.object_propagator = nn.Linear(2 * hidden, hidden)
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Sequential(nn.Linear(hidden, hidden), nn.ReLU(), nn.Linear(hidden, freedoms))

    def forward(self, graph: Graph) -> Propagated:
        """Propagate through a graph, in the precision of the weights."""
        precision = self.relation_from_relation.weight.dtype
        objects = self.object_encoder(graph.nodes.to(precision))
        relations = self.relation_from_relation(self.relation_encoder(graph.edges.to(precision)))
        effect = objects
        for _ in range(self.steps):
            to_receiver, to_sender = self.relation_from_objects(effect).chunk(2, -1)
            relation = relations + to_receiver.index_select(0, graph.receiver)
            relation = (relation + to_sender.index_select(0, graph.sender)).relu()
            total = torch.zeros_like(effect).index_add(0, graph.receiver, relation)
            effect = self.dropout((self.object_propagator(torch.cat((objects, total), -1)) + effect).relu())
        return Propagated(self.head(effect).to(graph.nodes.dtype), relation)


def _mlp(inputs: int, hidden: int, layers: int) -> nn.Sequential:
    widths = [inputs, *[hidden] * layers]
    pairs = itertools.pairwise(widths)
    return nn.Sequential(*(module for a, b in pairs for module in (nn.Linear(a, b), nn.ReLU())))
