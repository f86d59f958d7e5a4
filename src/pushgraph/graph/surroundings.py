"""Object-centric images: what each body has around itself, drawn on two grids in its own frame.

The representation of scenes that the paper compares graphs with (section on multiple parts). Shapes are drawn as signed
distances, which tell where a surface is more finely than the grid: each pixel holds how far it is from the nearest
surface of a kind, negative inside.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.contact import RoundedBox
from pushgraph.graph.broad_phase import LEVER, node_poses, node_shapes, part_motions, tool_travel
from pushgraph.graph.pieces import piece_index
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.state import Control, State

PIXELS = 24
"""Along each side of an image."""
NARROW, WIDE = 0.12, 0.36
"""Half the sides of the two images (m)."""
BLUR = 0.2
"""Distances beyond this share of half the side look alike."""
SHAPES = ("own", "none", "fixed", "prismatic", "revolute", "tool")
"""What a body sees: itself, the others by their joints to it, the tool."""
FIELDS = ("motion_x", "motion_y", "control_x", "control_y")
"""What moved how in the frame before, and what the tool does in this one, each drawn where it is."""
CHANNELS = tuple(f"{size}_{name}" for size in ("narrow", "wide") for name in (*SHAPES, *FIELDS))
VECTOR = (
    *("half_x", "half_y", "radius", "motion_x", "motion_y", "motion_yaw"),
    *("tool_x", "tool_y", "tool_sin_yaw", "tool_cos_yaw", "control_x", "control_y", "control_yaw"),
)
"""What is told of a body beside its images."""
CONSTANTS = {"pixels": PIXELS, "narrow": NARROW, "wide": WIDE, "blur": BLUR, "lever": LEVER}


class Surroundings(NamedTuple):
    """Images of all bodies there are, of scenes in which the tool moves. slot: which of [batch * bodies] each is.

    length: how far the fastest point of the tool goes in the step (m), the unit of motions.
    """

    images: Float[Tensor, "seen channels pixels pixels"]
    vectors: Float[Tensor, "seen vector"]
    slot: Int[Tensor, " seen"]
    length: Float[Tensor, " seen"]


def surroundings(state: State, control: Control) -> Surroundings:
    """Draw what the bodies see at the start of a step."""
    scenes = state.scenes
    bodies = state.poses.shape[1]
    travel = tool_travel(state, control).float()
    scene, body = (scenes.present & ~scenes.immovable & (travel > 0)[:, None]).nonzero(as_tuple=True)
    length = travel[scene]
    nodes = node_poses(state, control)
    place = pose.relative(nodes[scene, body][:, None], nodes[scene]).float()
    shapes = RoundedBox(*(values[scene].float() for values in node_shapes(scenes)))
    yaw = state.poses[scene, body, 2].float()

    motions = torch.cat((state.motions, part_motions(state, control, control.last_motion)), 1)
    steer = torch.cat((torch.zeros_like(state.motions), part_motions(state, control, control.motion)), 1)
    moved, steered = (
        pose.rotate(values[scene, :, :2].float(), -yaw[:, None]) / length[:, None, None] for values in (motions, steer)
    )
    kinds = _kinds(state, bodies)[scene, body]
    there = torch.cat((scenes.present, scenes.part_present & control.down[:, None]), 1)[scene]
    images = [_drawn(place, shapes, kinds, there, moved, steered, half) for half in (NARROW, WIDE)]

    tool = pose.relative(nodes[scene, body], control.pose[scene]).float()
    turn = state.motions[scene, body, 2:].float() * LEVER / length[:, None]
    control_own = pose.rotate(control.motion[scene, :2].float(), -yaw) / length[:, None]
    sizes = torch.cat((scenes.boxes.half_extents, scenes.boxes.radius[..., None]), -1)[scene, body]
    vectors = torch.cat(
        (
            sizes.float() / NARROW,
            moved[torch.arange(len(body), device=body.device), body],
            turn,
            tool[:, :2] / WIDE,
            torch.stack((tool[:, 2].sin(), tool[:, 2].cos()), -1),
            control_own,
            control.motion[scene, 2:].float() * LEVER / length[:, None],
        ),
        -1,
    )
    return Surroundings(torch.cat(images, 1), vectors, scene * bodies + body, length)


def _kinds(state: State, bodies: int) -> Tensor:
    """[batch, bodies, nodes]: as which of SHAPES a node is drawn for a body."""
    relations = state.relations
    batch, parts = len(state.poses), state.scenes.parts.radius.shape[1]
    kind = state.poses.new_full((batch, bodies, bodies + parts), SHAPES.index("tool"), dtype=torch.long)
    a, b = pairs_of(bodies, state.poses.device)
    codes = torch.tensor([SHAPES.index(name) for name in JOINT_CODES], device=state.poses.device)
    kind[:, a, b] = kind[:, b, a] = codes[relations.kind]
    piece = piece_index(state.scenes, relations)
    kind[:, :, :bodies][piece[:, :, None] == piece[:, None]] = SHAPES.index("fixed")
    each = torch.arange(bodies, device=state.poses.device)
    kind[:, each, each] = SHAPES.index("own")
    return kind


def _drawn(
    place: Float[Tensor, "seen nodes 3"],
    shapes: RoundedBox,
    kinds: Tensor,
    there: Bool[Tensor, "seen nodes"],
    moved: Float[Tensor, "seen nodes 2"],
    steered: Float[Tensor, "seen nodes 2"],
    half: float,
) -> Float[Tensor, "seen channels pixels pixels"]:
    blur = BLUR * half
    reach = 2**0.5 * half + blur + shapes.half_extents.norm(dim=-1) + shapes.radius
    seer, node = (there & (place[..., :2].norm(dim=-1) < reach)).nonzero(as_tuple=True)
    pixel = torch.arange(PIXELS, device=place.device) + 0.5
    grid = torch.cartesian_prod(pixel, pixel).flip(-1) * (2 * half / PIXELS) - half
    origin = place[seer, node]
    points = pose.rotate(grid - origin[:, None, :2], -origin[:, 2:])
    beyond = points.abs() - shapes.half_extents[seer, node][:, None]
    outside = beyond.clamp(min=0).norm(dim=-1) + beyond.amax(-1).clamp(max=0)
    shade = ((outside - shapes.radius[seer, node][:, None]) / blur).clamp(-1, 1)
    count = len(place)
    row = seer * len(SHAPES) + kinds[seer, node]
    images = shade.new_ones(count * len(SHAPES), len(grid))
    images = images.scatter_reduce(0, row[:, None].expand(shade.shape), shade, "amin")
    images = images.view(count, len(SHAPES), len(grid))
    fields = shade.new_zeros(count, len(FIELDS), len(grid))
    vectors = torch.cat((moved[seer, node], steered[seer, node]), -1)
    moves = (vectors != 0).any(-1)
    painted = vectors[moves][..., None] * (1 - shade[moves])[:, None] / 2
    fields = fields.index_add(0, seer[moves], painted)
    return torch.cat((1 - images, fields), 1).unflatten(-1, (PIXELS, PIXELS))
