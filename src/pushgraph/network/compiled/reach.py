"""What a push may move, of one scene: `broad_phase` and the edges of `contact_graph`, from body to body.

Nodes are numbered as they are reached, so that what is coupled stands close together in the linear system.
"""

import math

import numpy as np

from pushgraph.graph import broad_phase, contact_graph
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.network.compiled.arrays import Graph, Scenes
from pushgraph.network.compiled.contact import contact_of
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.links import pair_of

LEVER, PASSED = broad_phase.LEVER, contact_graph.PASSED
FIXED = JOINT_CODES["fixed"]


@compiled
def find_sliding(scenes: Scenes, scene: int, graph: Graph) -> float:
    """Begin a graph, find the bodies that slide, and return how far their fastest point goes in a frame (m)."""
    farthest = 0.0
    for k in range(scenes.poses.shape[1]):
        graph.piece[k], graph.placed[k], graph.keep[k] = -1, False, -math.inf
        graph.slides[k] = False
        x, y, turn = scenes.motions[scene, k, 0], scenes.motions[scene, k, 1], scenes.motions[scene, k, 2]
        if x == 0.0 and y == 0.0 and turn == 0.0:
            continue
        speed = math.sqrt(x * x + y * y) + LEVER * abs(turn)
        if speed > scenes.still and scenes.present[scene, k] and not scenes.immovable[scene, k]:
            graph.slides[k] = True
            farthest = max(farthest, speed)
    return farthest


@compiled
def _place_body(scenes, scene, graph, k):
    """Fill in a body, if it is not yet."""
    if graph.placed[k]:
        return
    graph.placed[k] = True
    body = graph.bodies[k]
    body.immovable = scenes.immovable[scene, k]
    _set_shape(body, scenes.half_extents[scene, k], scenes.radius[scene, k])
    body.mass, body.gyration = scenes.mass[scene, k], scenes.gyration[scene, k]
    body.com_x, body.com_y = scenes.centre_of_mass[scene, k, 0], scenes.centre_of_mass[scene, k, 1]
    body.start_x, body.start_y = scenes.poses[scene, k, 0], scenes.poses[scene, k, 1]
    body.start_yaw = scenes.poses[scene, k, 2]
    body.motion_x, body.motion_y = scenes.motions[scene, k, 0], scenes.motions[scene, k, 1]
    body.motion_yaw = scenes.motions[scene, k, 2]
    ahead = 0.0 if body.immovable else scenes.frames[scene] / 2
    body.x, body.y = body.start_x + ahead * body.motion_x, body.start_y + ahead * body.motion_y
    body.yaw = body.start_yaw + ahead * body.motion_yaw


@compiled
def place_tool(scenes: Scenes, scene: int, parts: np.ndarray) -> None:
    """Fill in the tool's parts."""
    first = scenes.poses.shape[1]
    x, y, yaw = scenes.tool_pose[scene, 0], scenes.tool_pose[scene, 1], scenes.tool_pose[scene, 2]
    x_ahead, y_ahead = x + scenes.tool_motion[scene, 0] / 2, y + scenes.tool_motion[scene, 1] / 2
    yaw_ahead = yaw + scenes.tool_motion[scene, 2] / 2
    cos, sin = math.cos(yaw), math.sin(yaw)
    cos_ahead, sin_ahead = math.cos(yaw_ahead), math.sin(yaw_ahead)
    for k in range(len(parts)):
        part = parts[k]
        part.present = scenes.part_present[scene, k]
        _set_shape(part, scenes.half_extents[scene, first + k], scenes.radius[scene, first + k])
        own_x, own_y = scenes.pose_tool_from_part[scene, k, 0], scenes.pose_tool_from_part[scene, k, 1]
        own_yaw = scenes.pose_tool_from_part[scene, k, 2]
        part.start_x, part.start_y = x + cos * own_x - sin * own_y, y + sin * own_x + cos * own_y
        part.x = x_ahead + cos_ahead * own_x - sin_ahead * own_y
        part.y = y_ahead + sin_ahead * own_x + cos_ahead * own_y
        part.start_yaw, part.yaw = yaw + own_yaw, yaw_ahead + own_yaw


@compiled
def _set_shape(body, half_extents, radius):
    body.half_x, body.half_y, body.radius = half_extents[0], half_extents[1], radius


