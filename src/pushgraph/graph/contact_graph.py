"""The graph of `contact`: pieces that the tool can move in this frame, edges where they nearly touch or are joined.

An edge is told everything in its contact frame, x along the normal from receiver to sender, y to the left of that,
so features do not change when the scene is moved or turned. Lengths are given as shares of the tool's step where
they can matter within it, so that slow and fast pushes look alike.
"""

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph import pose
from pushgraph.graph.near import MARGIN, SLIDER_REACH, STEPS_OF_REACH, Near, near_pairs
from pushgraph.graph.pieces import Pieces, gather_pieces, mean_motion, piece_index
from pushgraph.graph.scene_batch import JOINT_CODES, pairs_of
from pushgraph.graph.state import Control, State
from pushgraph.scene import NOMINAL_MASS, NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION

LEVER = 0.05
"""Turns by an angle count as this arm (m) times the angle."""
CLAMP = 4.0
"""Shares of the tool's step beyond this are told as this."""
UNLIMITED = 40.0
"""Room (m) where a pair has no joint with limits."""
STEP, CENTIMETRE, FRICTION = 0.01, 0.01, 0.1
"""Units of the tool's step (m), of gaps and drifts (m), and of friction off its nominal value."""

NODE_FEATURES = ("mass", "mass_known", "patch_radius", "table_friction", "table_friction_known", "kinematic", "step")
EDGE_FEATURES = (
    "fade",
    *("gap_1_steps", "gap_2_steps", "gap_1", "gap_2"),
    *(f"{end}_lever_{point}_{axis}" for end in ("receiver", "sender") for point in (1, 2, "joint") for axis in "xy"),
    *("prismatic", "revolute", "unknown", "remembered"),
    *("drift_steps_x", "drift_steps_y", "drift_x", "drift_y", "turn_steps", "turn"),
    *("axis_x", "axis_y", "slack_low_steps", "slack_high_steps", "slack_low", "slack_high"),
    *("side_friction", "side_friction_known", "sender_kinematic", "receiver_yaw_known", "sender_yaw_known", "step"),
    *(f"{end}_last_{part}" for end in ("receiver", "sender") for part in ("x", "y", "turn")),
)


class ContactGraph(NamedTuple):
    """One flat graph of many scenes; the tool is a node whose twist is given.

    step: the tool's step in each node's scene (m). twist: of each node in this frame, of its centre of mass, world
    axes, in steps, angles times LEVER; zero where it is to be found. body: row of the piece in [batch * bodies].
    normal: from receiver to sender, world. levers: from centre of mass to the two contacts and the joint's anchor,
    in contact frame (LEVER). offsets: what stands between the ends of these three, in steps: gap, 0, gap, 0, drift.
    turn: of the sender relative to the receiver since the joint was made, in steps. slack: room to the joint's limits,
    in steps; slack_axis: which of the drift's components and the turn use it up. compliance: squared ratio of LEVER
    to how hard the receiver is to turn.
    """

    nodes: Float[Tensor, "nodes node_features"]
    step: Float[Tensor, " nodes"]
    twist: Float[Tensor, "nodes 3"]
    kinematic: Bool[Tensor, " nodes"]
    compliance: Float[Tensor, " nodes"]
    body: Int[Tensor, " nodes"]
    receiver: Int[Tensor, " edges"]
    sender: Int[Tensor, " edges"]
    edges: Float[Tensor, "edges edge_features"]
    normal: Float[Tensor, "edges 2"]
    receiver_levers: Float[Tensor, "edges 3 2"]
    sender_levers: Float[Tensor, "edges 3 2"]
    offsets: Float[Tensor, "edges 3 2"]
    turn: Float[Tensor, " edges"]
    slack: Float[Tensor, "edges 2"]
    slack_axis: Float[Tensor, "edges 3"]
    pieces: Pieces


