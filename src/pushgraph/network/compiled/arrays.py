"""What the compiled solve reads, the tensors of states and controls as arrays, and the records that it works with."""

from typing import NamedTuple

import numpy as np
from torch import Tensor

from pushgraph.graph.broad_phase import node_shapes
from pushgraph.graph.scene_batch import Relations
from pushgraph.graph.state import Control, State
from pushgraph.network.compiled.links import links_of


class Scenes(NamedTuple):
    """Fields of State, SceneBatch, Relations and Control, the scenes first; see there for shapes and units.

    half_extents, radius, circle (around them): of bodies, then of the tool's parts. Links: pairs that may share an edge
    however far apart, from both ends; those of a body begin at link_begin[scene * bodies + body]. link_keep: gap (m) up
    to which they do.
    """

    poses: np.ndarray
    motions: np.ndarray
    still: float
    present: np.ndarray
    immovable: np.ndarray
    group: np.ndarray
    mass: np.ndarray
    centre_of_mass: np.ndarray
    gyration: np.ndarray
    half_extents: np.ndarray
    radius: np.ndarray
    circle: np.ndarray
    feet_points: np.ndarray
    feet_shares: np.ndarray
    feet_radii: np.ndarray
    table_friction: np.ndarray
    anisotropy: np.ndarray
    side_friction: np.ndarray
    part_present: np.ndarray
    pose_tool_from_part: np.ndarray
    tool_radius: np.ndarray
    link_begin: np.ndarray
    link_body: np.ndarray
    link_keep: np.ndarray
    kind: np.ndarray
    anchor_a: np.ndarray
    anchor_b: np.ndarray
    yaw_offset: np.ndarray
    axis: np.ndarray
    limits: np.ndarray
    tool_pose: np.ndarray
    tool_motion: np.ndarray
    tool_down: np.ndarray
    frames: np.ndarray
    last_frames: np.ndarray
    force_limit: np.ndarray


def arrays_of(state: State, control: Control) -> Scenes:
    """The arrays of a state and of what the tool does next."""
    scenes, relations = state.scenes, state.relations
    of_scenes = (scenes.present, scenes.immovable, scenes.group, scenes.mass, scenes.centre_of_mass, scenes.gyration)
    of_tables = (scenes.table_friction, scenes.anisotropy, scenes.side_friction)
    of_tools = (scenes.part_present, scenes.pose_tool_from_part, scenes.tool_radius)
    shapes = node_shapes(scenes)
    circle = shapes.half_extents.norm(dim=-1) + shapes.radius
    of_joints = (relations.kind, relations.anchor_a, relations.anchor_b, relations.yaw_offset, relations.axis)
    arrays = [as_array(values) for values in (*of_scenes, *shapes, circle, *scenes.feet, *of_tables, *of_tools)]
    arrays += _links(relations, state.poses.shape[1])
    arrays += [as_array(values) for values in (*of_joints, relations.limits)]
    arrays += [as_array(values) for values in (control.pose, control.motion, control.down)]
    of_steps = (control.frames, control.last_frames, control.force_limit)
    arrays += [of_each(values, len(state.poses)) for values in of_steps]
    return Scenes(as_array(state.poses), as_array(state.motions), float(state.still), *arrays)


