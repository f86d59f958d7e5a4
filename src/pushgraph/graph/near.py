"""Which pairs may touch in a frame, and which of them a chain of pairs ties to the tool."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import Contact, RoundedBox, contact_between
from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import pairs_of
from pushgraph.graph.state import Control, State

MARGIN = 0.003
"""Gap (m) beyond what two pieces may move in a frame at which they still share an edge."""
STEPS_OF_REACH = 2.0
"""What two pieces may close in one frame, in steps of the tool."""
SLIDER_REACH = 0.12
"""A pair that may be joined keeps its edge up to this gap (m)."""
STILL = 1e-7
"""A tool that moves less than this in a frame (m) is at rest."""


class Near(NamedTuple):
    """Pairs of bodies first < second, or of a body and a part of the tool; -1 where there is none.

    pair: where the two bodies stand in `pairs_of`. contact: in the frame of the first. fade: from 1 to 0 where the
    gap is about to be too wide; 1 for pairs that are joined, or may be.
    """

    scene: Int[Tensor, " pairs"]
    first: Int[Tensor, " pairs"]
    second: Int[Tensor, " pairs"]
    part: Int[Tensor, " pairs"]
    pair: Int[Tensor, " pairs"]
    contact: Contact
    fade: Float[Tensor, " pairs"]


def near_pairs(
    state: State, control: Control, index: Int[Tensor, "batch bodies"], step: Float[Tensor, " batch"]
) -> Near:
    """Pairs that share an edge in this frame; `index` is the piece of each body, `step` how far each tool moves (m)."""
    candidates = _candidates(state, control, index, step)
    candidates = candidates.take(_tied_to_tool(candidates, index, torch.ones_like(candidates.part, dtype=torch.bool)))
    contact = _contacts(state, control, candidates)
    linked = _linked(state, candidates, contact.gap)
    reach = MARGIN + STEPS_OF_REACH * step[candidates.scene]
    fade = ((reach - contact.gap) / (reach / 3)).clamp(0, 1)
    fade = torch.where(linked, 1.0, fade)
    chosen = _tied_to_tool(candidates, index, fade > 0)
    contact = Contact(*(values.index_select(0, chosen) for values in contact))
    return Near(*candidates.take(chosen), contact, fade.index_select(0, chosen))


def tool_step(state: State, control: Control) -> Float[Tensor, " batch"]:
    """How far the tool moves in the frame (m), its farthest point's turning included; zero while it is lifted."""
    step = control.motion[:, :2].norm(dim=-1) + control.motion[:, 2].abs() * state.scenes.reach
    return torch.where(control.down, step, 0.0).float()


def may_move(state: State, control: Control) -> Bool[Tensor, "batch bodies"]:
    """Bodies that the tool can reach in this frame, through others or joints that may be; the rest stays put."""
    index = piece_index(state.scenes, state.relations)
    candidates = _candidates(state, control, index, tool_step(state, control))
    tied = _tied_to_tool(candidates, index, torch.ones_like(candidates.part, dtype=torch.bool))
    candidates = candidates.take(tied)
    pieces = torch.zeros_like(index, dtype=torch.bool)
    pieces[candidates.scene, index[candidates.scene, candidates.first]] = True
    # The tool's pairs have no second body; -1 would be the last one.
    second = torch.where(candidates.part >= 0, candidates.first, candidates.second)
    pieces[candidates.scene, index[candidates.scene, second]] = True
    return pieces.gather(1, index)


class _Pairs(NamedTuple):
    scene: Tensor
    first: Tensor
    second: Tensor
    part: Tensor
    pair: Tensor

    def take(self, index: Tensor) -> "_Pairs":
        return _Pairs(*torch.stack(self).index_select(1, index))


