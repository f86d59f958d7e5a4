"""What a frame shows about every pair of bodies: joint memory, how both moved, and how the prediction was wrong.

Told twice, once in the frame of either body: x along the line of centres when the pair was first adjacent, carried by
the receiver. So features do not change when the scene is moved or turned, and neither body comes first.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.scene_batch import pairs_of
from pushgraph.graph.state import State
from pushgraph.pose import as_complex, wrap_angle

FINE = 0.001
"""Lengths (m), and turns at LEVER, are told as the inverse hyperbolic sine in this unit: fine near zero, not large."""

FEATURES = (
    *("drift_x", "drift_y", "turn", "stretch"),
    *("drifting_x", "drifting_y", "turning"),
    *(f"{end}_{what}_{part}" for what in ("motion", "surprise") for end in ("receiver", "sender") for part in "xyt"),
    *(f"{end}_{what}" for end in ("receiver", "sender") for what in ("travel", "turned", "anchor_x", "anchor_y")),
    *("receiver_cylinder", "sender_cylinder", "receiver_yaw_known", "sender_yaw_known"),
    *("adjacent_at_first", "linked", "down"),
)
CONSTANTS = {"fine": FINE, "lever": LEVER}
"""What the weights depend on beside the features' names."""


def pair_evidence(
    before: State,
    after: State,
    predicted: Float[Tensor, "batch bodies 3"],
    first: Float[Tensor, "batch bodies 3"],
    adjacent_at_first: Bool[Tensor, "batch pairs"],
    linked: Bool[Tensor, "batch pairs"],
    down: Bool[Tensor, " batch"],
) -> Float[Tensor, "batch pairs 2 features"]:
    """Features of all pairs; they mean something where `after` remembers the pair.

    predicted: motion foreseen from `before` to `after`. first: where bodies were first seen. linked: pairs that share
    edges in the prediction's graph. down: whether the tool was.
    """
    a, b = pairs_of(first.shape[1], first.device)
    scenes, relations = after.scenes, after.relations
    ends = torch.stack((a, b), -1)

    # Planar vectors are complex numbers here: to turn is to multiply. The last axis is for the two directions.
    anchors = torch.stack((as_complex(relations.anchor_a), as_complex(relations.anchor_b)), -1)
    offset = torch.stack((relations.yaw_offset, -relations.yaw_offset), -1)
    others = anchors.flip(-1) * _turn(offset)  # as they stood in the receiver's frame when the memory began
    distance = (anchors - others).abs()
    axis = (anchors - others) / distance.clamp(min=1e-6)

    # How far anchors, angle and distance are from what they were, before and after.
    poses = torch.stack((before.poses, after.poses))
    position, yaw = as_complex(poses[..., :2]), poses[..., 2]
    to_axis = (_turn(yaw[..., ends].float()) * axis).conj()
    centres = (position[..., b] - position[..., a]).to(anchors.dtype)
    reach = anchors * _turn(yaw[..., ends].float())
    apart = centres + reach[..., 1] - reach[..., 0]
    drift = torch.stack((apart, -apart), -1) * to_axis
    turned = (yaw[..., b] - yaw[..., a]).float()
    turn = wrap_angle(torch.stack((turned, -turned), -1) - offset) * LEVER
    stretch = centres.abs()[..., None] - distance

    # What is told of both ends: motions and surprises in the receiver's axis, and how far each has come.
    since = (after.poses - first).float()
    moves = torch.stack((after.motions, after.motions - predicted), 2).float()
    bodies = torch.cat(
        (
            moves.flatten(2),
            since[..., :2].norm(dim=-1, keepdim=True),
            since[..., 2:].abs() * LEVER,
            torch.stack((scenes.is_cylinder, scenes.yaw_known), -1).float(),
        ),
        -1,
    )
    told = bodies.index_select(1, ends.flatten()).unflatten(1, ends.shape)
    told = torch.stack((told, told.flip(2)), 3)  # [batch, pairs, direction, receiver or sender, numbers]
    moves = told[..., :6].unflatten(-1, (2, 3)).transpose(3, 4)
    along = as_complex(moves[..., :2]) * to_axis[0, ..., None, None]
    moves = torch.cat((torch.view_as_real(along), moves[..., 2:] * LEVER), -1).flatten(3)
    receiver, sender = told[..., 6:].unbind(3)
    receiver_anchor, sender_anchor = (torch.view_as_real(some * axis.conj()) / LEVER for some in (anchors, others))
    fine = torch.cat(
        (
            torch.view_as_real(drift[1]),
            turn[1, ..., None],
            stretch[1, ..., None],
            torch.view_as_real(drift[1] - drift[0]),
            wrap_angle((turn[1] - turn[0]) / LEVER)[..., None] * LEVER,
            moves,
            receiver[..., :2],
            sender[..., :2],
        ),
        -1,
    )
    fine = (fine / FINE).asinh()
    of_pair = torch.stack((adjacent_at_first, linked, down[:, None].expand_as(linked)), -1).float()
    told = (
        *(fine[..., :-4], fine[..., -4:-2], receiver_anchor, fine[..., -2:], sender_anchor),
        *(receiver[..., 2:3], sender[..., 2:3], receiver[..., 3:], sender[..., 3:]),
        of_pair[:, :, None].expand(-1, -1, 2, -1),
    )
    return torch.cat(told, -1)


def _turn(yaw: Tensor) -> Tensor:
    """The complex number that turns by yaw (rad)."""
    return torch.polar(torch.ones_like(yaw), yaw)