CONSTANTS = {
    "margin": MARGIN,
    "steps_of_reach": STEPS_OF_REACH,
    "slider_reach": SLIDER_REACH,
    "lever": LEVER,
    "clamp": CLAMP,
}
"""What the weights depend on beside the features' names."""


def contact_graph(state: State, control: Control) -> ContactGraph:
    """Build the graph of one frame; float32, whatever the precision of the poses."""
    index = piece_index(state.scenes, state.relations)
    pieces = gather_pieces(state.scenes, index, state.poses[..., :2])
    step = control.motion[:, :2].norm(dim=-1) + control.motion[:, 2].abs() * state.scenes.reach
    step = torch.where(control.down, step, 0.0).float()
    near = near_pairs(state, control, index, step)

    # Only what an edge meets stands in the graph. A node's slot is its piece's first body; the tool's follows them.
    bodies = index.shape[1]
    tool = torch.full_like(near.second, bodies)
    second_piece = torch.where(near.part >= 0, tool, index[near.scene, near.second.clamp(min=0)])
    first = near.scene * (bodies + 1) + index[near.scene, near.first]
    second = near.scene * (bodies + 1) + second_piece
    used = torch.zeros(len(index) * (bodies + 1), dtype=torch.bool, device=index.device)
    used[first], used[second] = True, True
    slot, place = used.nonzero().squeeze(-1), used.cumsum(0) - 1
    nodes = _nodes(state, control, pieces, step, slot)
    return _with_edges(state, near, nodes, place[first], place[second])


class _Nodes(NamedTuple):
    features: Tensor
    step: Tensor
    centre: Tensor
    twist: Tensor
    last_twist: Tensor
    kinematic: Tensor
    patch_radius: Tensor
    body: Tensor
    pieces: Pieces


def _nodes(state: State, control: Control, pieces: Pieces, step: Tensor, slot: Tensor) -> _Nodes:
    scenes, bodies = state.scenes, pieces.index.shape[1]
    scene, piece = slot // (bodies + 1), slot % (bodies + 1)
    kinematic, piece = piece == bodies, (slot % (bodies + 1)).clamp(max=bodies - 1)
    step = step[scene]
    patch = torch.where(kinematic, LEVER, pieces.patch_radius[scene, piece])
    mass = torch.where(kinematic, NOMINAL_MASS, pieces.mass[scene, piece])
    features = (
        (mass / NOMINAL_MASS).log(),
        (kinematic | scenes.mass_known[scene, piece]).float(),
        patch / LEVER,
        (scenes.table_friction[scene] - NOMINAL_TABLE_FRICTION) / FRICTION,
        scenes.table_friction_known[scene].float(),
        kinematic.float(),
        (step / STEP).log(),
    )
    unit = patch.new_tensor([1.0, 1.0, LEVER])
    last = mean_motion(scenes, pieces.index, state.motions)[scene, piece]
    last = torch.where(kinematic[:, None], control.last_motion[scene], last).float() * unit / step[:, None]
    twist = control.motion.float()[scene] / step[:, None] * unit
    return _Nodes(
        features=torch.stack(features, -1),
        step=step,
        centre=torch.where(kinematic[:, None], control.pose[scene, :2], pieces.centre[scene, piece]),
        twist=torch.where(kinematic[:, None], twist, 0.0),
        last_twist=last.clamp(-CLAMP, CLAMP),
        kinematic=kinematic,
        patch_radius=patch,
        body=scene * bodies + piece,
        pieces=pieces,
    )


