"""The graph of one step: pieces that may move as nodes, what stands between them as contacts and joints.

Pushing looks alike at any speed and size of the step: so lengths are counted in lengths of the step (how far its
fastest point goes), turns as the length that they have at LEVER, lever arms in LEVER. Planar vectors are in world axes,
their two numbers first and the rows last.

The geometry is that of the middle of the step, where the last motion of each piece and the tool's own lead: then what
is linear in the motion is right to second order. Gaps, drifts and the like are what this geometry makes of the start.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.contact import Contact, RoundedBox, contact_between
from pushgraph.graph.broad_phase import LEVER, Reachable, reachable, tied_to
from pushgraph.graph.pieces import Pieces, gather_pieces, mean_motion
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.graph.state import Control, State
from pushgraph.track import FRAME

GRAVITY = 9.81
PASSED = 0.001
"""Where two pieces that close upon each other would lie deeper than this in the middle of the step (m), they have not
met yet, and their geometry is that of its start."""
TWINS = 0.007
"""Contacts of the same two nodes that are nearer to each other than this (m) count less: as one where they coincide."""
SAME_POINT = 1e-6
"""Contacts of a pair nearer to each other than this (m) are one."""


class Nodes(NamedTuple):
    """Pieces, and tools that move.

    scene: which of the batch. body: the piece's first body in [batch * bodies]. given: whether the motion is given, as
    that of what cannot move and of tools without a force limit. mass: as a share of all that may move in the scene, or
    of what the tool's force could push, if that is more. gyration: mean squared distance of the mass from its centre;
    both are 1 for tools and what cannot move. centre: world (m). step: length of the scene's step (m). inertia: how
    strongly mass resists another motion than the last, over the friction that it meets: step / (mu g t T), t: of this
    step, T: from the middle of the step before to that of this one. force: unit of forces, mu g times the mass that
    masses are shares of (N). last_twist: what the motion is if nothing acts, and what it is where it is given.
    """

    scene: Int[Tensor, " nodes"]
    body: Int[Tensor, " nodes"]
    is_tool: Bool[Tensor, " nodes"]
    given: Bool[Tensor, " nodes"]
    mass: Float[Tensor, " nodes"]
    gyration: Float[Tensor, " nodes"]
    centre: Float[Tensor, "nodes 2"]
    step: Float[Tensor, " nodes"]
    inertia: Float[Tensor, " nodes"]
    force: Float[Tensor, " nodes"]
    last_twist: Float[Tensor, "3 nodes"]


class Feet(NamedTuple):
    """Where free pieces press on the table. weight: as a share, as masses are; radius: friction radius. metric: xx, xy
    and yy of the matrix M that measures slides by d . M d, since friction may depend on their direction; see
    `friction_metric`."""

    node: Int[Tensor, " feet"]
    arm: Float[Tensor, "2 feet"]
    weight: Float[Tensor, " feet"]
    radius: Float[Tensor, " feet"]
    metric: Float[Tensor, "3 feet"]


class Edges(NamedTuple):
    """Pairs of bodies, or of a body and a part of the tool, that share an edge. first, second: nodes.

    relation: where the pair stands in [batch * pairs], -1 for those of the tool. fade: from 1 to 0 where the gap is
    about to be too wide; 1 for pairs that are joined, or may be.
    """

    scene: Int[Tensor, " edges"]
    first: Int[Tensor, " edges"]
    second: Int[Tensor, " edges"]
    first_body: Int[Tensor, " edges"]
    second_body: Int[Tensor, " edges"]
    relation: Int[Tensor, " edges"]
    is_tool: Bool[Tensor, " edges"]
    normal: Float[Tensor, "2 edges"]
    fade: Float[Tensor, " edges"]


class Points(NamedTuple):
    """Points that two nodes share: contacts, or anchors of joints. edge: whose they are. Arms from centres of mass."""

    edge: Int[Tensor, " points"]
    first: Int[Tensor, " points"]
    second: Int[Tensor, " points"]
    first_arm: Float[Tensor, "2 points"]
    second_arm: Float[Tensor, "2 points"]


class Contacts(NamedTuple):
    """Contacts. normal: from first to second. share: 1 over how many contacts of the same two nodes stand there."""

    points: Points
    normal: Float[Tensor, "2 contacts"]
    gap: Float[Tensor, " contacts"]
    friction: Float[Tensor, " contacts"]
    share: Float[Tensor, " contacts"]


class Joints(NamedTuple):
    """Hinges and sliders.

    drift: of the second's anchor from the first's. turn: of second against first, since the joint was made. axis: along
    which a slider slides, zero for a hinge. low, high: room left to the limits, of a turn or along the axis.
    """

    points: Points
    revolute: Bool[Tensor, " joints"]
    drift: Float[Tensor, "2 joints"]
    turn: Float[Tensor, " joints"]
    axis: Float[Tensor, "2 joints"]
    low: Float[Tensor, " joints"]
    high: Float[Tensor, " joints"]


class Drives(NamedTuple):
    """What drives tools with a force limit, which may lag along their motion. axis: the motion's direction. length: how
    far they are driven."""

    node: Int[Tensor, " drives"]
    axis: Float[Tensor, "2 drives"]
    length: Float[Tensor, " drives"]
    limit: Float[Tensor, " drives"]


class ContactGraph(NamedTuple):
    """One flat graph of many scenes."""

    nodes: Nodes
    feet: Feet
    edges: Edges
    contacts: Contacts
    joints: Joints
    drives: Drives
    pieces: Pieces


CONSTANTS = {"lever": LEVER, "passed": PASSED, "twins": TWINS}
"""What predictions depend on beside the features' names."""


