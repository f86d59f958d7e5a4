"""From what is believed of unknown pairs to relations that a prediction can use."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.state import State
from pushgraph.scene import SLIDE, SWING

CONTRADICTED = 0.01
"""Drift (m) that a joint's supposed place cannot explain and that tells where it sits instead."""
TURNED = 0.2
"""A hinge must have turned this far (rad) for its anchor to be found."""


def believe(state: State, kind: Int[Tensor, "batch pairs"]) -> State:
    """The state with every unknown pair joined as `kind` says, where the memory has it; all pairs count as known then.

    Joints sit where those of a scene do that gives none of it (see `scene.place_joint`), unless what was seen
    contradicts it: then a slider's axis is the way it went, and a hinge's anchor the point that stayed.
    """
    relations, scenes = state.relations, state.scenes
    a, b = pairs_of(state.poses.shape[1], state.poses.device)
    unknown = relations.remembered & ~relations.known
    kind = torch.where(unknown, kind, relations.kind)
    offset = relations.yaw_offset
    centre = relations.anchor_a - pose.rotate(relations.anchor_b, offset)
    boxes = [RoundedBox(scenes.boxes.half_extents[:, end], scenes.boxes.radius[:, end]) for end in (a, b)]
    gap = signed_gap(*boxes, torch.cat((centre, offset[..., None]), -1)).clamp(min=0)
    now = pose.relative(state.poses[:, a], state.poses[:, b]).float()
    drift = pose.transform(now, relations.anchor_b) - relations.anchor_a

    axis = centre / centre.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    across = (drift - (drift * axis).sum(-1, keepdim=True) * axis).norm(dim=-1) > CONTRADICTED
    axis = torch.where(across[..., None], drift / drift.norm(dim=-1, keepdim=True).clamp(min=1e-9), axis)
    slide = torch.stack((-torch.where(across, SLIDE, gap), torch.full_like(gap, SLIDE)), -1)

    revolute, prismatic = kind == JOINT_CODES["revolute"], kind == JOINT_CODES["prismatic"]
    stayed = _point_that_stayed(centre, offset, now)
    turned = pose.wrap_angle(now[..., 2] - offset).abs() > TURNED
    elsewhere = unknown & revolute & turned & (drift.norm(dim=-1) > CONTRADICTED)
    stayed_b = pose.rotate(stayed - centre, -offset)
    limits = torch.where(prismatic[..., None], slide, slide.new_tensor([-SWING, SWING]))
    limits = torch.where((prismatic | revolute)[..., None], limits, 0.0)
    return state._replace(
        relations=relations._replace(
            kind=kind,
            known=torch.ones_like(relations.known),
            remembered=kind > 0,
            anchor_a=torch.where(elsewhere[..., None], stayed, relations.anchor_a),
            anchor_b=torch.where(elsewhere[..., None], stayed_b, relations.anchor_b),
            axis=torch.where(unknown[..., None], axis, relations.axis),
            limits=torch.where(unknown[..., None], limits, relations.limits),
        )
    )


def _point_that_stayed(
    centre: Float[Tensor, "batch pairs 2"], offset: Float[Tensor, "batch pairs"], now: Float[Tensor, "batch pairs 3"]
) -> Float[Tensor, "batch pairs 2"]:
    """The point, in the frame of the earlier body, about which the later one turned from its first place to now.

    x = centre + R(offset) y = now + R(now) y, so x - centre turned by the angle between is x - now. Where there was
    no turn it means nothing.
    """
    turn = pose.wrap_angle(now[..., 2] - offset)
    half = (now[..., :2] - centre) / 2
    cotangent = 1 / (turn / 2).tan().where(turn.abs() > 1e-3, 1.0)
    return centre + half + torch.stack((-half[..., 1], half[..., 0]), -1) * cotangent[..., None]
