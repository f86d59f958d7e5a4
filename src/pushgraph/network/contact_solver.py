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
        """Solve one frame.

        Latents have the precision of the weights, estimates always that of the graph.
        """
        precision = self.force.weight.dtype
        edge = self.edge_encoder(graph.edges.to(precision))
        node = self.node_encoder(graph.nodes.to(precision))
        free = (~graph.kinematic)[:, None].to(graph.twist.dtype)
        ends = torch.stack((graph.receiver, graph.sender), 1).flatten()
        at_rest, of_ends, of_force = _linear_maps(graph)
        # In `from_nodes`, viewed as two rows a node, the first is for where it receives, the second where it sends.
        halves = (2 * ends.view(-1, 2) + ends.new_tensor([0, 1])).flatten()
        pairs = torch.arange(0, len(ends), 2, device=ends.device)
        order = graph.receiver.argsort(stable=True)
        received = torch.searchsorted(graph.receiver[order], torch.arange(len(node), device=ends.device))
        weight = graph.edges[order, 0]
        twist = graph.twist
        for _ in range(self.steps):
            at_ends = twist.index_select(0, ends).view(-1, 6).t()
            estimates = _clamped(at_rest + (of_ends * at_ends[..., None]).sum(0))
            hidden = edge + self.from_estimates(estimates.to(precision))
            hidden += _sums(self.from_nodes(node).view(-1, self.hidden), halves, pairs)
            hidden = self.message(hidden.relu_()).relu_()
            total = _sums(hidden, order, received, weight.to(hidden.dtype))
            node = node + self.node_update(torch.cat((node, total), -1))
            force = torch.addmm(self.force.bias[:, None], self.force.weight, hidden.t()).to(twist.dtype)
            change = torch.zeros_like(twist).index_add(0, graph.receiver, (of_force * force[..., None]).sum(0))
            damping = self.damping(node).to(twist.dtype)
            damping = torch.cat((damping[:, :1], damping), -1)
            twist = twist + free * (change + damping * twist)
        return Solution(twist, hidden)


def _sums(rows: Tensor, index: Tensor, starts: Tensor, weight: Tensor | None = None) -> Tensor:
    """Sums of the rows at index[starts[k] : starts[k + 1]], times their weights: gathered and added in one pass."""
    return functional.embedding_bag(index, rows, starts, mode="sum", per_sample_weights=weight)


def _linear_maps(graph: ContactGraph) -> tuple[Tensor, Tensor, Tensor]:
    """All that the loop needs of the geometry: estimates [edges, 15] are affine in the twists of the two ends, world
    axes, [6, edges, 15], and changes of the receiver, world axes, linear in the forces, [7, edges, 3].

    They are written down by what they make of unit twists and forces.
    """
    edges = len(graph.normal)
    arms = perpendicular(graph.receiver_levers), perpendicular(graph.sender_levers)
    unit = torch.eye(6, dtype=graph.twist.dtype, device=graph.twist.device)[:, None].expand(6, edges, 6)
    at_receiver, at_sender = (in_frame(twist, graph.normal) for twist in (unit[..., :3], unit[..., 3:]))
    of_ends = _relative(graph, at_receiver, at_sender, *arms)
    unit = torch.eye(FORCES, dtype=graph.twist.dtype, device=graph.twist.device)[:, None].expand(-1, edges, -1)
    pushed = _pushed(unit * graph.edges[:, :1], arms[0], graph.compliance.index_select(0, graph.receiver))
    return _at_rest(graph), of_ends, in_world(pushed, graph.normal)


def _estimates(graph: ContactGraph, at_receiver: Tensor, at_sender: Tensor, arm: Tensor, sender_arm: Tensor) -> Tensor:
    """What the estimates leave of offsets, turn and slack, and the estimates themselves, in contact frame."""
    return _clamped(_at_rest(graph) + _relative(graph, at_receiver, at_sender, arm, sender_arm))


def _clamped(estimates: Tensor) -> Tensor:
    estimates[:, :9].clamp_(-CLAMP, CLAMP)
    return estimates


def _at_rest(graph: ContactGraph) -> Tensor:
    """The estimates while nothing moves."""
    return functional.pad(torch.cat((graph.offsets.flatten(1), graph.turn[:, None], graph.slack), -1), (0, 6))


def _relative(graph: ContactGraph, at_receiver: Tensor, at_sender: Tensor, arm: Tensor, sender_arm: Tensor) -> Tensor:
    """How the twists of the two ends, in contact frame, change the estimates, before these are clamped."""
    apart = at_sender - at_receiver
    moved = apart[..., None, :2] + at_sender[..., None, 2:] * sender_arm - at_receiver[..., None, 2:] * arm
    turned = apart[..., 2:]
    used = (moved[..., 2, :] * graph.slack_axis[:, :2]).sum(-1, keepdim=True) + turned * graph.slack_axis[:, 2:]
    return torch.cat((moved.flatten(-2), turned, used, -used, at_receiver, at_sender), -1)


def _pushed(force: Tensor, arms: Tensor, compliance: Tensor) -> Tensor:
    """How forces at the ends of the arms, and a torque, move the receiver; contact frame."""
    forces = force[..., :6].unflatten(-1, (3, 2))
    torque = (forces * arms).sum((-2, -1)) * compliance + force[..., 6]
    return torch.cat((forces.sum(-2), torque[..., None]), -1)
