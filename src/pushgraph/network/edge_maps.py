"""Linear maps at edges: what the twists of two ends mean there, and what forces there do to the receiver.

Twists are about centres of mass, in world axes; what they mean is told in the contact frame. Numbers come first and
edges last: an operation then works through long rows, which is several times as fast as the other way round.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def edges_last(vectors: Float[Tensor, "edges *numbers"]) -> Float[Tensor, "*numbers edges"]:
    """The same numbers with the edges in the last place, in rows."""
    return vectors.movedim(0, -1).contiguous()


def arms_of(levers: Float[Tensor, "edges points 2"]) -> Float[Tensor, "points 2 edges"]:
    """How points at these levers move if their body turns: the levers turned to the left by a right angle."""
    x, y = edges_last(levers).unbind(1)
    return torch.stack((-y, x), 1)


def in_contact_frame(normal: Float[Tensor, "2 edges"]) -> Float[Tensor, "3 3 edges"]:
    """For each unit twist in world axes the same twist in the contact frame whose x-axis is the normal."""
    (x, y), zero, one = normal, torch.zeros_like(normal[0]), torch.ones_like(normal[0])
    return torch.stack((x, -y, zero, y, x, zero, zero, zero, one)).view(3, 3, -1)


def parting(
    normal: Float[Tensor, "2 edges"],
    receiver_arms: Float[Tensor, "points 2 edges"],
    sender_arms: Float[Tensor, "points 2 edges"],
) -> tuple[Float[Tensor, "6 points 2 edges"], Float[Tensor, "6 edges"]]:
    """How the sender's points move away from the receiver's, contact frame, and how it turns relative to it, for each
    unit twist of the receiver, then of the sender."""
    x, y = normal
    moves = torch.stack((x, -y, y, x)).view(2, 1, 2, -1).expand(-1, len(receiver_arms), -1, -1)
    moved = torch.cat((-moves, -receiver_arms[None], moves, sender_arms[None]))
    turned = normal.new_tensor([0.0, 0.0, -1.0, 0.0, 0.0, 1.0])[:, None].expand(-1, normal.shape[1])
    return moved, turned


def pushing(
    normal: Float[Tensor, "2 edges"],
    arms: Float[Tensor, "points 2 edges"],
    compliance: Float[Tensor, " edges"],
) -> Float[Tensor, "forces 3 edges"]:
    """How a body moves, world axes, for each unit force at its points, contact frame, and then for a unit torque.

    A force moves the body as much as a torque turns it; an arm's torque turns it by its compliance.
    """
    x, y = normal
    moves = torch.stack((x, y, -y, x)).view(2, 2, -1).expand(len(arms), -1, -1, -1)
    forces = torch.cat((moves, (arms * compliance)[:, :, None]), 2).flatten(0, 1)
    torque = torch.stack((torch.zeros_like(x), torch.zeros_like(x), torch.ones_like(x)))
    return torch.cat((forces, torque[None]))