@compiled
def reach(
    scenes: Scenes, scene: int, graph: Graph, tool_moves: bool, widest: float
) -> tuple[int, int]:
    """Nodes and edges that chains of edges tie to what moves; none goes on beyond what cannot move."""
    movable = scenes.poses.shape[1]
    links, link_body, link_keep = scenes.link_begin[scene * movable :], scenes.link_body, scenes.link_keep
    present, poses, circle = scenes.present[scene], scenes.poses[scene], scenes.circle[scene]
    nodes = edges = members = 0
    if tool_moves:
        tool = graph.nodes[0]
        tool.begin, tool.given, tool.is_tool = 0, 1, 1
        for part in range(movable, len(graph.bodies)):
            if graph.bodies[part].present:
                graph.member[members] = part
                members += 1
        tool.end = members
        nodes = 1
    for body in range(movable):
        if graph.slides[body] and graph.piece[body] < 0:
            members = _add_piece(scenes, scene, graph, body, nodes, members)
            nodes += 1
    node = 0
    while node < nodes:
        if graph.nodes[node].given and not graph.nodes[node].is_tool:
            node += 1
            continue
        for k in range(graph.nodes[node].begin, graph.nodes[node].end):
            here = graph.member[k]
            x, y = graph.bodies[here].start_x, graph.bodies[here].start_y
            if here < movable:
                for link in range(links[here], links[here + 1]):
                    graph.keep[link_body[link]] = link_keep[link]
            for there in range(movable):
                apart_x, apart_y = poses[there, 0] - x, poses[there, 1] - y
                reached = max(graph.keep[there], widest) + circle[here] + circle[there]
                if not apart_x * apart_x + apart_y * apart_y < reached * reached or reached <= 0.0:
                    continue
                other = graph.piece[there]
                # Pairs with nodes before this one are known, but for those that cannot move.
                seen = other >= 0 and other < node and not graph.nodes[other].given
                if other == node or seen or not present[there]:
                    continue
                _place_body(scenes, scene, graph, there)
                a, b = min(here, there), max(here, there)
                edge = graph.edges[edges]
                if not _set_edge(edge, graph.bodies[a], graph.bodies[b], graph.keep[there], widest):
                    continue
                edge.first_body, edge.second_body = a, b
                edge.relation = pair_of(a, b, movable) if b < movable else -1
                edges += 1
                if other < 0:
                    members = _add_piece(scenes, scene, graph, there, nodes, members)
                    nodes += 1
            if here < movable:
                for link in range(links[here], links[here + 1]):
                    graph.keep[link_body[link]] = -math.inf
        node += 1
    for k in range(edges):
        edge = graph.edges[k]
        edge.first = graph.piece[edge.first_body]
        edge.second = graph.piece[edge.second_body] if edge.second_body < movable else 0
    return nodes, edges


@compiled
def _add_piece(scenes, scene, graph, body, node, members):
    """Make a node of the bodies that move as one with a body."""
    movable, group, piece = scenes.poses.shape[1], scenes.group[scene], graph.piece
    links, link_body = scenes.link_begin[scene * movable :], scenes.link_body
    begin, given = members, 0
    graph.member[members] = body
    piece[body] = node
    members += 1
    k = begin
    while k < members:
        here = graph.member[k]
        _place_body(scenes, scene, graph, here)
        given |= graph.bodies[here].immovable
        for there in range(movable):
            if group[there] == group[here] and piece[there] < 0 and scenes.present[scene, there]:
                graph.member[members] = there
                piece[there] = node
                members += 1
        for link in range(links[here], links[here + 1]):
            there = link_body[link]
            if piece[there] < 0 and scenes.kind[scene, pair_of(here, there, movable)] == FIXED:
                graph.member[members] = there
                piece[there] = node
                members += 1
        k += 1
    added = graph.nodes[node]
    added.begin, added.end, added.given, added.is_tool = begin, members, given, 0
    return members


@compiled
def _set_edge(edge, a, b, keep, widest):
    """Fill in the edge of two bodies, if they share one."""
    contact = _between(a, b, a.x, a.y, a.yaw, b.x, b.y, b.yaw)
    edge.at_start = contact.gap < -PASSED
    if edge.at_start:
        contact = _between(a, b, a.start_x, a.start_y, a.start_yaw, b.start_x, b.start_y, b.start_yaw)
    edge.fade = 1.0 if contact.gap < keep else min(max((widest - contact.gap) / (widest / 3), 0.0), 1.0)
    if edge.fade == 0.0:
        return False
    edge.normal_x, edge.normal_y, edge.gap, edge.gap_2 = contact.normal_x, contact.normal_y, contact.gap, contact.gap_2
    edge.on_a_x, edge.on_a_y, edge.on_b_x, edge.on_b_y = contact.on_a_x, contact.on_a_y, contact.on_b_x, contact.on_b_y
    edge.on_a_x_2, edge.on_a_y_2 = contact.on_a_x_2, contact.on_a_y_2
    edge.on_b_x_2, edge.on_b_y_2 = contact.on_b_x_2, contact.on_b_y_2
    return True


@compiled
def _between(a, b, a_x, a_y, a_yaw, b_x, b_y, b_yaw):
    """Contact of two bodies at these poses, in the frame of the first."""
    x, y, cos, sin = b_x - a_x, b_y - a_y, math.cos(a_yaw), math.sin(a_yaw)
    return contact_of(
        a.half_x,
        a.half_y,
        a.radius,
        b.half_x,
        b.half_y,
        b.radius,
        cos * x + sin * y,
        cos * y - sin * x,
        b_yaw - a_yaw,
    )
