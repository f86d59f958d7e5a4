"""The energy of `contact_problem`, of one scene: its gradient, its curvature and its slope along a direction."""

import math
from typing import Any

import numpy as np

from pushgraph.network import contact_problem, newton
from pushgraph.network.compiled.arrays import Counts, Graph, System
from pushgraph.network.compiled.graph import relative_motion
from pushgraph.network.compiled.jit import compiled

STIFFNESS, JOINT_STIFFNESS = contact_problem.STIFFNESS, contact_problem.JOINT_STIFFNESS
SECANT, DAMPING = newton.SECANT, newton.DAMPING


@compiled
def relative(point: Any, values: np.ndarray) -> tuple[float, float, float]:
    """How a point's second node parts from its first, x, y and turn, given rows of values of all nodes."""
    first, second = point.first, point.second
    turn_1, turn_2 = values[first, 2], values[second, 2]
    x, y = relative_motion(
        point, values[first, 0], values[first, 1], turn_1, values[second, 0], values[second, 1], turn_2
    )
    return x, y, turn_2 - turn_1


@compiled
def measure(graph: Graph, counts: Counts, twist: np.ndarray) -> None:
    """Depth and slip of all contacts at a twist."""
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        x, y, _ = relative(contact, twist)
        contact.depth = -(contact.gap + x * contact.normal_x + y * contact.normal_y)
        contact.slip = y * contact.normal_x - x * contact.normal_y


@compiled
def linearize(graph: Graph, counts: Counts, system: System, unknowns: int, slip: float) -> None:
    """The curvature of the energy, and minus its gradient on the right side."""
    matrix, right = system.matrix, system.right
    for row in range(unknowns):
        right[row] = 0.0
        for column in range(system.first[row], row + 1):
            matrix[row, column] = 0.0
    foot = 0
    for k in range(counts.nodes):
        if graph.nodes[k].row >= 0:
            foot = _add_node(k, graph.nodes[k], graph.feet, foot, counts, system, slip)
    if counts.drive > 0.0:
        _add_drive(graph.nodes[0], counts, system, slip)
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        n_x, n_y = contact.normal_x, contact.normal_y
        hold, pressing = 0.0, 0.0
        if contact.depth > 0:
            hold, pressing = contact.stiffness, contact.stiffness * contact.depth
        squared = contact.slip * contact.slip + slip * slip
        drag = contact.grip / math.sqrt(squared)
        stick = drag * (1 - SECANT * contact.slip * contact.slip / squared)
        if hold == 0.0 and drag == 0.0:
            continue
        across = drag * contact.slip
        _add_point(
            contact,
            graph.nodes,
            matrix,
            right,
            -pressing * n_x - across * n_y,
            -pressing * n_y + across * n_x,
            0.0,
            hold * n_x * n_x + stick * n_y * n_y,
            (hold - stick) * n_x * n_y,
            hold * n_y * n_y + stick * n_x * n_x,
            0.0,
        )
    for k in range(counts.joints):
        _add_joint(graph.joints[k], graph.nodes, system.twist, matrix, right)
    for row in range(unknowns):
        matrix[row, row] *= 1 + DAMPING


@compiled
def _add_node(k, node, feet, foot, counts, system, slip):
    """Add inertia and table friction of a node, whose feet begin at `foot`; return where those of the next do.

    Friction is that of stretched motions, with forces and curvature stretched back.
    """
    xx = xy = yy = xt = yt = tt = force_x = force_y = torque = 0.0
    u_x, u_y, u_turn = system.twist[k, 0], system.twist[k, 1], system.twist[k, 2]
    s_x, s_y = stretched(counts, u_x, u_y)
    while foot < counts.feet and feet[foot].node == k:
        turns_x, turns_y, radius = feet[foot].turns_x, feet[foot].turns_y, feet[foot].radius
        x, y, turn = s_x + turns_x * u_turn, s_y + turns_y * u_turn, radius * u_turn
        over = 1 / math.sqrt(x * x + y * y + turn * turn + slip * slip)
        strength = feet[foot].weight * over
        less = SECANT * strength * over * over
        twist = turns_y * y + turns_x * x + radius * turn
        xx += strength - less * x * x
        xy -= less * x * y
        yy += strength - less * y * y
        xt += strength * turns_x - less * x * twist
        yt += strength * turns_y - less * y * twist
        tt += strength * (turns_y * turns_y + turns_x * turns_x + radius * radius) - less * twist * twist
        force_x += strength * x
        force_y += strength * y
        torque += strength * twist
        foot += 1
    force_x, force_y = stretched(counts, force_x, force_y)
    xt, yt = stretched(counts, xt, yt)
    (xx, yx), (xy, yy) = stretched(counts, xx, xy), stretched(counts, xy, yy)
    (xx, xy), (_, yy) = stretched(counts, xx, xy), stretched(counts, yx, yy)
    inertia = node.mass * node.inertia
    turning = inertia * node.gyration
    row = node.row
    _add_own(system.matrix, row, xx + inertia, xy, yy + inertia, xt, yt, tt + turning)
    system.right[row] -= force_x + inertia * (u_x - node.last_x)
    system.right[row + 1] -= force_y + inertia * (u_y - node.last_y)
    system.right[row + 2] -= torque + turning * (u_turn - node.last_turn)
    return foot


