"""The graph of `contact`: pieces that the tool can move in this frame, edges where they nearly touch or are joined.

An edge is told everything in its contact frame, x along the normal from receiver to sender, y to the left of that,
so features do not change when the scene is moved or turned. Lengths are given as shares of the tool's step where
they can matter within it, so that slow and fast pushes look alike.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph import pose
from pushgraph.graph.near import MARGIN, SLIDER_REACH, STEPS_OF_REACH, Near, near_pairs, tool_step
from pushgraph.graph.pieces import Pieces, gather_pieces, mean_motion, piece_index
from pushgraph.graph.scene_batch import JOINT_CODES, Relations
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
    to how hard the receiver is to turn. relation: where the edge stands in [batch * pairs * 2], the pair's later body
    being the receiver of the second; -1 for the tool's.
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
    relation: Int[Tensor, " edges"]
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
    step = tool_step(state, control)
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
    scenes, relations, is_tool = state.scenes, state.relations, near.part >= 0
    bodies = scenes.mass.shape[1]
    joint = near.scene * relations.kind.shape[1] + near.pair.clamp(min=0)
    row_a, row_b = near.scene * bodies + near.first, near.scene * bodies + near.second.clamp(min=0)
    kind = _rows(relations.kind, joint).masked_fill(is_tool, 0)
    unknown, remembered = ~(_rows(relations.known, joint) | is_tool), _rows(relations.remembered, joint) & ~is_tool
    prismatic, revolute = kind == JOINT_CODES["prismatic"], kind == JOINT_CODES["revolute"]
    flags = torch.stack((prismatic, revolute, unknown, remembered), -1).to(nodes.features.dtype)
    poses = _rows(state.poses, row_a), _rows(state.poses, row_b)
    local, normal = _in_contact_frame(near, relations, joint, *poses, nodes.centre[first], nodes.centre[second])
    turn = pose.wrap_angle((poses[1][:, 2] - poses[0][:, 2] - _rows(relations.yaw_offset, joint)).float()) * LEVER

    limits = _rows(relations.limits, joint) * torch.where(revolute, LEVER, 1.0)[:, None]
    along = torch.where(revolute, turn, (local[:, 6] * local[:, 7]).sum(-1))
    slack = torch.stack((along - limits[:, 0], limits[:, 1] - along), -1)
    slack = torch.where((prismatic | revolute)[:, None], slack, UNLIMITED)
    held, slides = flags[:, 3:], flags[:, :1]
    ones = torch.ones_like(held)
    local = local * torch.cat((ones, ones, held, ones, ones, held, held, slides), -1)[..., None]

    step = nodes.step[first, None]
    lengths = torch.cat((near.contact.gaps, local[:, 6], turn[:, None] * held, slack), -1)
    steps, soft = (lengths / step).clamp(-CLAMP, CLAMP), (lengths / _UNITS.to(lengths)).tanh()
    yaw_known = _rows(scenes.yaw_known, row_a), _rows(scenes.yaw_known, row_b) | is_tool
    last = in_frame(nodes.last_twist[torch.stack((first, second))], normal)
    features = (
        near.fade[:, None],
        *(steps[:, :2], soft[:, :2]),
        (local[:, :6] / LEVER).flatten(1),
        flags,
        *(steps[:, 2:4], soft[:, 2:4], steps[:, 4:5], soft[:, 4:5]),
        local[:, 7],
        *(steps[:, 5:], soft[:, 5:]),
        ((scenes.side_friction - NOMINAL_SIDE_FRICTION) / FRICTION)[near.scene, None],
        torch.stack((scenes.side_friction_known[near.scene], is_tool, *yaw_known), -1).to(flags.dtype),
        (step / STEP).log(),
        *last,
    )
    edges = torch.cat(features, -1)
    mirrored = (~is_tool).nonzero().squeeze(-1)
    edges = torch.cat((edges, _mirror(edges[mirrored])))
    column = {name: k for k, name in enumerate(EDGE_FEATURES)}
    levers = edges[:, column["receiver_lever_1_x"] : column["prismatic"]].unflatten(-1, (2, 3, 2))
    drift = edges[:, None, column["drift_steps_x"] : column["drift_x"]]
    gaps = functional.pad(edges[:, column["gap_1_steps"] : column["gap_1"], None], (0, 1))
    axis, hinge = edges[:, column["axis_x"] : column["slack_low_steps"]], edges[:, column["revolute"], None]
    return ContactGraph(
        nodes=nodes.features,
        step=nodes.step,
        twist=nodes.twist,
        kinematic=nodes.kinematic,
        compliance=(LEVER / nodes.patch_radius).square(),
        body=nodes.body,
        receiver=torch.cat((first, second[mirrored])),
        sender=torch.cat((second, first[mirrored])),
        edges=edges,
        normal=torch.cat((normal, -normal[mirrored])),
        receiver_levers=levers[:, 0],
        sender_levers=levers[:, 1],
        offsets=torch.cat((gaps, drift), 1),
        turn=edges[:, column["turn_steps"]],
        slack=edges[:, column["slack_low_steps"] : column["slack_low"]],
        slack_axis=torch.cat((axis, hinge), -1),
        relation=_relation(near, mirrored, relations.kind.shape[1]),
        pieces=nodes.pieces,
    )


_UNITS = torch.tensor((CENTIMETRE,) * 4 + (LEVER,) * 3)
"""Of gaps, drift, turn and slack."""


def _rows(values: Tensor, rows: Tensor) -> Tensor:
    """Rows of values [batch, n, ...] seen as [batch * n, ...]."""
    return values.flatten(0, 1).index_select(0, rows)


def _in_contact_frame(
    near: Near, relations: Relations, joint: Tensor, pose_a: Tensor, pose_b: Tensor, centre_a: Tensor, centre_b: Tensor
) -> tuple[Tensor, Tensor]:
    """Levers of the first end to two contacts and the joint, those of the second, the joint's drift and its axis,
    [pairs, 8, 2] (m) in contact frame; and the normal in the world. One complex product turns a planar vector."""
    yaw_a, yaw_ab = pose_a[:, 2].float(), (pose_b[:, 2] - pose_a[:, 2]).float()
    turn_a, turn_ab = torch.complex(yaw_a.cos(), yaw_a.sin()), torch.complex(yaw_ab.cos(), yaw_ab.sin())
    # Subtracted before anything is turned or rounded, so that nothing is lost far from the origin.
    positions = torch.stack((centre_a, centre_b, pose_b[:, :2]), 1) - pose_a[:, None, :2]
    positions = pose.as_complex(positions.float()) * turn_a.conj()[:, None]
    anchor_a = pose.as_complex(_rows(relations.anchor_a, joint))[:, None]
    anchor_b = pose.as_complex(_rows(relations.anchor_b, joint)) * turn_ab + positions[:, 2]
    axis = pose.as_complex(_rows(relations.axis, joint))[:, None]
    points = (pose.as_complex(points) for points in (near.contact.points_a, near.contact.points_b))
    ends = torch.cat((next(points), anchor_a, next(points), anchor_b[:, None]), 1)
    levers = ends - positions[:, :2].repeat_interleave(3, 1)
    normal = pose.as_complex(near.contact.normal)
    local = torch.cat((levers, anchor_b[:, None] - anchor_a, axis), 1) * normal.conj()[:, None]
    return torch.view_as_real(local), torch.view_as_real(normal * turn_a)


def _mirror(edges: Float[Tensor, "edges edge_features"]) -> Float[Tensor, "edges edge_features"]:
    """Edges the other way; both axes of the contact frame then point the other way too.

    What stands between the two ends is the same in that frame, but levers and motions change sides and point the
    other way, and a turn its sign. A turn's limits change places with it; along the axis of a slider they need not.
    """
    hinge = edges[:, EDGE_FEATURES.index("revolute"), None] > 0
    columns = torch.tensor((_OTHER_END, _OTHER_END_OF_HINGE), device=edges.device)
    return torch.where(hinge, edges[:, columns[1]], edges[:, columns[0]]) * edges.new_tensor(_SIGN)


def _exchanged(a: str, b: str, names: Sequence[str]) -> list[str]:
    """The names, those that begin with `a` exchanged with those that begin with `b` where there are both."""
    swap = {name: b + name.removeprefix(a) for name in names if name.startswith(a)}
    swap = {one: other for one, other in swap.items() if other in names}
    swap |= {other: one for one, other in swap.items()}
    return [swap.get(name, name) for name in names]


_SWAPPED = _exchanged("receiver", "sender", EDGE_FEATURES)
_OTHER_END = [EDGE_FEATURES.index(name) for name in _SWAPPED]
_OTHER_END_OF_HINGE = [EDGE_FEATURES.index(name) for name in _exchanged("slack_low", "slack_high", _SWAPPED)]
_SIGN = [-1.0 if re.search("_lever_|^turn|_last_[xy]", name) else 1.0 for name in EDGE_FEATURES]


def _relation(near: Near, mirrored: Tensor, pairs: int) -> Tensor:
    first = 2 * (near.scene * pairs + near.pair)
    return torch.cat((torch.where(near.pair >= 0, first, -1), first[mirrored] + 1))


def in_frame(
    twist: Float[Tensor, "*batch edges 3"], normal: Float[Tensor, "edges 2"]
) -> Float[Tensor, "*batch edges 3"]:
    """A twist in a contact frame, given that frame's x-axis; both in world axes."""
    x, y, (along, across, turn) = normal[:, 0], normal[:, 1], twist.unbind(-1)
    return torch.stack((along * x + across * y, across * x - along * y, turn), -1)