def contact_graph(state: State, control: Control) -> ContactGraph:
    """Build the graph of one step, float64.

    Half of the digits are lost where light things and heavy ones, stiff ones and loose ones, meet.
    """
    state, control = state.double(), control.double()
    reach = reachable(state, control)
    scenes = state.scenes
    length = reach.length
    frames = torch.as_tensor(control.frames, dtype=length.dtype, device=length.device).expand_as(length)
    halfway = state.motions * (frames / 2)[:, None, None]
    halfway = halfway.masked_fill(scenes.immovable[..., None], 0.0)
    middle = state._replace(poses=state.poses + halfway)
    middle_control = control._replace(pose=control.pose + control.motion / 2)
    pairs = _narrow_phase(state, control, middle, middle_control, reach)

    pieces = gather_pieces(scenes, reach.piece, middle.poses)
    alone = reach.moving.flatten().nonzero().squeeze(-1)
    slot, place = torch.cat((pairs.slots.flatten(), alone)).unique(return_inverse=True)
    nodes = _nodes(state, middle_control, pieces, reach, frames, slot)
    first, second = place[: pairs.slots.numel()].view(2, -1)
    edges = _edges(pairs, reach, scenes.relations.kind.shape[1], first, second)
    return ContactGraph(
        nodes=nodes,
        feet=_feet(middle, reach, nodes, slot),
        edges=edges,
        contacts=_contacts(state, pairs, edges, nodes),
        joints=_joints(state, pairs, edges, nodes),
        drives=_drives(control, nodes),
        # Pieces move from where they start.
        pieces=gather_pieces(scenes, reach.piece, state.poses),
    )


class _Pairs(NamedTuple):
    """Pairs that share an edge, with their poses in the middle of the step or, where they meet in it, at its start."""

    scene: Tensor
    pair: Tensor
    first: Tensor
    second: Tensor
    slots: Tensor
    poses: Tensor
    contact: Contact
    at_start: Tensor
    fade: Tensor


def _narrow_phase(state: State, control: Control, middle: State, middle_control: Control, reach: Reachable) -> _Pairs:
    nodes = reach.poses.shape[1]
    parts = state.scenes.pose_tool_from_part.to(state.poses.dtype)
    middle_poses = torch.cat((middle.poses, pose.compose(middle_control.pose[:, None], parts)), 1)
    rows = (torch.stack((reach.first, reach.second)) + reach.scene * nodes).flatten()

    def of_ends(values: Tensor) -> Tensor:
        return values.flatten(0, 1).index_select(0, rows).unflatten(0, (2, -1))

    poses, start_poses = of_ends(middle_poses), of_ends(reach.poses)
    half_extents, radius = of_ends(reach.shapes.half_extents), of_ends(reach.shapes.radius)

    def touch(poses: Tensor, chosen: Tensor | slice) -> Contact:
        first, second = (RoundedBox(half_extents[end][chosen], radius[end][chosen]) for end in range(2))
        return contact_between(first, second, pose.relative(*poses))

    contact = touch(poses, slice(None))
    at_start = contact.gap < -PASSED
    deep = at_start.nonzero().squeeze(-1)
    if len(deep):
        poses = poses.index_copy(1, deep, start_poses[:, deep])
        again = touch(start_poses[:, deep], deep)
        contact = Contact(*(old.index_copy(0, deep, new) for old, new in zip(contact, again, strict=True)))
    widest = reach.widest.index_select(0, reach.scene)
    fade = ((widest - contact.gap) / (widest / 3)).clamp(0, 1)
    fade = torch.where(contact.gap < reach.keep, 1.0, fade)
    tied = tied_to(reach.moving.long(), reach.slots, reach.immovable.flatten(), fade > 0)[0]
    scene, pair, first, second, slots = (
        rows.index_select(-1, tied) for rows in (reach.scene, reach.pair, reach.first, reach.second, reach.slots)
    )
    return _Pairs(
        *(scene, pair, first, second, slots),
        poses=poses.index_select(1, tied),
        contact=Contact(*(values.index_select(0, tied) for values in contact)),
        at_start=at_start.index_select(0, tied),
        fade=fade.index_select(0, tied),
    )


