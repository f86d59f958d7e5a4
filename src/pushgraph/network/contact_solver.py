"""`contact`: the network as an unrolled contact solver.

Beside its latent every node carries an estimate of its twist in this frame, the tool's being exact. In each step an
edge is told what the estimates of its two ends leave of the gap, of the joint's drift and of the room to its limits,
and answers with a message and with forces at its contacts and its joint; a node corrects its estimate by the forces
and its latent by the messages. Directions enter and leave in contact frames only, so the motion turns with the scene.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pushgraph.graph.contact_graph import CLAMP, EDGE_FEATURES, NODE_FEATURES, ContactGraph
from pushgraph.network.edge_maps import arms_of, edges_last, in_contact_frame, parting, pushing

CLAMPED, ESTIMATES = 9, 15
"""Features of an edge that change with the estimates: what is left of three offsets, turn, slack; and both twists."""
FORCES = 7
"""What an edge answers with: forces at two contacts and the joint, in contact frame, and a torque."""


class Solution(NamedTuple):
    """Twist of every node about its centre of mass, world axes, in steps of the tool, angles times LEVER.

    Zero where the tool does not move. messages: the last of every edge.
    """

    twist: Float[Tensor, "nodes 3"]
    messages: Float[Tensor, "edges hidden"]


class ContactSolver(nn.Module):
    """Finds the twists of a graph's nodes."""

    def __init__(self, hidden: int = 96, steps: int = 8) -> None:
        super().__init__()
        self.hidden, self.steps = hidden, steps
        self.edge_encoder = nn.Sequential(nn.Linear(len(EDGE_FEATURES), hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        self.node_encoder = nn.Sequential(nn.Linear(len(NODE_FEATURES), hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        # One layer over (edge, receiver, sender, estimates), split so that each part is computed where it lives.
        self.from_nodes = nn.Linear(hidden, 2 * hidden, bias=False)
        self.from_estimates = nn.Linear(ESTIMATES, hidden, bias=False)
        self.message = nn.Linear(hidden, hidden)
        self.force = nn.Linear(hidden, FORCES)
        self.node_update = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, hidden))
        self.damping = nn.Linear(hidden, 2)
        nn.init.zeros_(self.damping.weight)
        nn.init.zeros_(self.damping.bias)
        with torch.no_grad():
            self.force.weight *= 0.1
            self.force.bias.zero_()

    def forward(self, graph: ContactGraph) -> Solution:
        """Solve one frame.

        Latents have the precision of the weights, estimates always that of the graph.
        """
        precision = self.force.weight.dtype
        edge = self.edge_encoder(graph.edges.to(precision))
        node = self.node_encoder(graph.nodes.to(precision))
        free = (~graph.kinematic).to(graph.twist.dtype)
        at_rest, of_ends, of_force = _linear_maps(graph)
        weights = self._weights()
        # `told`, seen as three rows a node, says first what goes where it receives, second where it sends.
        ends = torch.stack((graph.receiver, graph.sender))
        rows = (3 * ends.t() + ends.new_tensor([0, 1])).flatten()
        pairs = torch.arange(0, len(rows), 2, device=rows.device)
        order = graph.receiver.argsort(stable=True)
        received = graph.receiver.bincount(minlength=len(node))
        received = received.cumsum(0) - received
        weight = graph.edges[:, 0].index_select(0, order)
        twist, ends, receiver = edges_last(graph.twist), ends.flatten(), graph.receiver.expand(3, -1)
        for _ in range(self.steps):
            at_ends = twist.index_select(1, ends).view(6, 1, -1)
            estimates = (at_rest + (of_ends * at_ends).sum(0)).clamp(*weights.bounds)
            told = torch.addmm(weights.node_bias, node, weights.of_node)
            hidden = torch.addmm(edge, estimates.t().to(precision), weights.of_estimates)
            hidden += _sums(told.view(-1, self.hidden), rows, pairs)
            hidden = torch.addmm(weights.message_bias, hidden.relu_(), weights.of_message).relu_()
            total = _sums(hidden, order, received, weight.to(hidden.dtype))
            total = torch.addmm(told[:, 2 * self.hidden :], total, weights.of_total).relu_()
            node = torch.addmm(node, total, weights.of_correction) + weights.correction_bias
            force = torch.addmm(weights.force_bias, self.force.weight, hidden.t()).to(twist.dtype)
            change = (of_force * force[:, None]).sum(0)
            damping = torch.addmm(weights.damping_bias, weights.of_damping, node.t()).to(twist.dtype)
            twist = torch.addcmul(twist.scatter_add(1, receiver, change), free * damping, twist)
        return Solution(twist.t(), hidden)

    def _weights(self) -> "_Weights":
        first, second = self.node_update[0], self.node_update[2]
        of_own, of_total = first.weight.chunk(2, 1)
        same = [0, 0, 1]  # x and y are damped alike
        bound = self.force.weight.new_full((ESTIMATES, 1), torch.inf, dtype=torch.float32)
        bound[:CLAMPED] = CLAMP
        return _Weights(
            bounds=(-bound, bound),
            of_node=torch.cat((self.from_nodes.weight, of_own)).t(),
            node_bias=functional.pad(first.bias, (2 * self.hidden, 0)),
            of_estimates=self.from_estimates.weight.t(),
            of_message=self.message.weight.t(),
            message_bias=self.message.bias,
            of_total=of_total.t(),
            of_correction=second.weight.t(),
            correction_bias=second.bias,
            force_bias=self.force.bias[:, None],
            of_damping=self.damping.weight[same],
            damping_bias=self.damping.bias[same, None],
        )


class _Weights(NamedTuple):
    """Weights of a step as it uses them, so that each product is one operation.

    bounds: of the estimates. of_node: all that a node's latent is multiplied by, for where it receives, where it
    sends, and its update. of_total, of_correction: the two layers of that update, for what a node is told.
    """

    bounds: tuple[Tensor, Tensor]
    of_node: Tensor
    node_bias: Tensor
    of_estimates: Tensor
    of_message: Tensor
    message_bias: Tensor
    of_total: Tensor
    of_correction: Tensor
    correction_bias: Tensor
    force_bias: Tensor
    of_damping: Tensor
    damping_bias: Tensor


def _sums(rows: Tensor, index: Tensor, starts: Tensor, weight: Tensor | None = None) -> Tensor:
    """Sums of the rows at index[starts[k] : starts[k + 1]], times their weights: gathered and added in one pass."""
    return torch.embedding_bag(rows, index, starts, per_sample_weights=weight)[0]


def _linear_maps(graph: ContactGraph) -> tuple[Tensor, Tensor, Tensor]:
    """All that the loop needs of the geometry.

    Estimates [15, edges] are affine in the twists of the two ends, world axes, each number of the receiver before that
    of the sender, [6, 15, edges]. Changes of the receiver, world axes, are linear in the forces, [7, 3, edges].
    """
    normal, arms = edges_last(graph.normal), arms_of(graph.receiver_levers)
    moved, turned = parting(normal, arms, arms_of(graph.sender_levers))
    slack_axis = edges_last(graph.slack_axis)
    used = (moved[:, 2] * slack_axis[:2]).sum(1) + turned * slack_axis[2]
    axes = in_contact_frame(normal)
    ends = torch.cat((functional.pad(axes, (0, 0, 0, 3)), functional.pad(axes, (0, 0, 3, 0))))
    of_ends = torch.cat((moved.flatten(1, 2), torch.stack((turned, used, -used), 1), ends), 1)
    of_ends = of_ends.unflatten(0, (2, 3)).transpose(0, 1).flatten(0, 1)
    at_rest = torch.cat((graph.offsets.flatten(1), graph.turn[:, None], graph.slack), -1)
    at_rest = functional.pad(edges_last(at_rest), (0, 0, 0, 6))
    of_force = pushing(normal, arms, graph.compliance.index_select(0, graph.receiver)) * graph.edges[:, 0]
    return at_rest, of_ends, of_force
