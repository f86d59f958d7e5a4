"""What a predicted track tells about how far off it may be: features of its bodies and how they were coupled.

Nothing changes if the scene is moved, turned or seen in a mirror. Nodes are the bodies, then the parts of the tool.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.joint_truth import closed, rigid_pairs
from pushgraph.graph.scene_batch import JOINT_CODES, Relations, SceneBatch, pairs_of

FRAMES_APART = 4
"""Features are computed in every fourth frame, and in the last."""
NEAR = 0.01
"""Closeness falls to 1 / e over this gap (m)."""
LEAST_LENGTH = 1e-4
"""Logarithms of lengths end here (m)."""
DOUBT_OF_UNKNOWN = 0.5
"""Probability that a neighbour of which nothing is known is joined, where no belief says better."""

FEATURES = (
    *("path", "displacement", "turning", "turn", "motion_around", "way_of_tool", "touched_by_tool", "touching"),
    *("tool_near", "tool_was_near", "others_near", "moving", "straightness", "pace", "frames", "size", "slenderness"),
    *("turning_now", "faster_or_slower", "with_tool", "slipping_on_tool", "slipping_on_others", "slipped", "touches"),
    *("mass", "table_friction", "side_friction", "cylinder", "tool", "immovable"),
    *("mass_unknown", "table_friction_unknown", "side_friction_unknown", "doubt", "moved_at_start", "doubt_of_many"),
)
"""Of every node. doubt_of_many: doubt by the logarithm of how many bodies there are; among few, more are joined."""
COUPLINGS = ("rigid", "jointed", "near", "worked", "slipping", "doubted")
"""Between nodes: joined rigidly, or by hinge or slider; near each other now; moved while near, as a share of the motion
around; slipping on each other now, as a share of the tool's pace; and how probable it is that what the prediction takes
for the joint is wrong, if they were ever near."""
CONSTANTS = {"FRAMES_APART": FRAMES_APART, "NEAR": NEAR, "LEAST_LENGTH": LEAST_LENGTH}


class TrackFeatures(NamedTuple):
    """Features at the knots, frames of a track. couplings: from the second node on the first.

    direction: the way each body has gone, in the world (rad). around: how far it and what was near it have moved (m),
    zero for what cannot move. lever: distance at which a body's yaw counts (m). farthest: bound of its error (m).
    moved: how far every node went and turned since the knot before (m).
    """

    knots: Int[Tensor, " knots"]
    nodes: Float[Tensor, "batch knots nodes features"]
    couplings: Float[Tensor, "batch knots nodes nodes couplings"]
    direction: Float[Tensor, "batch knots bodies"]
    around: Float[Tensor, "batch knots bodies"]
    lever: Float[Tensor, "batch bodies"]
    farthest: Float[Tensor, "batch knots bodies"]
    moved: Float[Tensor, "batch knots nodes"]


def doubt_of(
    scenes: SceneBatch, relations: Relations, probabilities: Float[Tensor, "batch pairs joints"]
) -> Float[Tensor, "batch pairs"]:
    """Probability that what a prediction takes for the joint of a pair is wrong, given those of all joints.

    All pairs within a rigid piece count as fixed.
    """
    kind = closed(scenes._replace(relations=relations), relations.kind)
    return 1 - probabilities.gather(-1, kind[..., None]).squeeze(-1)


def default_doubt(relations: Relations) -> Float[Tensor, "batch pairs"]:
    """The doubt where no belief was given: none, but about unknown neighbours."""
    unknown = relations.remembered & ~relations.known
    return DOUBT_OF_UNKNOWN * unknown.float()


def track_features(
    scenes: SceneBatch,
    relations: Relations,
    poses: Float[Tensor, "batch frames bodies 3"],
    tool: Float[Tensor, "batch frames 3"],
    down: Bool[Tensor, "batch frames"],
    doubt: Float[Tensor, "batch pairs"],
    first_motion: Float[Tensor, "batch bodies 3"],
) -> TrackFeatures:
    """Features of predicted tracks. first_motion: how bodies moved in the frame before the first."""
    frames, bodies = poses.shape[1:3]
    knots = torch.arange(0, frames, FRAMES_APART, device=poses.device)
    if int(knots[-1]) != frames - 1:
        knots = torch.cat((knots, knots.new_tensor([frames - 1])))
    origin = tool[:, None, :1] * tool.new_tensor([1.0, 1.0, 0.0])
    parts = pose.compose(tool[:, knots, None], scenes.pose_tool_from_part[:, None].to(tool.dtype))
    nodes = (torch.cat((poses[:, knots], parts.to(poses.dtype)), 2) - origin).float()
    down = down[:, knots]
    is_tool = torch.arange(nodes.shape[2], device=poses.device) >= bodies
    present = torch.cat((scenes.present, scenes.part_present), 1)
    half_extents = torch.cat((scenes.boxes.half_extents, scenes.parts.half_extents), 1).float()
    radius = torch.cat((scenes.boxes.radius, scenes.parts.radius), 1).float()
    size = (radius.square() / 2 + half_extents.square().sum(-1) / 3).sqrt().clamp(min=LEAST_LENGTH)

    steps = nodes.diff(dim=1, prepend=nodes[:, :1])
    there = present[:, None] & ~(is_tool & ~down[..., None])
    lifted = is_tool & ~(down & torch.cat((down[:, :1], down[:, :-1]), 1))[..., None]
    way = steps[..., :2].norm(dim=-1).masked_fill(lifted, 0.0)
    turn = (steps[..., 2].abs() * size[:, None]).masked_fill(lifted, 0.0)
    moved = way + turn
    gone = nodes - nodes[:, :1]
    path, turning, displacement = way.cumsum(1), turn.cumsum(1), gone[..., :2].norm(dim=-1)

    apart = ~torch.eye(len(is_tool), dtype=torch.bool, device=poses.device) & ~(is_tool[:, None] & is_tool)
    near = (-_gaps(nodes, half_extents, radius).clamp(min=0) / NEAR).exp()
    near = near * (there[..., :, None] & there[..., None, :] & apart)
    was_near = near.cummax(1).values
    worked = (near * (moved[..., :, None] + moved[..., None, :])).cumsum(1)
    slip = near * _slips(nodes, steps, lifted)
    around = path + turning + worked.sum(-1)

    tools = is_tool.float()
    touched_by_tool = worked @ tools
    way_of_tool = path[..., bodies:].amax(-1, keepdim=True)
    pace = moved[..., bodies:].amax(-1, keepdim=True)
    change = moved.diff(dim=1, prepend=moved[:, :1]) / (moved + pace + LEAST_LENGTH)
    drive = steps[:, :, bodies : bodies + 1, :2] * ~lifted[..., bodies : bodies + 1, None]
    with_tool = (steps[..., :2] * drive).sum(-1) / (way * pace + LEAST_LENGTH**2)
    touches = near.diff(dim=1, prepend=near[:, :1]).abs().sum(-1).cumsum(1)
    doubted = _between(doubt.float(), len(is_tool), bodies)[:, None] * was_near
    rigid, jointed = _joints(scenes, relations, len(is_tool))
    frame = knots.float()[None, :, None]
    longest, shortest = (extent + radius + LEAST_LENGTH for extent in (half_extents.amax(-1), half_extents.amin(-1)))
    slenderness = longest / shortest

    def log(length: Tensor) -> Tensor:
        return (length + LEAST_LENGTH).log() / 3 + 1.5

    def of_scene(values: Tensor) -> Tensor:
        return values.float()[:, None, None]

    def of_bodies(values: Tensor, of_tool: float = 0.0) -> Tensor:
        return torch.cat((values.float(), values.new_full(radius[:, bodies:].shape, of_tool).float()), 1)[:, None]

    columns = (
        log(path),
        log(displacement),
        log(turning),
        log((gone[..., 2].abs() * size[:, None]).masked_fill(is_tool, 0.0)),
        log(around),
        log(way_of_tool),
        log(touched_by_tool),
        log(worked.sum(-1) - touched_by_tool),
        (near * tools).amax(-1),
        (was_near * tools).amax(-1),
        (near * (1 - tools)).sum(-1),
        moved / (moved + pace + LEAST_LENGTH),
        (displacement / (path + LEAST_LENGTH)).clamp(max=1.0),
        log(pace.cummax(1).values),
        (1 + frame).log() / 2 - 1.5,
        (size.log() / 2 + 1.5)[:, None],
        slenderness.log()[:, None],
        turn / (moved + pace + LEAST_LENGTH),
        change,
        with_tool.clamp(-1.5, 1.5),
        (slip @ tools) / (pace + LEAST_LENGTH),
        (slip @ (1 - tools)) / (pace + LEAST_LENGTH),
        log(slip.sum(-1).cumsum(1)),
        touches.log1p(),
        of_bodies(scenes.mass.clamp(max=20.0).log()),
        of_scene(scenes.table_friction.log()) + 1,
        of_scene(scenes.side_friction),
        of_bodies(scenes.is_cylinder),
        tools,
        of_bodies(scenes.immovable),
        of_bodies(~scenes.mass_known),
        of_scene(~scenes.table_friction_known),
        of_scene(~scenes.side_friction_known),
        doubted.sum(-1),
        of_bodies((first_motion[..., :2].norm(dim=-1) * 100).clamp(max=3.0)),
        doubted.sum(-1) * of_scene(scenes.present.sum(1).log() - 2),
    )
    batch, count = nodes.shape[:2]
    features = torch.stack([column.expand(batch, count, len(is_tool)) for column in columns], -1)
    couplings = torch.stack(
        (
            rigid[:, None].expand_as(near),
            jointed[:, None].expand_as(near),
            near,
            worked / (around[..., None] + LEAST_LENGTH),
            slip / (pace[..., None] + LEAST_LENGTH),
            doubted,
        ),
        -1,
    )
    movable = ~scenes.immovable[:, None]
    own = slice(None, bodies)
    return TrackFeatures(
        knots=knots,
        nodes=features,
        couplings=couplings,
        direction=_direction(nodes, is_tool, bodies),
        around=around[..., own] * movable,
        lever=size[:, own],
        farthest=displacement[..., own] + 2 * way_of_tool + 2 * LEAST_LENGTH,
        moved=moved,
    )


def _direction(nodes: Float[Tensor, "batch knots nodes 3"], is_tool: Tensor, bodies: int) -> Tensor:
    """The way each body has gone; that of the tool, where a body has gone none."""
    gone = (nodes - nodes[:, :1])[..., :2]
    own = gone[:, :, :bodies]
    still = own.norm(dim=-1, keepdim=True) < LEAST_LENGTH
    chosen = torch.where(still, gone[:, :, bodies : bodies + 1], own)
    return torch.atan2(chosen[..., 1], chosen[..., 0])


def _gaps(
    nodes: Float[Tensor, "batch knots nodes 3"],
    half_extents: Float[Tensor, "batch nodes 2"],
    radius: Float[Tensor, "batch nodes"],
) -> Float[Tensor, "batch knots nodes nodes"]:
    """How far nodes stand apart along the normals of their faces and the line of their centres, whichever is most.

    That is the gap of the two shapes, or less where two corners are nearest.
    """
    x, y, yaw = nodes.unbind(-1)
    x, y, turn = (values[..., None, :] - values[..., :, None] for values in (x, y, yaw))
    cos, sin = yaw.cos()[..., None], yaw.sin()[..., None]
    own_x, own_y = cos * x + sin * y, cos * y - sin * x
    cos, sin = turn.cos().abs(), turn.sin().abs()
    half_x, half_y = half_extents[:, None].unbind(-1)
    other_x, other_y = half_x[..., None, :], half_y[..., None, :]
    half_x, half_y = half_x[..., None], half_y[..., None]
    by_x = own_x.abs() - half_x - cos * other_x - sin * other_y
    by_y = own_y.abs() - half_y - sin * other_x - cos * other_y
    by_face = torch.maximum(by_x, by_y)
    distance = (x.square() + y.square() + 1e-12).sqrt()
    reach = (half_x * own_x.abs() + half_y * own_y.abs()) / distance  # of the first, along the line of centres
    by_centre = distance - reach - reach.transpose(-1, -2)
    apart = torch.maximum(torch.maximum(by_face, by_face.transpose(-1, -2)), by_centre)
    return apart - (radius[:, :, None] + radius[:, None, :])[:, None]


def _slips(
    nodes: Float[Tensor, "batch knots nodes 3"],
    steps: Float[Tensor, "batch knots nodes 3"],
    lifted: Bool[Tensor, "batch knots nodes"],
) -> Float[Tensor, "batch knots nodes nodes"]:
    """How far nodes move against each other between two knots, half-way between their centres (m)."""
    steps = steps.masked_fill(lifted[..., None], 0.0)
    x, y, _ = nodes.unbind(-1)
    step_x, step_y, turn = steps.unbind(-1)
    half_x, half_y = ((values[..., None, :] - values[..., :, None]) / 2 for values in (x, y))
    turns = turn[..., None, :] + turn[..., :, None]  # the arms to the middle are opposite
    slip_x = step_x[..., None, :] - step_x[..., :, None] + turns * half_y
    slip_y = step_y[..., None, :] - step_y[..., :, None] - turns * half_x
    return (slip_x.square() + slip_y.square() + 1e-12).sqrt()


def _between(values: Float[Tensor, "batch pairs"], nodes: int, bodies: int) -> Float[Tensor, "batch nodes nodes"]:
    """Values of pairs of bodies as a symmetric matrix over all nodes."""
    a, b = pairs_of(bodies, values.device)
    matrix = values.new_zeros(len(values), nodes, nodes)
    matrix[:, a, b] = values
    matrix[:, b, a] = values
    return matrix


def _joints(scenes: SceneBatch, relations: Relations, nodes: int) -> tuple[Tensor, Tensor]:
    """Which nodes are joined rigidly, and which by hinge or slider."""
    fixed = (relations.kind == JOINT_CODES["fixed"]) | rigid_pairs(scenes.group)
    bodies = scenes.mass.shape[1]
    jointed = (relations.kind > 0) & ~fixed
    return _between(fixed.float(), nodes, bodies), _between(jointed.float(), nodes, bodies)
