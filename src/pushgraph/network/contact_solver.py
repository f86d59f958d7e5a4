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

ESTIMATES = 15
"""Features of an edge that change with the estimates: what is left of three offsets, turn, slack; both twists."""
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

    def __init__(self, hidden: int = 96, steps: int = 6) -> None:
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
        free = (~graph.kinematic)[:, None].to(graph.twist.dtype)
        at_rest, of_ends, of_force = _linear_maps(graph)
        # All that needs a node's latent at once: rows for where it receives, where it sends, its update; its damping.
        update, correction = self.node_update[0], self.node_update[2]
        by_node, by_total = update.weight.chunk(2, 1)
        of_node = torch.cat((self.from_nodes.weight, by_node)).t()
        ends = torch.stack((graph.receiver, graph.sender), 1).flatten()
        rows = (3 * ends.view(-1, 2) + ends.new_tensor([0, 1])).flatten()
        pairs = torch.arange(0, len(ends), 2, device=ends.device)
        order = graph.receiver.argsort(stable=True)
        received = graph.receiver.bincount(minlength=len(node))
        received = received.cumsum(0) - received
        weight = graph.edges[:, 0].index_select(0, order)
        twist = graph.twist
        for _ in range(self.steps):
            at_ends = twist.index_select(0, ends).view(-1, 6).t().contiguous()
            estimates = _clamped(at_rest + (of_ends * at_ends[:, None]).sum(0)).t()
            told = node @ of_node
            hidden = edge + self.from_estimates(estimates.to(precision))
            hidden += _sums(told.view(-1, self.hidden), rows, pairs)
            hidden = self.message(hidden.relu_()).relu_()
            total = _sums(hidden, order, received, weight.to(hidden.dtype))
            total = (told[:, 2 * self.hidden :] + functional.linear(total, by_total, update.bias)).relu_()
            node = node + correction(total)
            force = torch.addmm(self.force.bias[:, None], self.force.weight, hidden.t()).to(twist.dtype)
            change = (of_force * force[:, None]).sum(0).t()
            damping = self.damping(node).to(twist.dtype)
            damping = torch.cat((damping[:, :1], damping), -1)
            twist = torch.addcmul(twist.index_add(0, graph.receiver, change), free * damping, twist)
        return Solution(twist, hidden)


def _sums(rows: Tensor, index: Tensor, starts: Tensor, weight: Tensor | None = None) -> Tensor:
    """Sums of the rows at index[starts[k] : starts[k + 1]], times their weights: gathered and added in one pass."""
    return functional.embedding_bag(index, rows, starts, mode="sum", per_sample_weights=weight)


def _linear_maps(graph: ContactGraph) -> tuple[Tensor, Tensor, Tensor]:
    """All that the loop needs of the geometry: estimates [15, edges] are affine in the twists of the two ends, world
    axes, [6, 15, edges], and changes of the receiver, world axes, linear in the forces, [7, 3, edges]."""
    normal, arms = edges_last(graph.normal), arms_of(graph.receiver_levers)
    moved, turned = parting(normal, arms, arms_of(graph.sender_levers))
    slack_axis = edges_last(graph.slack_axis)
    used = (moved[:, 2] * slack_axis[:2]).sum(1) + turned * slack_axis[2]
    axes = in_contact_frame(normal)
    ends = torch.cat((functional.pad(axes, (0, 0, 0, 3)), functional.pad(axes, (0, 0, 3, 0))))
    of_ends = torch.cat((moved.flatten(1, 2), torch.stack((turned, used, -used), 1), ends), 1)
    at_rest = torch.cat((graph.offsets.flatten(1), graph.turn[:, None], graph.slack), -1)
    at_rest = functional.pad(edges_last(at_rest), (0, 0, 0, 6))
    of_force = pushing(normal, arms, graph.compliance.index_select(0, graph.receiver)) * graph.edges[:, 0]
    return at_rest, of_ends, of_force


def _clamped(estimates: Tensor) -> Tensor:
    estimates[:9].clamp_(-CLAMP, CLAMP)
    return estimates
