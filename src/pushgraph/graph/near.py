"""Which pairs may touch in a frame, and which of them a chain of pairs ties to the tool."""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.contact import Contact, RoundedBox, contact_between
from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import SceneBatch, pairs_with_parts
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
    """Pairs of bodies first < second, or of a body and a part of the tool, counted after the bodies.

    pair: where the two stand in `pairs_with_parts`. pieces: of both, as rows of [batch * (bodies + 1)], the tool being
    the last of a scene. poses: of both, in the world. contact: in the frame of the first. fade: from 1 to 0 where the
    gap is about to be too wide; 1 for pairs that are joined, or may be.
    """

    scene: Int[Tensor, " pairs"]
    pair: Int[Tensor, " pairs"]
    first: Int[Tensor, " pairs"]
    second: Int[Tensor, " pairs"]
    is_tool: Bool[Tensor, " pairs"]
    pieces: Int[Tensor, "2 pairs"]
    poses: Float[Tensor, "2 pairs 3"]
    contact: Contact
    fade: Float[Tensor, " pairs"]


class Reach(NamedTuple):
    """What the tool can reach in a frame, by the circles around bodies and parts, which are cheaper than their shapes.

    index: piece of each body. step: how far each tool moves (m). pairs: those that a chain of pairs ties to the tool,
    in columns scene, pair, first, second and the pieces of both, as in Near. keep: up to which gap (m) each of them
    keeps its edge, whatever the step. pieces: that such chains reach, the tool's being the last.
    """

    index: Int[Tensor, "batch bodies"]
    step: Float[Tensor, " batch"]
    poses: Float[Tensor, "batch nodes 3"]
    shapes: RoundedBox  # [batch nodes]
    pairs: Int[Tensor, "6 pairs"]
    keep: Float[Tensor, " pairs"]
    pieces: Bool[Tensor, "batch pieces"]

    @property
    def may_move(self) -> Bool[Tensor, "batch bodies"]:
        """Bodies that the tool can reach, through others or joints that may be; the rest stays put."""
        return self.pieces.gather(1, self.index)


def near_pairs(reach: Reach) -> Near:
    """Pairs that share an edge in the frame."""
    columns = reach.pairs
    scene, ends, pieces = columns[0], columns[2:4], columns[4:]
    rows = (ends + scene * reach.poses.shape[1]).flatten()
    poses, half_extents, radius = (
        values.flatten(0, 1).index_select(0, rows).unflatten(0, (2, -1)) for values in (reach.poses, *reach.shapes)
    )
    boxes = (RoundedBox(half_extents[end], radius[end]) for end in range(2))
    contact = contact_between(*boxes, pose.relative(*poses).float())
    widest = MARGIN + STEPS_OF_REACH * reach.step.index_select(0, scene)
    fade = ((widest - contact.gap) / (widest / 3)).clamp(0, 1)
    fade = torch.where(contact.gap < reach.keep, 1.0, fade)
    tied = _tied_to_tool(pieces, reach.index, fade > 0)[0]
    columns = columns.index_select(1, tied)
    scene, pair, first, second, _, _ = columns.unbind()
    return Near(
        scene=scene,
        pair=pair,
        first=first,
        second=second,
        is_tool=second >= reach.index.shape[1],
        pieces=columns[4:],
        poses=poses.index_select(1, tied),
        contact=Contact(*(values.index_select(0, tied) for values in contact)),
        fade=fade.index_select(0, tied),
    )


def within_reach(state: State, control: Control) -> Reach:
    """What the tool can reach in this frame; joined pairs belong together however far apart."""
    scenes, relations = state.scenes, state.relations
    index, step = piece_index(scenes, relations), tool_step(state, control)
    poses, shapes = node_poses(state, control), node_shapes(scenes)
    bodies, nodes = index.shape[1], poses.shape[1]
    moves = torch.cat((scenes.present, scenes.part_present), 1) & (step > STILL)[:, None]
    # What is not there, and a scene whose tool rests, is infinitely far from everything.
    circle = torch.where(moves, shapes.half_extents.norm(dim=-1) + shapes.radius, -torch.inf)
    piece = functional.pad(index, (0, nodes - bodies), value=bodies)
    apart = (poses[:, None, :, :2] - poses[:, :bodies, None, :2]).norm(dim=-1)
    apart = apart - (circle[:, None] + circle[:, :bodies, None])
    apart = torch.where(piece[:, None] == index[:, :, None], torch.inf, apart)
    first, second = both = pairs_with_parts(bodies, nodes - bodies, index.device)
    gap = apart.flatten(1).index_select(1, first * nodes + second)

    may_slide = torch.where(relations.remembered & ~relations.known, SLIDER_REACH, -torch.inf)
    keep = torch.where(relations.kind > 0, torch.inf, may_slide)
    keep = functional.pad(keep, (0, len(first) - keep.shape[1]), value=-torch.inf)
    scene, pair = (gap < keep.clamp(min=(MARGIN + STEPS_OF_REACH * step)[:, None])).nonzero(as_tuple=True)
    ends = both.index_select(1, pair)
    pieces = piece.flatten().index_select(0, (ends + scene * nodes).flatten()).view(2, -1) + scene * (bodies + 1)
    tied, reached = _tied_to_tool(pieces, index)
    pairs = torch.cat((torch.stack((scene, pair)), ends, pieces)).index_select(1, tied)
    keep = keep.flatten().index_select(0, pairs[0] * len(first) + pairs[1])
    return Reach(index, step, poses, shapes, pairs, keep, reached)


def tool_step(state: State, control: Control) -> Float[Tensor, " batch"]:
    """How far the tool moves in the frame (m), its farthest point's turning included; zero while it is lifted."""
    step = control.motion[:, :2].norm(dim=-1) + control.motion[:, 2].abs() * state.scenes.reach
    return torch.where(control.down, step, 0.0).float()


def node_poses(state: State, control: Control) -> Float[Tensor, "batch nodes 3"]:
    """Poses of all bodies, then of the tool's parts, in the world."""
    parts = state.scenes.pose_tool_from_part.to(state.poses.dtype)
    return torch.cat((state.poses, pose.compose(control.pose[:, None], parts)), 1)


def node_shapes(scenes: SceneBatch) -> RoundedBox:
    """Shapes of all bodies, then of the tool's parts, [batch nodes]."""
    return RoundedBox(*(torch.cat(both, 1) for both in zip(scenes.boxes, scenes.parts, strict=True)))


def _tied_to_tool(
    pieces: Tensor, index: Tensor, shares: Tensor | None = None
) -> tuple[Int[Tensor, " tied"], Bool[Tensor, "batch pieces"]]:
    """Places of the pairs that a chain of pairs, all of which share an edge, ties to the tool; and what it reaches."""
    reached = functional.pad(torch.zeros_like(index), (0, 1), value=1)
    sharing = pieces if shares is None else pieces[:, shares]
    here, there = sharing.flatten(), sharing.flip(0).flatten()
    flat, before = reached.flatten(), None
    while before is None or not torch.equal(flat, before):
        flat, before = flat.index_add(0, here, flat.index_select(0, there)).clamp_(max=1), flat
    tied = flat.index_select(0, pieces[0])
    tied = tied if shares is None else tied * shares
    return tied.nonzero().squeeze(-1), flat.view_as(reached) > 0
