"""What the network sees of a contact graph: numbers that do not change when the scene is moved or turned.

Its edges are the points that two nodes share, contacts and anchors of joints. Each is seen from both of its ends, in a
contact frame: x along the normal from receiver to sender, y to the left of that. In a mirror the numbers named in ODD
change sign, a hinge's limits change places, and nothing else does.
"""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional

from pushgraph.graph.broad_phase import LEVER
from pushgraph.graph.contact_graph import ContactGraph, Points, relative_motion
from pushgraph.graph.state import State
from pushgraph.scene import NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION

CLAMP = 4.0
"""Numbers of steps beyond this are given as this."""
STEP, CENTIMETRE, FRICTION = 0.01, 0.01, 0.1
"""Units of the step's length (m), of gaps and drifts (m), and of friction off its nominal value."""

NODE_FEATURES = (
    *("mass", "mass_known", "gyration", "table_friction", "table_friction_known"),
    *("is_tool", "given", "step", "inertia"),
)
EDGE_FEATURES = (
    *("contact", "revolute", "prismatic", "fade", "sender_is_tool", "sender_given"),
    *("receiver_yaw_known", "sender_yaw_known", "unknown", "remembered", "step"),
    *("side_friction", "side_friction_known", "gap_steps", "gap"),
    *("receiver_lever_x", "receiver_lever_y", "sender_lever_x", "sender_lever_y"),
    *("approach_x", "approach_y", "turning", "drift_x", "drift_y", "turn", "axis_x", "axis_y"),
    *("low_steps", "high_steps", "low", "high"),
    *(f"{end}_last_{part}" for end in ("receiver", "sender") for part in ("x", "y", "turn")),
)
ODD = (
    *("receiver_lever_y", "sender_lever_y", "approach_y", "turning", "drift_y", "turn", "axis_y"),
    *(f"{end}_last_{part}" for end in ("receiver", "sender") for part in ("y", "turn")),
)
CONSTANTS = {"clamp": CLAMP, "lever": LEVER}
"""What the weights depend on beside the features' names."""


class ContactFeatures(NamedTuple):
    """Features of nodes and of edges: contacts, then joints, and then all of them seen from their other ends.

    weight: how much an edge counts.
    """

    nodes: Float[Tensor, "nodes node_features"]
    edges: Float[Tensor, "directed edge_features"]
    receiver: Int[Tensor, " directed"]
    sender: Int[Tensor, " directed"]
    weight: Float[Tensor, " directed"]


def contact_features(state: State, graph: ContactGraph) -> ContactFeatures:
    """Features of a graph, float32."""
    contacts, joints, edges = graph.contacts, graph.joints, graph.edges
    points = Points(*(torch.cat(pair, -1) for pair in zip(contacts.points, joints.points, strict=True)))
    weight = edges.fade[points.edge] * torch.cat((contacts.share, torch.ones_like(joints.turn)))
    ends = torch.stack((points.first, points.second))
    return ContactFeatures(
        nodes=_node_features(state, graph),
        edges=_edge_features(state, graph, points),
        receiver=ends.flatten(),
        sender=ends.flip(0).flatten(),
        weight=torch.cat((weight, weight)).float(),
    )


def mirrored(features: Float[Tensor, "directed edge_features"]) -> Float[Tensor, "directed edge_features"]:
    """Edges as a mirror shows them."""
    hinge = features[:, _COLUMN["revolute"], None] > 0
    exchanged = features.index_select(1, _EXCHANGED.to(features.device))
    return torch.where(hinge, exchanged, features) * _SIGN.to(features)


_COLUMN = {name: k for k, name in enumerate(EDGE_FEATURES)}
_SIGN = torch.tensor([-1.0 if name in ODD else 1.0 for name in EDGE_FEATURES])
_OTHER = {"low": "high", "high": "low", "low_steps": "high_steps", "high_steps": "low_steps"}
_EXCHANGED = torch.tensor([_COLUMN[_OTHER.get(name, name)] for name in EDGE_FEATURES])


def _node_features(state: State, graph: ContactGraph) -> Tensor:
    nodes, scenes = graph.nodes, state.scenes
    friction = (scenes.table_friction - NOMINAL_TABLE_FRICTION) / FRICTION
    known = (scenes.mass_known | ~scenes.present).long()
    known = torch.ones_like(known).scatter_reduce(1, graph.pieces.index, known, "amin").flatten()[nodes.body]
    features = (
        nodes.mass.clamp(1e-4, 1e4).log(),
        torch.where(nodes.given | nodes.is_tool, 1, known),
        nodes.gyration.sqrt(),
        friction[nodes.scene],
        scenes.table_friction_known[nodes.scene],
        nodes.is_tool,
        nodes.given,
        (nodes.step / STEP).log(),
        nodes.inertia.clamp(min=1e-3).log(),
    )
    return torch.stack([values.float() for values in features], -1)


