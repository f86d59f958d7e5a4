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

LEVER, PASSED = broad_phase.LEVER, contact_graph.PASSED
FIXED = JOINT_CODES["fixed"]


@compiled
def pair_of(a: int, b: int, bodies: int) -> int:
    """Where the pair of two bodies stands in `pairs_of`."""
    if a > b:
        a, b = b, a
    return a * bodies - a * (a + 1) // 2 + b - a - 1


@compiled
def place_bodies(scenes: Scenes, scene: int, bodies: np.ndarray) -> float:
    """Fill in the bodies; return how far the fastest point of those that slide goes in a frame (m)."""
    half, fastest = scenes.frames[scene] / 2, 0.0
    for k in range(scenes.poses.shape[1]):
        body = bodies[k]
        body.present, body.immovable = scenes.present[scene, k], scenes.immovable[scene, k]
        body.group, body.piece, body.keep = scenes.group[scene, k], -1, -math.inf
        _set_shape(body, scenes.half_extents[scene, k], scenes.radius[scene, k])
        body.mass, body.gyration = scenes.mass[scene, k], scenes.gyration[scene, k]
        body.com_x, body.com_y = scenes.centre_of_mass[scene, k, 0], scenes.centre_of_mass[scene, k, 1]
        body.start_x, body.start_y = scenes.poses[scene, k, 0], scenes.poses[scene, k, 1]
        body.start_yaw = scenes.poses[scene, k, 2]
        body.motion_x, body.motion_y = scenes.motions[scene, k, 0], scenes.motions[scene, k, 1]
        body.motion_yaw = scenes.motions[scene, k, 2]
        ahead = 0.0 if body.immovable else half
        body.x, body.y = body.start_x + ahead * body.motion_x, body.start_y + ahead * body.motion_y
        body.yaw = body.start_yaw + ahead * body.motion_yaw
        speed = math.sqrt(body.motion_x * body.motion_x + body.motion_y * body.motion_y) + LEVER * abs(body.motion_yaw)
        body.slides = body.present and not body.immovable and speed > scenes.still
        if body.slides:
            fastest = max(fastest, speed)
    return fastest


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
    body.circle = math.sqrt(body.half_x * body.half_x + body.half_y * body.half_y) + radius


@compiled
def reach(
    scenes: Scenes, scene: int, graph: Graph, movable: int, tool_moves: bool, widest: float
) -> tuple[int, int]:
    """Nodes and edges that chains of edges tie to what moves; none goes on beyond what cannot move."""
    bodies, kind = graph.bodies, scenes.kind[scene]
    links, link_body, link_keep = scenes.link_begin[scene * movable :], scenes.link_body, scenes.link_keep
    nodes = edges = members = 0
    if tool_moves:
        tool = graph.nodes[0]
        tool.begin, tool.given, tool.is_tool = 0, 1, 1
        for part in range(movable, len(bodies)):
            if bodies[part].present:
                graph.member[members] = part
                members += 1
        tool.end = members
        nodes = 1
    for body in range(movable):
        if bodies[body].piece < 0 and bodies[body].slides:
            members = _add_piece(kind, links, link_body, graph, movable, body, nodes, members)
            nodes += 1
    node = 0
    while node < nodes:
        if graph.nodes[node].given and not graph.nodes[node].is_tool:
            node += 1
            continue
        for k in range(graph.nodes[node].begin, graph.nodes[node].end):
            here = graph.member[k]
            if here < movable:
                for link in range(links[here], links[here + 1]):
                    bodies[link_body[link]].keep = link_keep[link]
            for there in range(movable):
                other = bodies[there].piece
                # Pairs with nodes before this one are known, but for those that cannot move.
                seen = other >= 0 and other < node and not graph.nodes[other].given
                if other == node or seen or not bodies[there].present:
                    continue
                a, b, keep = min(here, there), max(here, there), bodies[there].keep
                x, y = bodies[b].start_x - bodies[a].start_x, bodies[b].start_y - bodies[a].start_y
                if not math.sqrt(x * x + y * y) - (bodies[a].circle + bodies[b].circle) < max(keep, widest):
                    continue
                edge = graph.edges[edges]
                if not _set_edge(edge, bodies[a], bodies[b], keep, widest):
                    continue
                edge.first_body, edge.second_body = a, b
                edge.relation = pair_of(a, b, movable) if b < movable else -1
                edges += 1
                if other < 0:
                    members = _add_piece(kind, links, link_body, graph, movable, there, nodes, members)
                    nodes += 1
            if here < movable:
                for link in range(links[here], links[here + 1]):
                    bodies[link_body[link]].keep = -math.inf
        node += 1
    for k in range(edges):
        edge = graph.edges[k]
        edge.first = bodies[edge.first_body].piece
        edge.second = bodies[edge.second_body].piece if edge.second_body < movable else 0
    return nodes, edges


@compiled
def _add_piece(kind, links, link_body, graph, movable, body, node, members):
    """Make a node of the bodies that move as one with a body."""
    bodies = graph.bodies
    begin, given = members, 0
    graph.member[members] = body
    bodies[body].piece = node
    members += 1
    k = begin
    while k < members:
        here = graph.member[k]
        given |= bodies[here].immovable
        for there in range(movable):
            if bodies[there].piece >= 0 or not bodies[there].present:
                continue
            if bodies[there].group == bodies[here].group:
                graph.member[members] = there
                bodies[there].piece = node
                members += 1
        for link in range(links[here], links[here + 1]):
            there = link_body[link]
            if bodies[there].piece < 0 and kind[pair_of(here, there, movable)] == FIXED:
                graph.member[members] = there
                bodies[there].piece = node
                members += 1
        k += 1
    piece = graph.nodes[node]
    piece.begin, piece.end, piece.given, piece.is_tool = begin, members, given, 0
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
