"""Hold joints together: correct the twists of a frame so that hinges and sliders end it without drift.

One linear constraint a joint, solved together by Jacobi iterations: an impulse at the anchor moves both pieces by
their compliance, as heavy as they are and as hard to turn; a piece with several joints takes their mean.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.graph.contact_graph import ContactGraph, in_frame, in_world, perpendicular
from pushgraph.scene import NOMINAL_MASS

ITERATIONS = 10


def hold_joints(graph: ContactGraph, twist: Float[Tensor, "nodes 3"]) -> Float[Tensor, "nodes 3"]:
    """Twists, in steps, that leave least of the drift of joints; free pieces keep theirs bit for bit."""
    axis, revolute = graph.slack_axis[:, :2], graph.slack_axis[:, 2] > 0
    joints = (revolute | (axis != 0).any(-1)).nonzero().squeeze(-1)
    if not len(joints):
        return twist
    receiver, sender, normal = graph.receiver[joints], graph.sender[joints], graph.normal[joints]
    axis, revolute, drift, turn = axis[joints], revolute[joints], graph.offsets[joints, 2], graph.turn[joints]
    arms = [perpendicular(levers[joints, 2]) for levers in (graph.receiver_levers, graph.sender_levers)]
    weight = 1 / (graph.nodes[:, 0].exp() * NOMINAL_MASS)
    moves = [weight[end] for end in (receiver, sender)]
    turns = [(weight * graph.compliance)[end] for end in (receiver, sender)]
    share = 1 / torch.zeros_like(weight).index_add(0, receiver, torch.ones_like(turn))[receiver]

    # How far the two anchors part for a unit impulse between them; a slider resists only across its axis.
    eye = torch.eye(2, dtype=twist.dtype, device=twist.device)
    apart = (moves[0] + moves[1])[:, None, None] * eye
    for arm, ease in zip(arms, turns, strict=True):
        apart = apart + ease[:, None, None] * arm[:, :, None] * arm[:, None, :]
    across = perpendicular(axis)
    slider = across[:, :, None] * across[:, None, :]
    slider = slider / (across[:, None] @ apart @ across[:, :, None]).clamp(min=1e-9)
    hinge = torch.linalg.inv(apart)
    impulse_of = torch.where(revolute[:, None, None], hinge, slider)
    torque_of = torch.where(revolute, 0.0, 1 / (turns[0] + turns[1]))

    # What a joint answers to the twists of its ends, world axes, is affine in them: found once, from unit twists.
    def answer(apart: Tensor, turned: Tensor) -> Tensor:
        impulse = (impulse_of @ apart[..., None]).squeeze(-1)
        torque = torque_of * turned + (impulse * arms[0]).sum(-1)
        change = torch.cat((impulse * moves[0][:, None], (torque * turns[0])[..., None]), -1)
        return in_world(change * share[:, None], normal)

    unit = torch.eye(6, dtype=twist.dtype, device=twist.device)[:, None].expand(6, len(joints), 6)
    here, there = in_frame(unit[..., :3], normal), in_frame(unit[..., 3:], normal)
    apart = there[..., :2] + there[..., 2:] * arms[1] - here[..., :2] - here[..., 2:] * arms[0]
    at_rest, of_ends = answer(drift, turn), answer(apart, there[..., 2] - here[..., 2])
    ends = torch.stack((receiver, sender), 1).flatten()
    for _ in range(ITERATIONS):
        at_ends = twist.index_select(0, ends).view(-1, 6).t()
        twist = twist.index_add(0, receiver, at_rest + (of_ends * at_ends[..., None]).sum(0))
    return twist
