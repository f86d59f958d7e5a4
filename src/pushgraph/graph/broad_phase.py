"""Broad phase: which pairs may touch in a step, and which of them a chain of pairs ties to something that moves.

Circles around bodies and parts of the tool stand for their shapes here. So what a step costs depends on what may move
in it, and not on how many bodies lie on the table.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.contact import RoundedBox
from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import SceneBatch, pairs_with_parts
from pushgraph.graph.state import STILL, Control, State

MARGIN = 0.003
"""Gap (m) beyond what two pieces may move in a step at which they still share an edge."""
LENGTHS_CLOSED = 2.0
"""What two pieces may close in one step, in lengths of the step."""
SLIDER_GAP = 0.12
"""A pair that may be joined keeps its edge up to this gap (m)."""
LEVER = 0.05
"""Turns by an angle count as this arm (m) times the angle."""


class Reachable(NamedTuple):
    """What may move in a step: what a chain of pairs ties to a tool that moves, or to a body that still slides.

    piece: the piece of each body. length: how far the fastest point of tool and bodies goes in the step (m); zero where
    all is at rest. poses, shapes: of all bodies, then of the tool's parts. widest: gap (m) up to which pairs share an
    edge. Of each pair: scene; pair, its place in `pairs_with_parts`; first, second, its bodies, the tool's parts
    counting on from them; slots, those of both pieces. keep: gap (m) up to which the pair shares an edge
    whatever the step. A piece's slot is that of its first body in [batch, bodies + 1], the tool's its scene's last.
    pieces: which may move; moving: which move already; immovable: which cannot.
    """

    piece: Int[Tensor, "batch bodies"]
    length: Float[Tensor, " batch"]
    poses: Float[Tensor, "batch nodes 3"]
    shapes: RoundedBox  # [batch nodes]
    widest: Float[Tensor, " batch"]
    scene: Int[Tensor, " pairs"]
    pair: Int[Tensor, " pairs"]
    first: Int[Tensor, " pairs"]
    second: Int[Tensor, " pairs"]
    slots: Int[Tensor, "2 pairs"]
    keep: Float[Tensor, " pairs"]
    pieces: Bool[Tensor, "batch slots"]
    moving: Bool[Tensor, "batch slots"]
    immovable: Bool[Tensor, "batch slots"]

    @property
    def may_move(self) -> Bool[Tensor, "batch bodies"]:
        """Bodies that may move; the rest stays put."""
        return self.pieces.gather(1, self.piece)


def reachable(state: State, control: Control) -> Reachable:
    """Find what may move in a step, in float64; joined pairs belong together however far apart."""
    state, control = state.double(), control.double()
    scenes, relations = state.scenes, state.relations
    piece = piece_index(scenes, relations)
    tool = tool_travel(state, control)
    speed = state.motions[..., :2].norm(dim=-1) + LEVER * state.motions[..., 2].abs()
    slides = (speed > state.still) & scenes.present & ~scenes.immovable
    length = torch.maximum(tool, torch.where(slides, speed, 0.0).amax(1) * control.frames)
    poses, shapes = node_poses(state, control), node_shapes(scenes)
    bodies, nodes = piece.shape[1], poses.shape[1]
    parts_down = scenes.part_present & (tool > STILL)[:, None]
    there = torch.cat((scenes.present, parts_down), 1) & (length > 0)[:, None]
    # What is not there, and a scene in which nothing moves, is infinitely far from everything.
    circle = torch.where(there, shapes.half_extents.norm(dim=-1) + shapes.radius, -torch.inf)
    owner = functional.pad(piece, (0, nodes - bodies), value=bodies)
    apart = (poses[:, None, :, :2] - poses[:, :bodies, None, :2]).norm(dim=-1)
    apart = apart - (circle[:, None] + circle[:, :bodies, None])
    apart = torch.where(owner[:, None] == piece[:, :, None], torch.inf, apart)
    first, second = ends_of = pairs_with_parts(bodies, nodes - bodies, piece.device)
    gap = apart.flatten(1).index_select(1, first * nodes + second)

    may_slide = torch.where(relations.remembered & ~relations.known, SLIDER_GAP, -torch.inf)
    keep = torch.where(relations.kind > 0, torch.inf, may_slide)
    keep = functional.pad(keep, (0, len(first) - keep.shape[1]), value=-torch.inf)
    widest = MARGIN + LENGTHS_CLOSED * length
    scene, pair = (gap < torch.maximum(keep, widest[:, None])).nonzero(as_tuple=True)
    ends = ends_of.index_select(1, pair)
    slots = owner.flatten().index_select(0, (ends + scene * nodes).flatten()).view(2, -1) + scene * (bodies + 1)
    moving = torch.zeros_like(piece).scatter_reduce(1, piece, slides.long(), "amax")
    moving = torch.cat((moving, (tool > STILL).long()[:, None]), 1) * (length > 0)[:, None]
    immovable = torch.zeros_like(piece).scatter_reduce(1, piece, scenes.immovable.long(), "amax")
    immovable = functional.pad(immovable, (0, 1)) > 0
    tied, pieces = tied_to(moving, slots, immovable.flatten())
    scene, pair, first, second, slots = scene[tied], pair[tied], *ends[:, tied], slots[:, tied]
    keep = keep.flatten().index_select(0, scene * len(ends_of[0]) + pair)
    return Reachable(
        piece, length, poses, shapes, widest, scene, pair, first, second, slots, keep, pieces, moving > 0, immovable
    )


def tool_travel(state: State, control: Control) -> Float[Tensor, " batch"]:
    """How far the tool moves in the step (m), its farthest point's turning included; zero while it is lifted."""
    travel = control.motion[:, :2].norm(dim=-1) + control.motion[:, 2].abs() * state.scenes.tool_radius
    return torch.where(control.down, travel, 0.0)


