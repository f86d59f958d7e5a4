"""The propagation network that corrects contact problems.

Edges, the contacts and joints, and nodes are encoded, messages pass between them, and every contact answers with what
is to be corrected there. Both images of the graph, as it is and in a mirror, go through the same weights, and so do
both ends of every edge; what is even in a mirror is their mean, what is odd (the force along the surface) their
difference. So mirror images have mirrored answers and forces of a pair are equal and opposite, whatever the weights.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph.graph.contact_features import EDGE_FEATURES, NODE_FEATURES, ContactFeatures, mirrored
from pushgraph.graph.contact_graph import ContactGraph
from pushgraph.network.contact_problem import Correction

ANSWERS = 4
"""At each contact: gap, friction, force along and across the normal."""
GAP, FRICTION, FORCE = 0.1, 0.3, 0.3
"""Units of corrections: of gaps (steps), of logarithms of friction, of forces over the friction of what they move."""


class ContactNetwork(nn.Module):
    """Corrections of a graph's contact problem."""

    def __init__(self, hidden: int = 48, steps: int = 2) -> None:
        super().__init__()
        self.hidden, self.steps = hidden, steps
        self.edge_encoder = nn.Sequential(nn.Linear(len(EDGE_FEATURES), hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        self.node_encoder = nn.Sequential(nn.Linear(len(NODE_FEATURES), hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        self.from_nodes = nn.Linear(hidden, 2 * hidden, bias=False)
        self.message = nn.Linear(hidden, hidden)
        self.node_update = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        self.of_edge = nn.Linear(hidden, ANSWERS)
        self.of_node = nn.Linear(hidden, 1)
        for layer in (self.of_edge, self.of_node):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    @property
    def is_silent(self) -> bool:
        """Whether it corrects nothing, as before training, and is not being trained."""
        answers = (self.of_edge.weight, self.of_edge.bias, self.of_node.weight, self.of_node.bias)
        return not self.training and not any(values.any() for values in answers)

    def forward(self, graph: ContactGraph, features: ContactFeatures) -> Correction:
        """Corrections; latents have the precision of the weights."""
        return self._correction(graph, features, *self.propagate(features))

    def propagate(
        self, features: ContactFeatures
    ) -> tuple[Float[Tensor, "images directed hidden"], Float[Tensor, "images nodes hidden"]]:
        """Latents of edges and nodes after all messages, of the graph as it is and in a mirror."""
        precision = self.message.weight.dtype
        images = torch.stack((features.edges, mirrored(features.edges))).to(precision)
        edge = self.edge_encoder(images)
        node = self.node_encoder(features.nodes.to(precision)).expand(2, -1, -1)
        weight = features.weight[:, None].to(precision)
        for _ in range(self.steps):
            to_receiver, to_sender = self.from_nodes(node).chunk(2, -1)
            hidden = edge + to_receiver.index_select(1, features.receiver)
            hidden = (hidden + to_sender.index_select(1, features.sender)).relu()
            hidden = self.message(hidden).relu()
            total = torch.zeros_like(node).index_add(1, features.receiver, (hidden * weight).to(node.dtype))
            node = node + self.node_update(torch.cat((node, total), -1))
        return hidden, node

    def _correction(self, graph: ContactGraph, features: ContactFeatures, hidden: Tensor, node: Tensor) -> Correction:
        contacts, nodes = graph.contacts, graph.nodes
        count = len(contacts.gap)
        # [images, ends, points, answers], in the precision of the graph
        answers = self.of_edge(hidden.unflatten(1, (2, -1))[:, :, :count]).mean(1).to(contacts.gap)
        even, odd = (answers[0] + answers[1]) / 2, (answers[0] - answers[1]) / 2
        fade = graph.edges.fade[contacts.points.edge]
        gap, friction, along, _ = (even * fade[:, None]).unbind(-1)
        first, second = (
            torch.where(nodes.given[end] | nodes.is_tool[end], torch.inf, nodes.mass[end])
            for end in (contacts.points.first, contacts.points.second)
        )
        weight = FORCE / (1 / first + 1 / second) * features.weight[:count]
        return Correction(
            gap=GAP * gap,
            friction=(FRICTION * friction.tanh()).exp(),
            force=torch.stack((along * weight, odd[:, 3] * fade * weight)),
            table_friction=(FRICTION * self.of_node(node).mean(0)[:, 0].tanh()).exp().to(contacts.gap),
        )