def _nodes(
    state: State, control: Control, pieces: Pieces, reach: Reachable, frames: Tensor, slot: Int[Tensor, " nodes"]
) -> Nodes:
    scenes, bodies = state.scenes, reach.piece.shape[1]
    scene, piece = slot // (bodies + 1), slot % (bodies + 1)
    is_tool = piece == bodies
    body = scene * bodies + piece.clamp(max=bodies - 1)
    mass, gyration = (_rows(values, body) for values in (pieces.mass, pieces.gyration))
    limit = torch.as_tensor(control.force_limit, dtype=mass.dtype, device=mass.device).expand_as(reach.length)
    limited = limit.isfinite() & (control.motion[:, :2] != 0).any(-1)
    given = torch.where(is_tool, ~limited[scene], _rows(pieces.immovable, body))
    is_free = ~(given | is_tool)
    total = torch.zeros_like(reach.length).index_add(0, scene, torch.where(is_free, mass, 0.0))
    could_push = limit / (GRAVITY * scenes.table_friction)
    total = torch.where(limited, torch.maximum(total, could_push), total).clamp(min=1e-9).index_select(0, scene)
    last_frames = torch.as_tensor(control.last_frames, dtype=frames.dtype, device=frames.device).expand_as(frames)
    times = (reach.length, frames * FRAME, last_frames * FRAME)
    step, time, last_time = (values.index_select(0, scene) for values in times)
    unit = step.new_tensor([1.0, 1.0, LEVER])[:, None] / step
    last = _rows(mean_motion(scenes, reach.piece, state.motions), body) * frames.index_select(0, scene)[:, None]
    motion = control.motion.index_select(0, scene).t()
    friction = scenes.table_friction.index_select(0, scene)
    return Nodes(
        scene=scene,
        body=body,
        is_tool=is_tool,
        given=given,
        mass=torch.where(is_free, mass / total, 1.0),
        gyration=torch.where(is_free, gyration / LEVER**2, 1.0),
        centre=torch.where(is_tool[:, None], control.pose[scene, :2], _rows(pieces.centre, body)),
        step=step,
        inertia=step / (GRAVITY * friction * time * (time + last_time) / 2),
        force=GRAVITY * friction * total,
        last_twist=torch.where(is_tool, motion, torch.where(given, 0.0, last.t())) * unit,
    )


def _feet(middle: State, reach: Reachable, nodes: Nodes, slot: Tensor) -> Feet:
    scenes, (batch, bodies) = middle.scenes, reach.piece.shape
    node_of_slot = slot.new_full((batch * (bodies + 1),), -1)
    node_of_slot[slot] = torch.where(nodes.given, -1, torch.arange(len(slot), device=slot.device))
    slots = torch.arange(batch, device=slot.device)[:, None] * (bodies + 1) + reach.piece
    node = torch.where(scenes.present, node_of_slot[slots], -1).flatten()
    body = (node >= 0).nonzero().squeeze(-1)
    node = node[body]
    poses = middle.poses.flatten(0, 1)[body]
    points, shares, radii = (values.flatten(0, 1)[body] for values in scenes.feet)
    (x, y), (cos, sin) = points.unbind(-1), (f(poses[:, 2:]) for f in (torch.cos, torch.sin))
    centre = (poses[:, :2] - nodes.centre[node])
    arm = torch.stack((cos * x - sin * y + centre[:, :1], sin * x + cos * y + centre[:, 1:])) / LEVER
    own = scenes.mass.flatten()[body] / _rows_sum(nodes, scenes.mass.flatten()[body], node)
    weight = own[:, None] * nodes.mass[node][:, None] * shares
    node = node[:, None].expand(weight.shape).reshape(-1)
    metric = friction_metric(scenes.anisotropy.to(weight.dtype)).index_select(1, nodes.scene[node])
    return Feet(node, arm.reshape(2, -1), weight.reshape(-1), (radii / LEVER).reshape(-1), metric)


