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
from pushgraph.graph.near import MARGIN, SLIDER_REACH, STEPS_OF_REACH, Near, Reach, near_pairs, within_reach
from pushgraph.graph.pieces import Pieces, gather_pieces, mean_motion
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


def contact_graph(state: State, control: Control, reach: Reach | None = None) -> ContactGraph:
    """Build the graph of one frame; float32, whatever the precision of the poses. reach: if it is known already."""
    reach = within_reach(state, control) if reach is None else reach
    pieces = gather_pieces(state.scenes, reach.index, state.poses[..., :2])
    near = near_pairs(reach)

    # Only what an edge meets stands in the graph. A node's slot is its piece's first body; the tool's follows them.
    slot, place = near.pieces.unique(return_inverse=True)
    nodes = _nodes(state, control, pieces, reach.step, slot)
    return _with_edges(state, near, nodes, *place)


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
    kinematic = piece == bodies
    body = scene * bodies + piece.clamp(max=bodies - 1)
    step = step.index_select(0, scene)
    of_body = torch.stack((pieces.mass, scenes.mass_known.float(), pieces.patch_radius), -1)
    of_body = torch.where(kinematic[:, None], of_body.new_tensor([NOMINAL_MASS, 1.0, LEVER]), _rows(of_body, body))
    mass, mass_known, patch = of_body.unbind(-1)
    friction = (scenes.table_friction - NOMINAL_TABLE_FRICTION) / FRICTION
    friction = torch.stack((friction, scenes.table_friction_known.float())).index_select(1, scene)
    features = (
        (mass / NOMINAL_MASS).log(),
        mass_known,
        patch / LEVER,
        *friction,
        kinematic.float(),
        (step / STEP).log(),
    )
    unit = patch.new_tensor([1.0, 1.0, LEVER]) / step[:, None]
    last = _rows(mean_motion(scenes, pieces.index, state.motions), body)
    last = torch.where(kinematic[:, None], control.last_motion.index_select(0, scene), last).float() * unit
    twist = control.motion.float().index_select(0, scene) * unit
    return _Nodes(
        features=torch.stack(features, -1),
        step=step,
        centre=torch.where(kinematic[:, None], control.pose[scene, :2], _rows(pieces.centre, body)),
        twist=torch.where(kinematic[:, None], twist, 0.0),
        last_twist=last.clamp(-CLAMP, CLAMP),
        kinematic=kinematic,
        patch_radius=patch,
        body=body,
        pieces=pieces,
    )


def _with_edges(state: State, near: Near, nodes: _Nodes, first: Tensor, second: Tensor) -> ContactGraph:
    """The graph with its edges: for two bodies one each way, for the tool only towards the body."""
    scenes, relations, is_tool = state.scenes, state.relations, near.is_tool
    joint = near.scene * relations.kind.shape[1] + near.pair.masked_fill(is_tool, 0)
    told = _told(relations, joint).masked_fill(is_tool[:, None], 0.0)
    flags, anchor_a, anchor_b, axis, limits, yaw_offset = told.split((4, 2, 2, 2, 2, 1), -1)
    anchors = (pose.as_complex(vectors) for vectors in (anchor_a, anchor_b, axis))
    local, normal = _in_contact_frame(near, *anchors, nodes.centre[first], nodes.centre[second])
    yaw_a, yaw_b = near.poses[..., 2]
    turn = pose.wrap_angle((yaw_b - yaw_a - yaw_offset[:, 0]).float()) * LEVER

    prismatic, revolute = flags[:, 0] > 0, flags[:, 1] > 0
    limits = limits * torch.where(revolute, LEVER, 1.0)[:, None]
    along = torch.where(revolute, turn, (local[:, 6] * local[:, 7]).sum(-1))
    slack = torch.stack((along - limits[:, 0], limits[:, 1] - along), -1)
    slack = torch.where((prismatic | revolute)[:, None], slack, UNLIMITED)
    held, slides = flags[:, 3:], flags[:, :1]
    ones = torch.ones_like(held)
    local = local * torch.cat((ones, ones, held, ones, ones, held, held, slides), -1)[..., None]

    step = nodes.step.index_select(0, first)[:, None]
    lengths = torch.cat((near.contact.gaps, local[:, 6], turn[:, None] * held, slack), -1)
    steps, soft = (lengths / step).clamp(-CLAMP, CLAMP), (lengths / _UNITS.to(lengths)).tanh()
    side = (scenes.side_friction - NOMINAL_SIDE_FRICTION) / FRICTION
    side = torch.stack((side, scenes.side_friction_known.float()), -1).index_select(0, near.scene)
    yaw_known = torch.cat((scenes.yaw_known, torch.ones_like(scenes.part_present)), 1)
    rows = near.scene * yaw_known.shape[1] + torch.stack((near.first, near.second))
    yaw_known = yaw_known.flatten().index_select(0, rows.flatten()).view_as(rows)
    last = in_frame(nodes.last_twist[torch.stack((first, second))], normal)
    features = (
        near.fade[:, None],
        *(steps[:, :2], soft[:, :2]),
        (local[:, :6] / LEVER).flatten(1),
        flags,
        *(steps[:, 2:4], soft[:, 2:4], steps[:, 4:5], soft[:, 4:5]),
        local[:, 7],
        *(steps[:, 5:], soft[:, 5:]),
        side,
        torch.stack((is_tool, *yaw_known), -1).to(flags.dtype),
        (step / STEP).log(),
        *last,
    )
    edges = torch.cat(features, -1)
    mirrored = (~is_tool).nonzero().squeeze(-1)
    edges = torch.cat((edges, _mirror(edges[mirrored])))
    levers = edges[:, _COLUMN["receiver_lever_1_x"] : _COLUMN["prismatic"]].unflatten(-1, (2, 3, 2))
    drift = edges[:, None, _COLUMN["drift_steps_x"] : _COLUMN["drift_x"]]
    gaps = functional.pad(edges[:, _COLUMN["gap_1_steps"] : _COLUMN["gap_1"], None], (0, 1))
    axis, hinge = edges[:, _COLUMN["axis_x"] : _COLUMN["slack_low_steps"]], edges[:, _COLUMN["revolute"], None]
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
        turn=edges[:, _COLUMN["turn_steps"]],
        slack=edges[:, _COLUMN["slack_low_steps"] : _COLUMN["slack_low"]],
        slack_axis=torch.cat((axis, hinge), -1),
        relation=torch.cat((torch.where(is_tool, -1, 2 * joint), 2 * joint[mirrored] + 1)),
        pieces=nodes.pieces,
    )