@compiled
def lag_of(tool: Any, counts: Counts, values: np.ndarray) -> tuple[float, float, float]:
    """How the first node, the tool, is off its way: along it, across and in its turn."""
    x, y, turn = values[0, 0] - tool.last_x, values[0, 1] - tool.last_y, values[0, 2] - tool.last_turn
    return x * counts.axis_x + y * counts.axis_y, y * counts.axis_x - x * counts.axis_y, turn


@compiled
def _add_drive(tool, counts, system, slip):
    lag, across, turn = lag_of(tool, counts, system.twist)
    a_x, a_y = counts.axis_x, counts.axis_y
    squared = lag * lag + slip * slip
    drag = counts.limit / math.sqrt(squared)
    stick = drag * (1 - SECANT * lag * lag / squared)
    along, across = drag * lag, JOINT_STIFFNESS * across
    _add_own(
        system.matrix,
        tool.row,
        stick * a_x * a_x + JOINT_STIFFNESS * a_y * a_y,
        (stick - JOINT_STIFFNESS) * a_x * a_y,
        stick * a_y * a_y + JOINT_STIFFNESS * a_x * a_x,
        0.0,
        0.0,
        JOINT_STIFFNESS,
    )
    system.right[tool.row] -= along * a_x - across * a_y
    system.right[tool.row + 1] -= along * a_y + across * a_x
    system.right[tool.row + 2] -= JOINT_STIFFNESS * turn


@compiled
def stretched(counts: Counts, x: float, y: float) -> tuple[float, float]:
    """A motion times 1 + anisotropy along the grain, and 1 - anisotropy across it: the square root of the metric of
    `contact_graph.friction_metric`."""
    along_x = counts.grain_x * x + counts.grain_y * y
    along_y = counts.grain_y * x - counts.grain_x * y
    return x + along_x, y + along_y


@compiled
def _add_joint(joint, nodes, twist, matrix, right):
    x, y, turning = relative(joint, twist)
    drift_x, drift_y = joint.drift_x + x, joint.drift_y + y
    if joint.revolute:
        limit, held = _limit(joint, turning)
        stiff = JOINT_STIFFNESS
        _add_point(joint, nodes, matrix, right, stiff * drift_x, stiff * drift_y, limit, stiff, 0.0, stiff, held)
        return
    a_x, a_y = joint.axis_x, joint.axis_y
    across = JOINT_STIFFNESS * (drift_y * a_x - drift_x * a_y)
    limit, held = _limit(joint, x * a_x + y * a_y)
    _add_point(
        joint,
        nodes,
        matrix,
        right,
        limit * a_x - across * a_y,
        limit * a_y + across * a_x,
        JOINT_STIFFNESS * (joint.turn + turning),
        JOINT_STIFFNESS * a_y * a_y + held * a_x * a_x,
        (held - JOINT_STIFFNESS) * a_x * a_y,
        JOINT_STIFFNESS * a_x * a_x + held * a_y * a_y,
        JOINT_STIFFNESS,
    )


@compiled
def _limit(joint, used):
    """Force of a limit, and its stiffness where it is reached."""
    low, high = min(joint.low + used, 0.0), min(joint.high - used, 0.0)
    held = JOINT_STIFFNESS if low < 0.0 or high < 0.0 else 0.0
    return JOINT_STIFFNESS * (low - high), held


@compiled
def _add_point(point, nodes, matrix, right, force_x, force_y, torque, k_xx, k_xy, k_yy, k_tt):
    """Add a force and its stiffness, on the motion of the second node against the first."""
    row_1, row_2 = nodes[point.first].row, nodes[point.second].row
    x_1, y_1, x_2, y_2 = point.arm_1x, point.arm_1y, point.arm_2x, point.arm_2y
    xt_1, yt_1 = k_xy * x_1 - k_xx * y_1, k_yy * x_1 - k_xy * y_1
    xt_2, yt_2 = k_xy * x_2 - k_xx * y_2, k_yy * x_2 - k_xy * y_2
    if row_1 >= 0:
        _add_own(matrix, row_1, k_xx, k_xy, k_yy, xt_1, yt_1, x_1 * yt_1 - y_1 * xt_1 + k_tt)
        right[row_1] += force_x
        right[row_1 + 1] += force_y
        right[row_1 + 2] += x_1 * force_y - y_1 * force_x + torque
    if row_2 >= 0:
        _add_own(matrix, row_2, k_xx, k_xy, k_yy, xt_2, yt_2, x_2 * yt_2 - y_2 * xt_2 + k_tt)
        right[row_2] -= force_x
        right[row_2 + 1] -= force_y
        right[row_2 + 2] -= x_2 * force_y - y_2 * force_x + torque
    if row_1 >= 0 and row_2 >= 0:
        tt = x_1 * yt_2 - y_1 * xt_2 + k_tt
        # Rows of the first node, columns of the second; the lower triangle may hold it turned round.
        if row_1 > row_2:
            _add_between(matrix, row_1, row_2, k_xx, k_xy, xt_2, k_xy, k_yy, yt_2, xt_1, yt_1, tt)
        else:
            _add_between(matrix, row_2, row_1, k_xx, k_xy, xt_1, k_xy, k_yy, yt_1, xt_2, yt_2, tt)