def node_poses(state: State, control: Control) -> Float[Tensor, "batch nodes 3"]:
    """Poses of all bodies, then of the tool's parts, in the world."""
    parts = state.scenes.pose_tool_from_part.to(state.poses.dtype)
    return torch.cat((state.poses, pose.compose(control.pose[:, None], parts)), 1)


def part_motions(state: State, control: Control, motion: Float[Tensor, "batch 3"]) -> Float[Tensor, "batch parts 3"]:
    """How the tool's parts move where the tool moves so, in the world: x, y (m), yaw (rad)."""
    arm = node_poses(state, control)[:, state.poses.shape[1] :, :2] - control.pose[:, None, :2]
    swing = pose.rotate(arm, motion[:, None, 2].expand(arm.shape[:2])) - arm
    turn = motion[:, None, 2:].expand(*arm.shape[:2], 1)
    return torch.cat((motion[:, None, :2] + swing, turn), -1)


def node_shapes(scenes: SceneBatch) -> RoundedBox:
    """Shapes of all bodies, then of the tool's parts, [batch nodes]."""
    return RoundedBox(*(torch.cat(ends, 1) for ends in zip(scenes.boxes, scenes.parts, strict=True)))


def tied_to(
    moving: Int[Tensor, "batch slots"],
    slots: Int[Tensor, "2 pairs"],
    barrier: Bool[Tensor, " all_slots"],
    sharing: Bool[Tensor, " pairs"] | None = None,
) -> tuple[Int[Tensor, " tied"], Bool[Tensor, "batch slots"]]:
    """Places of the pairs that a chain of pairs ties to what moves, and what such chains reach.

    barrier: what cannot move; no chain goes on beyond it. sharing: the pairs that count, all by default.
    """
    links = slots if sharing is None else slots[:, sharing]
    here, there = links.flatten(), links.flip(0).flatten()
    passes = (~barrier.index_select(0, there)).to(moving.dtype)
    flat, before = moving.flatten(), None
    while before is None or not torch.equal(flat, before):
        flat, before = flat.index_add(0, here, flat.index_select(0, there) * passes).clamp_(max=1), flat
    onward = flat * (~barrier)
    tied = onward.index_select(0, slots.flatten()).view(2, -1).amax(0)
    tied = tied if sharing is None else tied * sharing
    return tied.nonzero().squeeze(-1), flat.view_as(moving) > 0