_COLUMN = {name: k for k, name in enumerate(EDGE_FEATURES)}
_UNITS = torch.tensor((CENTIMETRE,) * 4 + (LEVER,) * 3)
"""Of gaps, drift, turn and slack."""


def _rows(values: Tensor, rows: Tensor) -> Tensor:
    """Rows of values [batch, n, ...] seen as [batch * n, ...]."""
    return values.flatten(0, 1).index_select(0, rows)


def _told(relations: Relations, joint: Int[Tensor, " pairs"]) -> Float[Tensor, "pairs 13"]:
    """Flags, anchors, axis, limits and yaw offset of some pairs, gathered in one go."""
    kinds = (relations.kind == JOINT_CODES[kind] for kind in ("prismatic", "revolute"))
    flags = torch.stack((*kinds, ~relations.known, relations.remembered), -1).to(relations.axis.dtype)
    numbers = relations.anchor_a, relations.anchor_b, relations.axis, relations.limits, relations.yaw_offset[..., None]
    return _rows(torch.cat((flags, *numbers), -1), joint)


def _in_contact_frame(
    near: Near, anchor_a: Tensor, anchor_b: Tensor, axis: Tensor, centre_a: Tensor, centre_b: Tensor
) -> tuple[Tensor, Tensor]:
    """Levers of the first end to two contacts and the joint, those of the second, the joint's drift and its axis,
    [pairs, 8, 2] (m) in contact frame; and the normal in the world. One complex product turns a planar vector."""
    pose_a, pose_b = near.poses
    yaw_a, yaw_ab = pose_a[:, 2].float(), (pose_b[:, 2] - pose_a[:, 2]).float()
    turn_a, turn_ab = torch.complex(yaw_a.cos(), yaw_a.sin()), torch.complex(yaw_ab.cos(), yaw_ab.sin())
    # Subtracted before anything is turned or rounded, so that nothing is lost far from the origin.
    positions = torch.stack((centre_a, centre_b, pose_b[:, :2]), 1) - pose_a[:, None, :2]
    positions = pose.as_complex(positions.float()) * turn_a.conj()[:, None]
    anchor_a, anchor_b, axis = anchor_a[:, None], anchor_b * turn_ab + positions[:, 2], axis[:, None]
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
    hinge = edges[:, _COLUMN["revolute"], None] > 0
    hinges, others = (edges.index_select(1, columns.to(edges.device)) for columns in (_OTHER_END_OF_HINGE, _OTHER_END))
    return torch.where(hinge, hinges, others) * _SIGN.to(edges)


def _exchanged(a: str, b: str, names: Sequence[str]) -> list[str]:
    """The names, those that begin with `a` exchanged with those that begin with `b` where there are both."""
    swap = {name: b + name.removeprefix(a) for name in names if name.startswith(a)}
    swap = {one: other for one, other in swap.items() if other in names}
    swap |= {other: one for one, other in swap.items()}
    return [swap.get(name, name) for name in names]


_SWAPPED = _exchanged("receiver", "sender", EDGE_FEATURES)
_OTHER_END = torch.tensor([_COLUMN[name] for name in _SWAPPED])
_OTHER_END_OF_HINGE = torch.tensor([_COLUMN[name] for name in _exchanged("slack_low", "slack_high", _SWAPPED)])
_SIGN = torch.tensor([-1.0 if re.search("_lever_|^turn|_last_[xy]", name) else 1.0 for name in EDGE_FEATURES])


def in_frame(
    twist: Float[Tensor, "*batch edges 3"], normal: Float[Tensor, "edges 2"]
) -> Float[Tensor, "*batch edges 3"]:
    """A twist in a contact frame, given that frame's x-axis; both in world axes."""
    x, y, (along, across, turn) = normal[:, 0], normal[:, 1], twist.unbind(-1)
    return torch.stack((along * x + across * y, across * x - along * y, turn), -1)