def _with_edges(state: State, near: Near, nodes: _Nodes, first: Tensor, second: Tensor) -> ContactGraph:
    """The graph with its edges: for two bodies one each way, for the tool only towards the body."""
    geometry = _geometry(state, near, nodes.centre[first], nodes.centre[second])
    mirrored = (near.part < 0).nonzero().squeeze(-1)
    geometry = _mirror(geometry, mirrored)
    receiver, sender = torch.cat((first, second[mirrored])), torch.cat((second, first[mirrored]))
    step = nodes.step[receiver]

    def doubled(column: Tensor, other: Tensor | None = None) -> Tensor:
        return torch.cat((column, (column if other is None else other)[mirrored]))

    def steps(lengths: Tensor) -> Tensor:
        return (lengths / step.view(-1, *[1] * (lengths.dim() - 1))).clamp(-CLAMP, CLAMP)

    scenes, relations = state.scenes, state.relations
    pair, scene = doubled(near.pair), doubled(near.scene)
    bodies, joint = pair >= 0, pair.clamp(min=0)
    kind = torch.where(bodies, relations.kind[scene, joint], 0)
    unknown, remembered = bodies & ~relations.known[scene, joint], bodies & relations.remembered[scene, joint]
    prismatic, revolute = kind == JOINT_CODES["prismatic"], kind == JOINT_CODES["revolute"]
    held = remembered.float()[:, None]
    drift, turn, axis = geometry.drift * held, geometry.turn[:, None] * held, geometry.axis * prismatic[:, None]
    room = torch.where((prismatic | revolute)[:, None], geometry.slack, UNLIMITED)
    of_joint = torch.stack((torch.ones_like(held), torch.ones_like(held), held), 1)
    levers = torch.cat((geometry.receiver_levers * of_joint, geometry.sender_levers * of_joint), 1) / LEVER
    first_yaw = scenes.yaw_known[near.scene, near.first]
    second_yaw = (near.part >= 0) | scenes.yaw_known[near.scene, near.second.clamp(min=0)]
    features = (
        doubled(near.fade)[:, None],
        steps(geometry.gaps),
        (geometry.gaps / CENTIMETRE).tanh(),
        levers.flatten(1),
        torch.stack((prismatic, revolute, unknown, remembered), -1).float(),
        steps(drift),
        (drift / CENTIMETRE).tanh(),
        steps(turn),
        (turn / LEVER).tanh(),
        axis,
        steps(room),
        (room / LEVER).tanh(),
        (scenes.side_friction[scene, None] - NOMINAL_SIDE_FRICTION) / FRICTION,
        scenes.side_friction_known[scene, None].float(),
        nodes.kinematic[sender, None].float(),
        doubled(first_yaw, second_yaw)[:, None].float(),
        doubled(second_yaw, first_yaw)[:, None].float(),
        (step / STEP).log()[:, None],
        in_frame(nodes.last_twist[receiver], geometry.normal),
        in_frame(nodes.last_twist[sender], geometry.normal),
    )
    gaps = torch.stack((geometry.gaps, torch.zeros_like(geometry.gaps)), -1)
    return ContactGraph(
        nodes=nodes.features,
        step=nodes.step,
        twist=nodes.twist,
        kinematic=nodes.kinematic,
        compliance=(LEVER / nodes.patch_radius).square(),
        body=nodes.body,
        receiver=receiver,
        sender=sender,
        edges=torch.cat(features, -1),
        normal=geometry.normal,
        receiver_levers=levers[:, :3],
        sender_levers=levers[:, 3:],
        offsets=torch.cat((steps(gaps), steps(drift)[:, None]), 1),
        turn=steps(turn)[:, 0],
        slack=steps(room),
        slack_axis=torch.cat((axis, revolute.float()[:, None]), -1),
        pieces=nodes.pieces,
    )


def in_frame(
    twist: Float[Tensor, "*batch edges 3"], normal: Float[Tensor, "edges 2"]
) -> Float[Tensor, "*batch edges 3"]:
    """A twist in a contact frame, given that frame's x-axis; both in world axes."""
    x, y, (along, across, turn) = normal[:, 0], normal[:, 1], twist.unbind(-1)
    return torch.stack((along * x + across * y, across * x - along * y, turn), -1)