def friction_metric(anisotropy: Float[Tensor, "batch 2"]) -> Float[Tensor, "3 batch"]:
    """xx, xy and yy of the square of the matrix that is 1 + a along the grain and 1 - a across it.

    anisotropy: see SceneBatch.
    """
    a_x, a_y = anisotropy.unbind(-1)
    even = 1 + a_x.square() + a_y.square()
    return torch.stack((even + 2 * a_x, 2 * a_y, even - 2 * a_x))


def _rows_sum(nodes: Nodes, values: Tensor, node: Tensor) -> Tensor:
    """For each row the sum of the values of all rows of its node."""
    return torch.zeros_like(nodes.mass).index_add(0, node, values).index_select(0, node).clamp(min=1e-9)


def _drives(control: Control, nodes: Nodes) -> Drives:
    node = (nodes.is_tool & ~nodes.given).nonzero().squeeze(-1)
    way = nodes.last_twist[:2, node]
    length = way.norm(dim=0)
    limit = torch.as_tensor(control.force_limit, dtype=length.dtype, device=length.device).expand(len(control.pose))
    return Drives(node, way / length, length, limit[nodes.scene[node]] / nodes.force[node])


def _edges(pairs: _Pairs, reach: Reachable, relations: int, first: Tensor, second: Tensor) -> Edges:
    bodies = reach.piece.shape[1]
    is_tool = pairs.second >= bodies
    yaw, normal = pairs.poses[0, :, 2], pairs.contact.normal
    return Edges(
        scene=pairs.scene,
        first=first,
        second=second,
        first_body=pairs.scene * bodies + pairs.first,
        second_body=pairs.scene * bodies + pairs.second.clamp(max=bodies - 1),
        relation=torch.where(is_tool, -1, pairs.scene * relations + pairs.pair),
        is_tool=is_tool,
        normal=pose.rotate(normal, yaw).t(),
        fade=pairs.fade,
    )


def _contacts(state: State, pairs: _Pairs, edges: Edges, nodes: Nodes) -> Contacts:
    """One or two contacts an edge; none between the two ends of a slider, nor between what does not move."""
    slides = _of_relation(state.relations.kind, edges) == JOINT_CODES["prismatic"]
    touches = ~slides & ~(nodes.given[edges.first] & nodes.given[edges.second])
    apart = (pairs.contact.points_a[:, 0] - pairs.contact.points_a[:, 1]).abs().amax(-1) > SAME_POINT
    edge, number = torch.stack((touches, touches & apart), 1).nonzero(as_tuple=True)
    first, second = edges.first[edge], edges.second[edge]
    poses = pairs.poses[0][edge]
    arms = []
    for node, ends in ((first, pairs.contact.points_a), (second, pairs.contact.points_b)):
        point = pose.rotate(ends[edge, number], poses[:, 2])
        arms.append(_arm(nodes, node, poses, point, pairs.at_start[edge]))
    points = Points(edge, first, second, *arms)
    normal = edges.normal[:, edge]
    gap = pairs.contact.gaps[edge, number] / nodes.step[first]
    x, y, _ = _moved_halfway(nodes, points, pairs.at_start)
    return Contacts(
        points=points,
        normal=normal,
        gap=gap - (x * normal[0] + y * normal[1]),
        friction=state.scenes.side_friction[edges.scene[edge]],
        share=1 / _twins(nodes, points),
    )


def _twins(nodes: Nodes, points: Points) -> Float[Tensor, " points"]:
    """How many contacts of the same two nodes stand where each does, those farther away counting for less."""
    low, high = torch.minimum(points.first, points.second), torch.maximum(points.first, points.second)
    key, order = (low * len(nodes.mass) + high).sort(stable=True)
    place = (nodes.centre[points.first] + points.first_arm.t() * LEVER)[order]
    count = torch.ones_like(place[:, 0])
    for apart in range(1, len(key)):
        same = key[apart:] == key[:-apart]
        if not bool(same.any()):
            break
        distance = (place[apart:] - place[:-apart]).norm(dim=-1)
        near = torch.where(same, (1 - distance / TWINS).clamp(min=0), 0.0)
        count = count + functional.pad(near, (apart, 0)) + functional.pad(near, (0, apart))
    return torch.empty_like(count).index_copy(0, order, count)