@compiled
def _add_own(matrix, row, xx, xy, yy, xt, yt, tt):
    matrix[row, row] += xx
    matrix[row + 1, row] += xy
    matrix[row + 1, row + 1] += yy
    matrix[row + 2, row] += xt
    matrix[row + 2, row + 1] += yt
    matrix[row + 2, row + 2] += tt


@compiled
def _add_between(matrix, row, column, xx, xy, xt, yx, yy, yt, tx, ty, tt):
    matrix[row, column] -= xx
    matrix[row, column + 1] -= xy
    matrix[row, column + 2] -= xt
    matrix[row + 1, column] -= yx
    matrix[row + 1, column + 1] -= yy
    matrix[row + 1, column + 2] -= yt
    matrix[row + 2, column] -= tx
    matrix[row + 2, column + 1] -= ty
    matrix[row + 2, column + 2] -= tt


@compiled
def slope(graph: Graph, counts: Counts, system: System, slip: float, length: float) -> float:
    """Slope of the energy at a length along the direction; friction's normal forces are held."""
    total = 0.0
    for k in range(counts.nodes):
        node = graph.nodes[k]
        if node.row < 0:
            continue
        inertia = node.mass * node.inertia
        d_x, d_y, d_turn = system.direction[k]
        total += inertia * d_x * (system.twist[k, 0] + length * d_x - node.last_x)
        total += inertia * d_y * (system.twist[k, 1] + length * d_y - node.last_y)
        total += inertia * node.gyration * d_turn * (system.twist[k, 2] + length * d_turn - node.last_turn)
    if counts.drive > 0.0:
        lag, across, turn = lag_of(graph.nodes[0], counts, system.twist)
        d_x, d_y, d_turn = system.direction[0, 0], system.direction[0, 1], system.direction[0, 2]
        d_lag, d_across = d_x * counts.axis_x + d_y * counts.axis_y, d_y * counts.axis_x - d_x * counts.axis_y
        lag += length * d_lag
        total += counts.limit * lag * d_lag / math.sqrt(lag * lag + slip * slip)
        total += JOINT_STIFFNESS * ((across + length * d_across) * d_across + (turn + length * d_turn) * d_turn)
    k = -1
    u_x = u_y = u_turn = way_x = way_y = way_turn = 0.0
    for number in range(counts.feet):
        foot = graph.feet[number]
        if foot.node != k:
            k = foot.node
            u_x, u_y = stretched(counts, system.twist[k, 0], system.twist[k, 1])
            way_x, way_y = stretched(counts, system.direction[k, 0], system.direction[k, 1])
            u_turn, way_turn = system.twist[k, 2], system.direction[k, 2]
        x, y, turn = u_x + foot.turns_x * u_turn, u_y + foot.turns_y * u_turn, foot.radius * u_turn
        d_x, d_y, d_turn = way_x + foot.turns_x * way_turn, way_y + foot.turns_y * way_turn, foot.radius * way_turn
        x, y, turn = x + length * d_x, y + length * d_y, turn + length * d_turn
        squared = x * x + y * y + turn * turn + slip * slip
        total += foot.weight * (x * d_x + y * d_y + turn * d_turn) / math.sqrt(squared)
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        if contact.grip > 0.0:
            now = contact.slip + length * contact.slipping
            total += contact.grip * now * contact.slipping / math.sqrt(now * now + slip * slip)
        total -= contact.stiffness * max(contact.depth - length * contact.parting, 0.0) * contact.parting
    for k in range(counts.joints):
        joint = graph.joints[k]
        x, y, turn = relative(joint, system.twist)
        d_x, d_y, d_turn = relative(joint, system.direction)
        x, y, turn = x + length * d_x, y + length * d_y, turn + length * d_turn
        drift_x, drift_y = joint.drift_x + x, joint.drift_y + y
        if joint.revolute:
            limit, _ = _limit(joint, turn)
            total += JOINT_STIFFNESS * (drift_x * d_x + drift_y * d_y) + limit * d_turn
        else:
            a_x, a_y = joint.axis_x, joint.axis_y
            limit, _ = _limit(joint, x * a_x + y * a_y)
            across = drift_y * a_x - drift_x * a_y
            total += JOINT_STIFFNESS * across * (d_y * a_x - d_x * a_y) + limit * (d_x * a_x + d_y * a_y)
            total += JOINT_STIFFNESS * (joint.turn + turn) * d_turn
    return total