def _links(relations: Relations, bodies: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See `links_of`. Steps of a rollout share their relations, and looking at all pairs of 200 bodies in each would
    take longer than solving it: so what was found last is kept."""
    global _last_links
    key = relations.kind, relations.known, relations.remembered
    last, links = _last_links  # at once: other threads may come in between
    if not all(one is other for one, other in zip(key, last, strict=True)):
        links = links_of(*map(as_array, key), bodies)
        _last_links = key, links
    return links


_NOTHING = np.zeros(0)
_last_links: tuple[tuple[Tensor | None, ...], tuple[np.ndarray, np.ndarray, np.ndarray]] = (
    (None, None, None),
    (_NOTHING, _NOTHING, _NOTHING),
)


def of_each(values: Tensor | float, scenes: int) -> np.ndarray:
    """Numbers of scenes, or one of all of them, as an array in float64."""
    return as_array(values.double()) if isinstance(values, Tensor) else np.full(scenes, values, np.float64)


def as_array(values: Tensor) -> np.ndarray:
    """The same, floating-point numbers in float64."""
    array = values.numpy(force=True)
    return np.ascontiguousarray(array, np.float64 if array.dtype.kind == "f" else None)


BODY = np.dtype(
    [(name, np.int64) for name in ("present", "immovable")]
    + [(name, np.float64) for name in ("half_x", "half_y", "radius", "mass", "com_x", "com_y", "gyration")]
    + [(name, np.float64) for name in ("start_x", "start_y", "start_yaw", "x", "y", "yaw")]
    + [(name, np.float64) for name in ("motion_x", "motion_y", "motion_yaw")]
)
"""A body, or a part of the tool. x, y, yaw: in the middle of the step."""
NODE = np.dtype(
    [(name, np.int64) for name in ("begin", "end", "row", "given", "is_tool")]
    + [(name, np.float64) for name in ("mass", "gyration", "x", "y", "start_x", "start_y")]
    + [(name, np.float64) for name in ("last_x", "last_y", "last_turn", "inertia")]
)
"""See `contact_graph.Nodes`. begin, end: where its members, bodies or parts of the tool, stand in `Graph.member`.
row: where its unknowns begin, -1 where its motion is given. x, y: its centre in the middle of the step."""
FOOT = np.dtype([("node", np.int64)] + [(name, np.float64) for name in ("turns_x", "turns_y", "weight", "radius")])
"""See `contact_graph.Feet`. turns_x, turns_y: how it slides as its node turns, stretched; see `energy.stretched`."""
EDGE = np.dtype(
    [(name, np.int64) for name in ("first_body", "second_body", "first", "second", "relation", "at_start")]
    + [(name, np.float64) for name in ("fade", "normal_x", "normal_y")]
    + [(name, np.float64) for name in ("gap", "on_a_x", "on_a_y", "on_b_x", "on_b_y")]
    + [(name, np.float64) for name in ("gap_2", "on_a_x_2", "on_a_y_2", "on_b_x_2", "on_b_y_2")]
)
"""See `contact_graph.Edges`; and the contact of its two shapes in the frame of the first (m), see `PairContact`.
first_body, second_body: bodies, then the tool's parts. relation: -1 for the tool's."""
_POINT: list[tuple[str, type]] = [(name, np.int64) for name in ("edge", "first", "second")]
_POINT += [(name, np.float64) for name in ("arm_1x", "arm_1y", "arm_2x", "arm_2y")]
CONTACT = np.dtype(
    _POINT + [(name, np.float64) for name in ("normal_x", "normal_y", "gap", "friction", "share", "stiffness")]
    + [(name, np.float64) for name in ("depth", "slip", "grip", "held", "off", "following")]
    + [(name, np.float64) for name in ("parting", "slipping")]
)
"""See `contact_graph.Points` and `Contacts`; stiffness to grip, parting and slipping as in `contact_problem.Moment` and
`Slope`, held to following as in `newton.Held`."""
JOINT = np.dtype(
    _POINT + [("revolute", np.int64)]
    + [(name, np.float64) for name in ("drift_x", "drift_y", "turn", "axis_x", "axis_y", "low", "high")]
)
"""See `contact_graph.Joints`."""


class Graph(NamedTuple):
    """Room for the graph of one scene, used for one after the other.

    bodies: those of the scene, then the tool's parts. member: see NODE. Of each body: slides, whether it moves already;
    placed, whether it is filled in; piece, its node, -1 if it has none; keep, of its link with the body in question.
    """

    bodies: np.ndarray
    slides: np.ndarray
    placed: np.ndarray
    piece: np.ndarray
    keep: np.ndarray
    nodes: np.ndarray
    member: np.ndarray
    feet: np.ndarray
    edges: np.ndarray
    contacts: np.ndarray
    joints: np.ndarray


class Counts(NamedTuple):
    """How many of each there are in a graph. length: of the step (m). grain_x, grain_y: anisotropy, see
    SceneBatch. See `contact_graph.Drives` for the rest: drive is zero where the tool has no limit."""

    nodes: int
    feet: int
    edges: int
    contacts: int
    joints: int
    length: float
    grain_x: float
    grain_y: float
    drive: float
    axis_x: float
    axis_y: float
    limit: float


def room_for(scenes: Scenes) -> Graph:
    """Room for the graph of any of the scenes."""
    bodies, nodes = scenes.poses.shape[1], scenes.radius.shape[1]
    edges = bodies * (bodies - 1) // 2 + bodies * (nodes - bodies)
    return Graph(
        np.zeros(nodes, BODY),
        np.empty(bodies, np.bool_),
        np.empty(bodies, np.bool_),
        np.empty(bodies, np.int64),
        np.empty(bodies),
        np.empty(bodies + 1, NODE),
        np.empty(nodes, np.int64),
        np.empty(bodies * scenes.feet_shares.shape[2], FOOT),
        np.empty(edges, EDGE),
        np.empty(2 * edges, CONTACT),
        np.empty(edges, JOINT),
    )


class System(NamedTuple):
    """Room for the linear system of one scene.

    twist, direction: of nodes. matrix: lower triangle of the curvature, then its factors. first: of each row the first
    column that is not zero. right: the right side, then the solution. gradient: that of the energy.
    """

    twist: np.ndarray
    direction: np.ndarray
    matrix: np.ndarray
    first: np.ndarray
    right: np.ndarray
    gradient: np.ndarray


def room_for_system(bodies: int) -> System:
    """Room for scenes of so many bodies."""
    unknowns = 3 * (bodies + 1)
    return System(
        np.zeros((bodies + 1, 3)),
        np.zeros((bodies + 1, 3)),
        np.empty((unknowns, unknowns)),
        np.empty(unknowns, np.int64),
        np.empty(unknowns),
        np.empty(unknowns),
    )