def in_world(
    twist: Float[Tensor, "*batch edges 3"], normal: Float[Tensor, "edges 2"]
) -> Float[Tensor, "*batch edges 3"]:
    """A twist in world axes, given in the contact frame of this x-axis."""
    x, y, (along, across, turn) = normal[:, 0], normal[:, 1], twist.unbind(-1)
    return torch.stack((along * x - across * y, along * y + across * x, turn), -1)


def perpendicular(vectors: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
    """Vectors turned to the left by a right angle."""
    return torch.stack((-vectors[..., 1], vectors[..., 0]), -1)


class _Geometry(NamedTuple):
    """Geometry of edges in metres, contact frame; `turn` in metres at LEVER."""

    normal: Tensor
    gaps: Tensor
    receiver_levers: Tensor
    sender_levers: Tensor
    drift: Tensor
    turn: Tensor
    axis: Tensor
    slack: Tensor
    revolute: Tensor


def _geometry(state: State, near: Near, centre_a: Tensor, centre_b: Tensor) -> _Geometry:
    relations, scene, touch = state.relations, near.scene, near.contact
    _, b = pairs_of(state.poses.shape[1], state.poses.device)
    joint = near.pair.clamp(min=0)
    pose_a, pose_b = state.poses[scene, near.first], state.poses[scene, b[joint]]
    yaw_a, yaw_b = pose_a[:, 2].float(), pose_b[:, 2].float()
    from_a, a_to_b = (pose_a[:, :2] - centre_a).float(), (centre_b - centre_a).float()
    from_b = (pose_b[:, :2] - centre_b).float()
    normal = pose.rotate(touch.normal, yaw_a)
    points_a = pose.rotate(touch.points_a, yaw_a[:, None]) + from_a[:, None]
    points_b = pose.rotate(touch.points_b, yaw_a[:, None]) + (from_a - a_to_b)[:, None]
    anchor_a = pose.rotate(relations.anchor_a[scene, joint], yaw_a) + from_a
    anchor_b = pose.rotate(relations.anchor_b[scene, joint], yaw_b) + from_b
    world = torch.cat((points_a, anchor_a[:, None], points_b, anchor_b[:, None]), 1)
    axis = pose.rotate(relations.axis[scene, joint], yaw_a)
    world = torch.cat((world, (anchor_b - anchor_a + a_to_b)[:, None], axis[:, None]), 1)
    x, y = normal[:, None, 0], normal[:, None, 1]
    local = torch.stack((world[..., 0] * x + world[..., 1] * y, world[..., 1] * x - world[..., 0] * y), -1)
    drift, axis = local[:, 6], local[:, 7]
    turn = pose.wrap_angle((pose_b[:, 2] - pose_a[:, 2] - relations.yaw_offset[scene, joint]).float()) * LEVER
    revolute = relations.kind[scene, joint] == JOINT_CODES["revolute"]
    along = torch.where(revolute, turn, (drift * axis).sum(-1))
    limits = relations.limits[scene, joint] * torch.where(revolute, LEVER, 1.0)[:, None]
    slack = torch.stack((along - limits[:, 0], limits[:, 1] - along), -1)
    return _Geometry(normal, touch.gaps, local[:, :3], local[:, 3:6], drift, turn, axis, slack, revolute)


def _mirror(edges: _Geometry, mirrored: Tensor) -> _Geometry:
    """Append the edges the other way; both axes of the contact frame then point the other way too.

    What stands between the two ends is the same in that frame, but levers change sides, and a turn its sign. A turn's
    limits change places with it; along the axis of a slider they need not.
    """
    some = _Geometry(*(column[mirrored] for column in edges))
    turned = some._replace(
        normal=-some.normal,
        receiver_levers=-some.sender_levers,
        sender_levers=-some.receiver_levers,
        turn=-some.turn,
        slack=torch.where(some.revolute[:, None], some.slack.flip(-1), some.slack),
    )
    return _Geometry(*(torch.cat(columns) for columns in zip(edges, turned, strict=True)))
