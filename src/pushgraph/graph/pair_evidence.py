"""What a frame shows about every pair of bodies: joint memory, how both moved, and how the prediction was wrong.

Told twice, once in the frame of either body: x along the line of centres when the pair was first adjacent, carried by
the receiver. So features do not change when the scene is moved or turned, and neither body comes first.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.contact_graph import LEVER
from pushgraph.graph.scene_batch import pairs_of
from pushgraph.graph.state import State

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
    ends = torch.stack((a, b), -1)
    receiver, sender = ends, ends.flip(-1)
    relations, scenes = after.relations, after.scenes
    anchors = torch.stack((relations.anchor_a, relations.anchor_b), 2)
    offset = torch.stack((relations.yaw_offset, -relations.yaw_offset), 2)
    sender_from_receiver = anchors - pose.rotate(anchors.flip(2), offset)
    distance = sender_from_receiver.norm(dim=-1)
    axis = sender_from_receiver / distance.clamp(min=1e-6)[..., None]

    def drift(state: State) -> tuple[Tensor, Tensor, Tensor]:
        """How far the anchors, the angle and the distance are from what they were."""
        relative = pose.relative(state.poses[:, receiver], state.poses[:, sender]).float()
        apart = pose.transform(relative, anchors.flip(2)) - anchors
        turn = pose.wrap_angle(relative[..., 2] - offset) * LEVER
        return _along(apart, axis), turn, relative[..., :2].norm(dim=-1) - distance

    moved, turn, stretch = drift(after)
    moved_before, turn_before, _ = drift(before)
    yaw = before.poses[:, receiver, 2].float()

    def motions(of_bodies: Tensor) -> Tensor:
        """Those of receiver and sender, turns at LEVER."""
        told = []
        for end in (receiver, sender):
            motion = of_bodies[:, end].float()
            told += [_along(pose.rotate(motion[..., :2], -yaw), axis), motion[..., 2:] * LEVER]
        return torch.cat(told, -1)

    since = (after.poses - first).float()
    travel = torch.stack((since[..., :2].norm(dim=-1), since[..., 2].abs() * LEVER), -1)
    # The sender's anchor is told as it stood in the receiver's frame when the memory began.
    receiver_anchor = _along(anchors, axis) / LEVER
    sender_anchor = _along(pose.rotate(anchors.flip(2), offset), axis) / LEVER
    fine = torch.cat(
        (
            moved,
            turn[..., None],
            stretch[..., None],
            moved - moved_before,
            pose.wrap_angle((turn - turn_before) / LEVER)[..., None] * LEVER,
            motions(after.motions),
            motions(after.motions - predicted),
        ),
        -1,
    )
    receiver_travel, sender_travel = (travel[:, end] / FINE for end in (receiver, sender))
    flags = torch.stack(
        (
            scenes.is_cylinder[:, receiver],
            scenes.is_cylinder[:, sender],
            scenes.yaw_known[:, receiver],
            scenes.yaw_known[:, sender],
            *(of_pair[..., None].expand(*of_pair.shape, 2) for of_pair in (adjacent_at_first, linked)),
            down[:, None, None].expand(*linked.shape, 2),
        ),
        -1,
    ).float()
    return torch.cat(
        (
            (fine / FINE).asinh(),
            receiver_travel.asinh(),
            receiver_anchor,
            sender_travel.asinh(),
            sender_anchor,
            flags,
        ),
        -1,
    )


def _along(vectors: Tensor, axis: Tensor) -> Tensor:
    """Vectors told along an axis and to the left of it."""
    x, y = axis.unbind(-1)
    return torch.stack((vectors[..., 0] * x + vectors[..., 1] * y, vectors[..., 1] * x - vectors[..., 0] * y), -1)