def _candidates(state: State, control: Control, index: Tensor, step: Tensor) -> _Pairs:
    """Pairs whose circumscribed circles are near enough, in scenes whose tool moves; and those that are joined."""
    scenes, positions = state.scenes, state.poses[..., :2]
    a, b = pairs_of(positions.shape[1], positions.device)
    size = scenes.boxes.half_extents.norm(dim=-1) + scenes.boxes.radius
    reach = (MARGIN + STEPS_OF_REACH * step)[:, None]
    moves = scenes.present & (step > STILL)[:, None]
    relations = state.relations
    apart = (positions[:, b] - positions[:, a]).square().sum(-1)
    limit = torch.where(relations.remembered & ~relations.known, SLIDER_REACH, reach) + size[:, a] + size[:, b]
    near = (apart < limit.square()) | (relations.kind > 0)
    near &= moves[:, a] & moves[:, b] & (index[:, a] != index[:, b])
    scene, pair = near.nonzero(as_tuple=True)

    parts = pose.transform(control.pose[:, None], scenes.pose_tool_from_part[..., :2].to(positions.dtype))
    part_size = scenes.parts.half_extents.norm(dim=-1) + scenes.parts.radius
    apart = (parts[:, None] - positions[:, :, None]).square().sum(-1)
    limit = reach[..., None] + size[..., None] + part_size[:, None]
    near = (apart < limit.square()) & moves[..., None] & scenes.part_present[:, None]
    tool_scene, body, part = near.nonzero(as_tuple=True)
    none, no_part = torch.full_like(tool_scene, -1), torch.full_like(scene, -1)
    return _Pairs(
        scene=torch.cat((scene, tool_scene)),
        first=torch.cat((a[pair], body)),
        second=torch.cat((b[pair], none)),
        part=torch.cat((no_part, part)),
        pair=torch.cat((pair, none)),
    )


def _tied_to_tool(pairs: _Pairs, index: Tensor, shares: Bool[Tensor, " pairs"]) -> Int[Tensor, " tied"]:
    """Rows of the pairs that a chain of pairs, all of which share an edge, ties to the tool."""
    row, label, is_tool = pairs.scene * index.shape[1], index.flatten(), pairs.part >= 0
    first = row + label[row + pairs.first]
    second = torch.where(is_tool, first, row + label[row + pairs.second])
    ends = torch.stack((first, second))
    reached = torch.zeros_like(label, dtype=torch.bool)
    tied, before = shares & is_tool, None
    while before is None or not torch.equal(tied, before):
        reached.index_fill_(0, ends[:, tied].flatten(), True)
        tied, before = shares & reached[ends].any(0), tied
    return tied.nonzero().squeeze(-1)


def _linked(state: State, pairs: _Pairs, gap: Tensor) -> Bool[Tensor, " pairs"]:
    """Pairs that share an edge however large their gap: joined ones, and unknown ones that may be joined."""
    relations, scene, pair = state.relations, pairs.scene, pairs.pair.clamp(min=0)
    may_slide = relations.remembered[scene, pair] & ~relations.known[scene, pair] & (gap < SLIDER_REACH)
    return (pairs.pair >= 0) & ((relations.kind[scene, pair] > 0) | may_slide)


def _contacts(state: State, control: Control, pairs: _Pairs) -> Contact:
    scenes, poses, scene = state.scenes, state.poses, pairs.scene
    is_tool = pairs.part >= 0
    second, part = pairs.second.clamp(min=0), pairs.part.clamp(min=0)
    pose_world_from_part = pose.compose(control.pose[scene], scenes.pose_tool_from_part[scene, part].to(poses.dtype))
    pose_world_from_other = torch.where(is_tool[:, None], pose_world_from_part, poses[scene, second])
    boxes, parts = scenes.boxes, scenes.parts
    return contact_between(
        RoundedBox(boxes.half_extents[scene, pairs.first], boxes.radius[scene, pairs.first]),
        RoundedBox(
            torch.where(is_tool[:, None], parts.half_extents[scene, part], boxes.half_extents[scene, second]),
            torch.where(is_tool, parts.radius[scene, part], boxes.radius[scene, second]),
        ),
        pose.relative(poses[scene, pairs.first], pose_world_from_other).float(),
    )
