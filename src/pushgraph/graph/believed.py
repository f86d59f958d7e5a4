"""From what is believed of unknown pairs to relations that a prediction can use."""

import torch
from jaxtyping import Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox, signed_gap
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.state import State
from pushgraph.scene import SLIDE, SWING


def believe(state: State, kind: Int[Tensor, "batch pairs"]) -> State:
    """The state with every unknown pair joined as `kind` says, where the memory has it; all pairs count as known then.

    Joints sit where those of a scene do that gives none of it: see `scene.place_joint`.
    """
    relations, scenes = state.relations, state.scenes
    a, b = pairs_of(state.poses.shape[1], state.poses.device)
    unknown = relations.remembered & ~relations.known
    kind = torch.where(unknown, kind, relations.kind)
    centre = relations.anchor_a - pose.rotate(relations.anchor_b, relations.yaw_offset)
    pose_a_from_b = torch.cat((centre, relations.yaw_offset[..., None]), -1)
    boxes = [RoundedBox(scenes.boxes.half_extents[:, end], scenes.boxes.radius[:, end]) for end in (a, b)]
    gap = signed_gap(*boxes, pose_a_from_b).clamp(min=0)
    slide = torch.stack((-gap, torch.full_like(gap, SLIDE)), -1)
    limits = torch.where((kind == JOINT_CODES["prismatic"])[..., None], slide, slide.new_tensor([-SWING, SWING]))
    limits = torch.where((kind == JOINT_CODES["fixed"])[..., None], 0.0, limits)
    axis = centre / centre.norm(dim=-1, keepdim=True).clamp(min=1e-9)
    return state._replace(
        relations=relations._replace(
            kind=kind,
            known=torch.ones_like(relations.known),
            remembered=kind > 0,
            axis=torch.where(unknown[..., None], axis, relations.axis),
            limits=torch.where(unknown[..., None], limits, relations.limits),
        )
    )