def _joints(state: State, pairs: _Pairs, edges: Edges, nodes: Nodes) -> Joints:
    relations = state.relations
    kind = _of_relation(relations.kind, edges)
    joined = (kind == JOINT_CODES["prismatic"]) | (kind == JOINT_CODES["revolute"])
    joined &= ~(nodes.given[edges.first] & nodes.given[edges.second])
    edge = joined.nonzero().squeeze(-1)
    relation = edges.relation[edge]
    anchor_a, anchor_b, axis, limits, yaw_offset = (
        _rows(values, relation)
        for values in (relations.anchor_a, relations.anchor_b, relations.axis, relations.limits, relations.yaw_offset)
    )
    pose_a, pose_b = pairs.poses[:, edge]
    first, second = edges.first[edge], edges.second[edge]
    anchor_a, anchor_b = pose.rotate(anchor_a, pose_a[:, 2]), pose.rotate(anchor_b, pose_b[:, 2])
    turn = pose.wrap_angle(pose_b[:, 2] - pose_a[:, 2] - yaw_offset)
    # Neither body comes first: a slider's axis is carried by both, and so is the point at which it is held.
    revolute = kind[edge] == JOINT_CODES["revolute"]
    axis = torch.where(revolute, 0.0, pose.rotate(axis, pose_a[:, 2] + turn / 2).t())
    at_start = pairs.at_start[edge]
    first_arm = _arm(nodes, first, pose_a, anchor_a, at_start)
    second_arm = _arm(nodes, second, pose_b, anchor_b, at_start)
    step = nodes.step[first]
    drift = ((pose_b[:, :2] - pose_a[:, :2]) + anchor_b - anchor_a).t()
    aside = torch.where(revolute, 0.0, drift / (2 * LEVER))
    points = Points(edge, first, second, first_arm + aside, second_arm - aside)
    drift, turn = drift / step, turn * LEVER / step
    limits = limits.t() * torch.where(revolute, LEVER, 1.0) / step
    x, y, turned = _moved_halfway(nodes, points, pairs.at_start)
    drift, turn = drift - torch.stack((x, y)), turn - turned
    used = torch.where(revolute, turn, (drift * axis).sum(0))
    return Joints(points, revolute, drift, turn, axis, low=used - limits[0], high=limits[1] - used)


def _arm(nodes: Nodes, node: Tensor, poses: Tensor, point: Tensor, at_start: Tensor) -> Float[Tensor, "2 points"]:
    """Lever arm of a point that lies `point` (m, world axes) from where its body is."""
    arm = point.t() + (poses[:, :2] - nodes.centre[node]).t()
    come = nodes.last_twist[:2, node] * (nodes.step[node] / 2 * at_start)
    return (arm + come) / LEVER


def _moved_halfway(nodes: Nodes, points: Points, at_start: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """How points have come to stand against each other since the start of the step, where the geometry is later."""
    later = ~at_start.index_select(0, points.edge)
    x, y, turn = relative_motion(points, nodes.last_twist / 2)
    return x * later, y * later, turn * later


def relative_motion(
    points: Points, twist: Float[Tensor, "3 nodes"]
) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"], Float[Tensor, " points"]]:
    """How the second node's points move away from the first's, x and y, and how the second turns against it."""
    x_1, y_1, turn_1 = twist.index_select(1, points.first)
    x_2, y_2, turn_2 = twist.index_select(1, points.second)
    (arm_x_1, arm_y_1), (arm_x_2, arm_y_2) = points.first_arm, points.second_arm
    x = x_2 - arm_y_2 * turn_2 - (x_1 - arm_y_1 * turn_1)
    y = y_2 + arm_x_2 * turn_2 - (y_1 + arm_x_1 * turn_1)
    return x, y, turn_2 - turn_1


def _of_relation(values: Tensor, edges: Edges) -> Tensor:
    """Values of [batch, pairs] of each edge; zero for the tool's."""
    found = values.flatten().index_select(0, edges.relation.clamp(min=0))
    return found.masked_fill(edges.is_tool, 0)


def _rows(values: Tensor, rows: Tensor) -> Tensor:
    """Rows of values [batch, n, ...] seen as [batch * n, ...]."""
    return values.flatten(0, 1).index_select(0, rows)