def _edge_features(state: State, graph: ContactGraph, points: Points) -> Tensor:
    scenes, edges, nodes, joints = state.scenes, graph.edges, graph.nodes, graph.joints
    contacts = len(graph.contacts.gap)
    edge = points.edge
    normal = edges.normal[:, edge]
    step = nodes.step[points.first]
    relation = edges.relation[edge].clamp(min=0)
    is_tool = edges.is_tool[edge]
    side = (scenes.side_friction - NOMINAL_SIDE_FRICTION) / FRICTION

    def of_contacts(values: Tensor) -> Tensor:
        return functional.pad(values, (0, len(edge) - contacts))

    def of_joints(values: Tensor) -> Tensor:
        return functional.pad(values, (contacts, 0))

    ends = torch.stack((points.first, points.second))
    yaw_known = scenes.yaw_known.flatten()
    yaw_known = torch.stack((yaw_known[edges.first_body[edge]], yaw_known[edges.second_body[edge]] | is_tool))
    levers = torch.stack((points.first_arm, points.second_arm))
    last = nodes.last_twist.clamp(-CLAMP, CLAMP)
    approach_x, approach_y, turning = relative_motion(points, last)
    drift = torch.stack([of_joints(values) for values in joints.drift]) * (step / CENTIMETRE)
    axis = torch.stack([of_joints(values) for values in joints.axis])
    turn = of_joints(joints.turn) * step / LEVER
    low, high = of_joints(joints.low), of_joints(joints.high)

    # What both ends see alike, and what the receiver sees in its own frame: x is towards the sender.
    same = (
        of_contacts(torch.ones_like(graph.contacts.gap)),
        of_joints(joints.revolute.float()),
        of_joints((~joints.revolute).float()),
        edges.fade[edge],
    )
    common = (
        ~state.relations.known.flatten()[relation] & ~is_tool,
        state.relations.remembered.flatten()[relation] & ~is_tool,
        (step / STEP).log(),
        side[edges.scene[edge]],
        scenes.side_friction_known[edges.scene[edge]],
        *_lengths(of_contacts(graph.contacts.gap), step),
    )
    relative = (
        *_in_frame(torch.stack((approach_x, approach_y)), normal),
        turning,
        *_in_frame(drift.tanh(), normal),
        turn.tanh(),
        *_in_frame(axis, normal),
    )
    # Seen from the other end, relative motions and both axes of the frame turn round; a hinge's limits change places.
    hinge = of_joints(joints.revolute.float()) > 0
    limits = (low, high), (torch.where(hinge, high, low), torch.where(hinge, low, high))
    views = []
    for receiver, sender, towards, sign in ((0, 1, normal, 1.0), (1, 0, -normal, -1.0)):
        approach_x, approach_y, turning, drift_x, drift_y, turn, axis_x, axis_y = relative
        (low_steps, low), (high_steps, high) = (_lengths(limit, step) for limit in limits[receiver])
        columns = (
            *same,
            nodes.is_tool[ends[sender]],
            nodes.given[ends[sender]],
            yaw_known[receiver],
            yaw_known[sender],
            *common,
            *_in_frame(levers[receiver], towards),
            *_in_frame(levers[sender], towards),
            *(approach_x, approach_y, sign * turning),
            *(drift_x, drift_y, sign * turn),
            *(axis_x, axis_y, low_steps, high_steps, low, high),
            *(part for end in (receiver, sender) for part in _twist_in_frame(last[:, ends[end]], towards)),
        )
        views.append(torch.stack([values.float() for values in columns], -1))
    return torch.cat(views)


def _twist_in_frame(twist: Float[Tensor, "3 edges"], normal: Float[Tensor, "2 edges"]) -> tuple[Tensor, ...]:
    return *_in_frame(twist[:2], normal), twist[2]


def _lengths(values: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
    """A length in steps, and the same in centimetres where it matters."""
    return values.clamp(-CLAMP, CLAMP), (values * step / CENTIMETRE).tanh()


def _in_frame(vectors: Float[Tensor, "2 edges"], normal: Float[Tensor, "2 edges"]) -> tuple[Tensor, Tensor]:
    x, y = normal
    return vectors[0] * x + vectors[1] * y, vectors[1] * x - vectors[0] * y
