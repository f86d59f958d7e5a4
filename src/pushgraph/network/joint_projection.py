"""Hold joints together: correct the twists of a frame so that hinges and sliders end it without drift.

One linear constraint a joint, solved together by Jacobi iterations: an impulse at the anchor moves both pieces by
their compliance, as heavy as they are and as hard to turn; a piece with several joints takes their mean.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.graph.contact_graph import ContactGraph
from pushgraph.network.edge_maps import arms_of, edges_last, parting, pushing
from pushgraph.scene import NOMINAL_MASS

ITERATIONS = 10


def hold_joints(graph: ContactGraph, twist: Float[Tensor, "nodes 3"]) -> Float[Tensor, "nodes 3"]:
    """Twists, in steps, that leave least of the drift of joints; free pieces keep theirs bit for bit."""
    joints = (graph.slack_axis != 0).any(-1).nonzero().squeeze(-1)
    if not len(joints):
        return twist
    receiver, sender = graph.receiver[joints], graph.sender[joints]
    axis = edges_last(graph.slack_axis[joints])
    axis, revolute = axis[:2], axis[2] > 0
    normal = edges_last(graph.normal[joints])
    arms = [arms_of(levers[joints, 2:]) for levers in (graph.receiver_levers, graph.sender_levers)]
    weight = 1 / (graph.nodes[:, 0].exp() * NOMINAL_MASS)
    moves, turns = weight[receiver], (weight * graph.compliance)[receiver]
    other_moves, other_turns = weight[sender], (weight * graph.compliance)[sender]
    share = 1 / torch.zeros_like(weight).index_add(0, receiver, torch.ones_like(turns))[receiver]

    # How far the two anchors part for a unit impulse between them: a symmetric matrix a joint, told as xx, xy, yy.
    (arm,), (other_arm,) = arms
    apart = turns * _square(arm) + other_turns * _square(other_arm)
    apart = apart + (moves + other_moves) * apart.new_tensor([1.0, 0.0, 1.0])[:, None]
    xx, xy, yy = apart
    hinge = torch.stack((yy, -xy, xx)) / (xx * yy - xy * xy)
    # A slider resists only across its axis.
    across = _square(torch.stack((-axis[1], axis[0])))
    slider = across / (across * apart * apart.new_tensor([1.0, 2.0, 1.0])[:, None]).sum(0).clamp(min=1e-9)
    impulse_of = torch.where(revolute, hinge, slider)[[0, 1, 1, 2]].view(2, 2, -1)
    torque_of = torch.where(revolute, 0.0, 1 / (turns + other_turns))

    # What a joint answers to the twists of its ends is affine in them: found once, from unit twists and from rest.
    moved, turned = parting(normal, *arms)
    moved = torch.cat((moved[:, 0], edges_last(graph.offsets[joints, 2])[None]))
    turned = torch.cat((turned, graph.turn[joints][None]))
    impulse = (impulse_of * moved[:, None]).sum(2)
    answer = torch.cat((impulse, (torque_of * turned)[:, None] * graph.compliance[receiver]), 1)[:, :, None]
    answer = (answer * (pushing(normal, arms[0], graph.compliance[receiver]) * share * moves)).sum(1)
    ends = torch.stack((receiver, sender), 1).flatten()
    of_ends, at_rest = answer[:6], answer[6]
    for _ in range(ITERATIONS):
        at_ends = twist.index_select(0, ends).view(-1, 6).t().contiguous()
        twist = twist.index_add(0, receiver, (at_rest + (of_ends * at_ends[:, None]).sum(0)).t())
    return twist


def _square(vector: Float[Tensor, "2 joints"]) -> Float[Tensor, "3 joints"]:
    """Products of a vector's numbers: xx, xy, yy."""
    x, y = vector
    return torch.stack((x * x, x * y, y * y))
