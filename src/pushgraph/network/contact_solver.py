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

from pushgraph.graph.contact_graph import (
    CLAMP,
    EDGE_FEATURES,
    NODE_FEATURES,
    ContactGraph,
    in_frame,
    in_world,
    perpendicular,
)

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
        """Solve one frame."""
        receiver, sender = graph.receiver, graph.sender
        edge = self.edge_encoder(graph.edges)
        node = self.node_encoder(graph.nodes)
        weight = graph.edges[:, :1]
        free = (~graph.kinematic)[:, None].to(edge.dtype)
        twist = graph.twist
        arms = perpendicular(graph.receiver_levers), perpendicular(graph.sender_levers)
        for _ in range(self.steps):
            at_receiver, at_sender = (in_frame(twist.index_select(0, end), graph.normal) for end in (receiver, sender))
            to_receiver, to_sender = self.from_nodes(node).chunk(2, -1)
            hidden = edge + self.from_estimates(_estimates(graph, at_receiver, at_sender, *arms))
            hidden = hidden + to_receiver.index_select(0, receiver) + to_sender.index_select(0, sender)
            hidden = self.message(hidden.relu()).relu()
            force = self.force(hidden).to(twist.dtype) * weight
            total = torch.zeros_like(node).index_add(0, receiver, hidden * weight.to(hidden.dtype))
            node = node + self.node_update(torch.cat((node, total), -1))
            change = _pushed(force, arms[0], graph.compliance.index_select(0, receiver))
            change = torch.zeros_like(twist).index_add(0, receiver, in_world(change, graph.normal))
            damping = self.damping(node).to(twist.dtype)
            damping = torch.cat((damping[:, :1], damping), -1)
            twist = twist + free * (change + damping * twist)
        return Solution(twist, hidden)


def _estimates(graph: ContactGraph, at_receiver: Tensor, at_sender: Tensor, arm: Tensor, sender_arm: Tensor) -> Tensor:
    """What the estimates leave of offsets, turn and slack, and the estimates themselves, in contact frame."""
    moved = at_sender[:, None, :2] + at_sender[:, None, 2:] * sender_arm
    moved = moved - at_receiver[:, None, :2] - at_receiver[:, None, 2:] * arm
    left = (graph.offsets + moved).clamp(-CLAMP, CLAMP).flatten(1)
    turned = at_sender[:, 2] - at_receiver[:, 2]
    used = (moved[:, 2] * graph.slack_axis[:, :2]).sum(-1) + turned * graph.slack_axis[:, 2]
    slack = (graph.slack + torch.stack((used, -used), -1)).clamp(-CLAMP, CLAMP)
    return torch.cat((left, (graph.turn + turned)[:, None].clamp(-CLAMP, CLAMP), slack, at_receiver, at_sender), -1)


def _pushed(force: Tensor, arms: Tensor, compliance: Tensor) -> Tensor:
    """How forces at the ends of the arms, and a torque, move the receiver; contact frame."""
    forces = force[:, :6].view(-1, 3, 2)
    torque = (forces * arms).sum((1, 2)) * compliance + force[:, 6]
    return torch.cat((forces.sum(1), torque[:, None]), -1)
