"""The graph of one scene: `contact_graph`, nodes with their feet, contacts and joints."""

import math

from pushgraph.graph import broad_phase, contact_graph
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.graph.state import STILL
from pushgraph.network.compiled.arrays import Counts, Graph, Scenes
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.reach import LEVER, find_sliding, place_tool, reach
from pushgraph.track import FRAME

MARGIN, LENGTHS_CLOSED = broad_phase.MARGIN, broad_phase.LENGTHS_CLOSED
GRAVITY, TWINS, SAME_POINT = contact_graph.GRAVITY, contact_graph.TWINS, contact_graph.SAME_POINT
PRISMATIC, REVOLUTE = JOINT_CODES["prismatic"], JOINT_CODES["revolute"]


@compiled
def build(scenes: Scenes, scene: int, graph: Graph) -> Counts:
    """Build the graph of a scene; its length is zero where nothing moves."""
    travel = 0.0
    if scenes.tool_down[scene]:
        travel = math.hypot(scenes.tool_motion[scene, 0], scenes.tool_motion[scene, 1])
        travel += abs(scenes.tool_motion[scene, 2]) * scenes.tool_radius[scene]
    length = max(travel, find_sliding(scenes, scene, graph) * scenes.frames[scene])
    if length <= 0.0:
        return Counts(0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    place_tool(scenes, scene, graph.bodies[scenes.poses.shape[1] :])
    way_x, way_y = scenes.tool_motion[scene, 0], scenes.tool_motion[scene, 1]
    drive, limit = 0.0, scenes.force_limit[scene]
    if travel > STILL and limit < math.inf:
        drive = math.sqrt(way_x * way_x + way_y * way_y)
    nodes, edges = reach(scenes, scene, graph, travel > STILL, MARGIN + LENGTHS_CLOSED * length)
    could_push = limit / (GRAVITY * scenes.table_friction[scene]) if drive > 0.0 else 0.0
    feet, total = _weigh(scenes, scene, graph, nodes, length, could_push)
    contacts = _contacts(scenes.kind[scene], scenes.side_friction[scene], graph, edges, length)
    joints = _joints(scenes, scene, graph, edges, length)
    grain_x, grain_y = scenes.anisotropy[scene, 0], scenes.anisotropy[scene, 1]
    ahead_x = ahead_y = share = 0.0
    if drive > 0.0:
        ahead_x, ahead_y, share = way_x / drive, way_y / drive, could_push / total
    return Counts(
        nodes, feet, edges, contacts, joints, length, grain_x, grain_y, drive / length, ahead_x, ahead_y, share
    )


@compiled
def _weigh(scenes, scene, graph, nodes, length, could_push):
    """Fill in the nodes and their feet; return how many feet there are, and the mass that masses are shares of.

    could_push: what mass the tool could push, if its force has a limit, else zero.
    """
    frames, total = scenes.frames[scene], 0.0
    time, last_time = frames * FRAME, scenes.last_frames[scene] * FRAME
    inertia = length / (GRAVITY * scenes.table_friction[scene] * time * (time + last_time) / 2)
    row = 0
    for k in range(nodes):
        node = graph.nodes[k]
        node.mass = node.gyration = 1.0
        node.inertia, node.row = inertia, -1
        if node.is_tool:
            x, y, turn = scenes.tool_motion[scene, 0], scenes.tool_motion[scene, 1], scenes.tool_motion[scene, 2]
            node.x, node.y = scenes.tool_pose[scene, 0] + x / 2, scenes.tool_pose[scene, 1] + y / 2
            node.last_x, node.last_y, node.last_turn = x / length, y / length, turn * LEVER / length
            if could_push > 0.0:
                node.given, node.inertia, node.row, row = 0, 0.0, row, row + 3
            continue
        _weigh_piece(graph, node)
        if node.given:
            node.mass = node.gyration = 1.0
            node.last_x = node.last_y = node.last_turn = 0.0
            continue
        total += node.mass
        node.row, row = row, row + 3
        node.last_x *= frames / length
        node.last_y *= frames / length
        node.last_turn *= frames * LEVER / length
    feet, total = 0, max(total, could_push, 1e-9)
    points, shares, radii = scenes.feet_points[scene], scenes.feet_shares[scene], scenes.feet_radii[scene]
    grain_x, grain_y = scenes.anisotropy[scene, 0], scenes.anisotropy[scene, 1]
    for k in range(nodes):
        node = graph.nodes[k]
        if node.given or node.is_tool:
            continue
        node.mass /= total
        for number in range(node.begin, node.end):
            member = graph.member[number]
            body = graph.bodies[member]
            cos, sin = math.cos(body.yaw), math.sin(body.yaw)
            for at in range(shares.shape[1]):
                if shares[member, at] == 0.0:
                    continue
                foot = graph.feet[feet]
                own_x, own_y = points[member, at, 0], points[member, at, 1]
                foot.node = k
                arm_x = (body.x - node.x + cos * own_x - sin * own_y) / LEVER
                arm_y = (body.y - node.y + sin * own_x + cos * own_y) / LEVER
                foot.turns_x = grain_x * -arm_y + grain_y * arm_x - arm_y
                foot.turns_y = grain_y * -arm_y - grain_x * arm_x + arm_x
                foot.weight = body.mass / total * shares[member, at]
                foot.radius = radii[member, at] / LEVER
                feet += 1
    return feet, total


@compiled
def _weigh_piece(graph, node):
    """Mass (kg), centres, gyration and last motion, a frame, of a node of bodies."""
    first = graph.bodies[graph.member[node.begin]]
    mass = x = y = start_x = start_y = last_x = last_y = last_turn = 0.0
    # Summed as offsets from the piece's first body, so that nothing is lost far from the origin.
    for k in range(node.begin, node.end):
        body = graph.bodies[graph.member[k]]
        mass += body.mass
        middle_x, middle_y = _centre(body, body.x, body.y, body.yaw)
        x += body.mass * (middle_x - first.x)
        y += body.mass * (middle_y - first.y)
        middle_x, middle_y = _centre(body, body.start_x, body.start_y, body.start_yaw)
        start_x += body.mass * (middle_x - first.start_x)
        start_y += body.mass * (middle_y - first.start_y)
        last_x += body.mass * body.motion_x
        last_y += body.mass * body.motion_y
        last_turn += body.mass * body.motion_yaw
    node.mass = mass
    node.x, node.y = first.x + x / mass, first.y + y / mass
    node.start_x, node.start_y = first.start_x + start_x / mass, first.start_y + start_y / mass
    node.last_x, node.last_y, node.last_turn = last_x / mass, last_y / mass, last_turn / mass
    gyration = 0.0
    for k in range(node.begin, node.end):
        body = graph.bodies[graph.member[k]]
        middle_x, middle_y = _centre(body, body.x, body.y, body.yaw)
        gyration += body.mass * ((middle_x - node.x) ** 2 + (middle_y - node.y) ** 2 + body.gyration)
    node.gyration = gyration / mass / LEVER**2


@compiled
def _centre(body, x, y, yaw):
    """Centre of mass of a body at a pose."""
    if body.com_x == 0.0 and body.com_y == 0.0:
        return x, y
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + cos * body.com_x - sin * body.com_y, y + sin * body.com_x + cos * body.com_y


@compiled
def _pose(body, at_start):
    """Pose of a body at the start of the step or in its middle."""
    if at_start:
        return body.start_x, body.start_y, body.start_yaw
    return body.x, body.y, body.yaw


@compiled
def relative_motion(point, first_x, first_y, first_turn, second_x, second_y, second_turn):
    """See `contact_graph.relative_motion`, without the turn."""
    x = second_x - point.arm_2y * second_turn - (first_x - point.arm_1y * first_turn)
    y = second_y + point.arm_2x * second_turn - (first_y + point.arm_1x * first_turn)
    return x, y


@compiled
def _set_arms(graph, edge, point, length, on_first_x, on_first_y, on_second_x, on_second_y):
    """Arms of points (m, world) that lie on the two bodies of an edge."""
    first, second = graph.nodes[edge.first], graph.nodes[edge.second]
    come = length / 2 * edge.at_start
    point.arm_1x = (on_first_x - first.x + come * first.last_x) / LEVER
    point.arm_1y = (on_first_y - first.y + come * first.last_y) / LEVER
    point.arm_2x = (on_second_x - second.x + come * second.last_x) / LEVER
    point.arm_2y = (on_second_y - second.y + come * second.last_y) / LEVER


@compiled
def _moved_halfway(graph, edge, point):
    """How two points have come to stand against each other since the start of the step, where the geometry is later."""
    if edge.at_start:
        return 0.0, 0.0
    first, second = graph.nodes[edge.first], graph.nodes[edge.second]
    x, y = relative_motion(
        point, first.last_x, first.last_y, first.last_turn, second.last_x, second.last_y, second.last_turn
    )
    return x / 2, y / 2


@compiled
def _contacts(kind, friction, graph, edges, length):
    """One or two contacts an edge; none between the two ends of a slider, nor between what does not move."""
    count = 0
    for number in range(edges):
        edge = graph.edges[number]
        slides = edge.relation >= 0 and kind[edge.relation] == PRISMATIC
        if slides or (graph.nodes[edge.first].given and graph.nodes[edge.second].given):
            continue
        x, y, yaw = _pose(graph.bodies[edge.first_body], edge.at_start)
        cos, sin = math.cos(yaw), math.sin(yaw)
        two = max(abs(edge.on_a_x - edge.on_a_x_2), abs(edge.on_a_y - edge.on_a_y_2)) > SAME_POINT
        for second in range(1 + int(two)):
            gap = edge.gap_2 if second else edge.gap
            a_x, a_y = (edge.on_a_x_2, edge.on_a_y_2) if second else (edge.on_a_x, edge.on_a_y)
            b_x, b_y = (edge.on_b_x_2, edge.on_b_y_2) if second else (edge.on_b_x, edge.on_b_y)
            contact = graph.contacts[count]
            contact.edge, contact.first, contact.second = number, edge.first, edge.second
            _set_arms(
                graph,
                edge,
                contact,
                length,
                x + cos * a_x - sin * a_y,
                y + sin * a_x + cos * a_y,
                x + cos * b_x - sin * b_y,
                y + sin * b_x + cos * b_y,
            )
            contact.normal_x = cos * edge.normal_x - sin * edge.normal_y
            contact.normal_y = sin * edge.normal_x + cos * edge.normal_y
            moved_x, moved_y = _moved_halfway(graph, edge, contact)
            contact.gap = gap / length - (moved_x * contact.normal_x + moved_y * contact.normal_y)
            contact.friction = friction
            contact.share = 1.0
            count += 1
    _share(graph, count)
    return count


@compiled
def _share(graph, count):
    """Contacts of the same two nodes share their stiffness, those farther away counting for less."""
    for k in range(count):
        here = graph.contacts[k]
        first = graph.nodes[here.first]
        x, y = first.x + here.arm_1x * LEVER, first.y + here.arm_1y * LEVER
        for other in range(k):
            there = graph.contacts[other]
            same = there.first == here.first and there.second == here.second
            swapped = there.first == here.second and there.second == here.first
            if not (same or swapped):
                continue
            first = graph.nodes[there.first]
            apart_x, apart_y = first.x + there.arm_1x * LEVER - x, first.y + there.arm_1y * LEVER - y
            near = max(1 - math.sqrt(apart_x * apart_x + apart_y * apart_y) / TWINS, 0.0)
            here.share += near
            there.share += near
    for k in range(count):
        graph.contacts[k].share = 1 / graph.contacts[k].share


@compiled
def _joints(scenes, scene, graph, edges, length):
    count = 0
    for number in range(edges):
        edge = graph.edges[number]
        if edge.relation < 0 or (graph.nodes[edge.first].given and graph.nodes[edge.second].given):
            continue
        kind = scenes.kind[scene, edge.relation]
        if kind != PRISMATIC and kind != REVOLUTE:
            continue
        joint = graph.joints[count]
        count += 1
        joint.edge, joint.first, joint.second, joint.revolute = number, edge.first, edge.second, kind == REVOLUTE
        x_1, y_1, yaw_1 = _pose(graph.bodies[edge.first_body], edge.at_start)
        x_2, y_2, yaw_2 = _pose(graph.bodies[edge.second_body], edge.at_start)
        cos, sin = math.cos(yaw_1), math.sin(yaw_1)
        own_x, own_y = scenes.anchor_a[scene, edge.relation, 0], scenes.anchor_a[scene, edge.relation, 1]
        x_1, y_1 = x_1 + cos * own_x - sin * own_y, y_1 + sin * own_x + cos * own_y
        cos, sin = math.cos(yaw_2), math.sin(yaw_2)
        own_x, own_y = scenes.anchor_b[scene, edge.relation, 0], scenes.anchor_b[scene, edge.relation, 1]
        x_2, y_2 = x_2 + cos * own_x - sin * own_y, y_2 + sin * own_x + cos * own_y
        drift_x, drift_y = x_2 - x_1, y_2 - y_1
        turn = yaw_2 - yaw_1 - scenes.yaw_offset[scene, edge.relation]
        turn = math.pi - (math.pi - turn) % (2 * math.pi)
        scale = LEVER
        joint.axis_x = joint.axis_y = 0.0
        if not joint.revolute:
            # Neither body comes first: the axis is carried by both, and so is the point at which it is held.
            cos, sin = math.cos(yaw_1 + turn / 2), math.sin(yaw_1 + turn / 2)
            own_x, own_y = scenes.axis[scene, edge.relation, 0], scenes.axis[scene, edge.relation, 1]
            joint.axis_x, joint.axis_y = cos * own_x - sin * own_y, sin * own_x + cos * own_y
            x_1, y_1 = x_1 + drift_x / 2, y_1 + drift_y / 2
            x_2, y_2 = x_1, y_1
            scale = 1.0
        _set_arms(graph, edge, joint, length, x_1, y_1, x_2, y_2)
        moved_x, moved_y = _moved_halfway(graph, edge, joint)
        turned = graph.nodes[edge.second].last_turn - graph.nodes[edge.first].last_turn
        joint.drift_x, joint.drift_y = drift_x / length - moved_x, drift_y / length - moved_y
        joint.turn = turn * LEVER / length - (0.0 if edge.at_start else turned / 2)
        used = joint.turn if joint.revolute else joint.drift_x * joint.axis_x + joint.drift_y * joint.axis_y
        low, high = scenes.limits[scene, edge.relation, 0], scenes.limits[scene, edge.relation, 1]
        joint.low, joint.high = used - low * scale / length, high * scale / length - used
    return count
