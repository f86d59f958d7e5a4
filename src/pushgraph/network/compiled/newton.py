"""Newton's method of `pushgraph.network.newton`, of one scene.

Unknowns are numbered as the push reaches the nodes, so the curvature's factors stay within a narrow envelope: a long
row of bodies costs as much a body as a short one.
"""

from pushgraph.network import contact_problem, newton
from pushgraph.network.compiled.arrays import Counts, Graph, System
from pushgraph.network.compiled.energy import STIFFNESS, linearize, measure, relative, slope
from pushgraph.network.compiled.jit import compiled

SLIP, LOOSE, TIGHTENING = contact_problem.SLIP, newton.LOOSE, newton.TIGHTENING
OUTRIGHT, BALANCED, BRACKETINGS, TINY = newton.OUTRIGHT, newton.BALANCED, newton.BRACKETINGS, newton.TINY
(LEAST_SHARE, GREATEST_SHARE), (LEAST_INSIDE, MOST_INSIDE) = newton.SHARES, newton.INSIDE


@compiled
def solve(graph: Graph, counts: Counts, system: System, iterations: int, converged: float) -> None:
    """Find the twists at which forces balance, until they change by less than `converged`, in steps."""
    unknowns = 0
    for k in range(counts.nodes):
        node = graph.nodes[k]
        system.twist[k, 0], system.twist[k, 1], system.twist[k, 2] = node.last_x, node.last_y, node.last_turn
        system.direction[k, :] = 0.0
        if node.row >= 0:
            unknowns += 3
    if unknowns == 0:
        return
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        contact.stiffness = STIFFNESS * contact.share
    _find_envelope(graph, counts, system, unknowns)
    for iteration in range(iterations):
        slip = max(LOOSE * TIGHTENING**iteration, SLIP)
        measure(graph, counts, system.twist)
        off = _hold(graph, counts, iteration)
        linearize(graph, counts, system, unknowns, slip)
        falling = _direction(graph, counts, system, unknowns)
        length = _flat_length(graph, counts, system, slip, falling)
        change = 0.0
        for k in range(counts.nodes):
            for axis in range(3):
                step = length * system.direction[k, axis]
                system.twist[k, axis] += step
                change = max(change, abs(step))
        if slip <= SLIP and change < converged and off < BALANCED:
            break


@compiled
def _hold(graph, counts, iteration):
    """Hold friction to normal forces that follow those of the twist; return how far it is off. See `newton.Held`."""
    product = squares = farthest = 0.0
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        pressing = contact.stiffness * max(contact.depth, 0.0)
        if iteration == 0:
            contact.held, contact.off, contact.following = pressing, 0.0, 1.0
        else:
            off = pressing - contact.held
            change = off - contact.off
            product += contact.off * change
            squares += change * change
            contact.off = off
            farthest = max(farthest, abs(off))
    if iteration > 0:
        factor = -product / squares if squares > TINY else 1.0
        for k in range(counts.contacts):
            contact = graph.contacts[k]
            if iteration > OUTRIGHT:
                contact.following = min(max(contact.following * factor, LEAST_SHARE), GREATEST_SHARE)
            contact.held = max(contact.held + contact.following * contact.off, 0.0)
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        contact.grip = contact.friction * contact.held
    return farthest


@compiled
def _find_envelope(graph, counts, system, unknowns):
    for k in range(unknowns):
        system.first[k] = k // 3 * 3
    for kind in range(2):
        for k in range(counts.joints if kind else counts.contacts):
            first = graph.joints[k].first if kind else graph.contacts[k].first
            second = graph.joints[k].second if kind else graph.contacts[k].second
            row_1, row_2 = graph.nodes[first].row, graph.nodes[second].row
            if row_1 < 0 or row_2 < 0:
                continue
            low, high = min(row_1, row_2), max(row_1, row_2)
            for axis in range(3):
                system.first[high + axis] = min(system.first[high + axis], low)


@compiled
def _direction(graph, counts, system, unknowns):
    """Newton's direction, by factors L D L^T within the envelope; return the energy's slope along it."""
    matrix, first, right = system.matrix, system.first, system.right
    falling = 0.0
    for row in range(unknowns):
        system.gradient[row] = -right[row]
    for row in range(unknowns):
        begin = first[row]
        # Until divided, the row holds L D.
        for column in range(begin, row):
            total = matrix[row, column]
            for k in range(max(begin, first[column]), column):
                total -= matrix[row, k] * matrix[column, k]
            matrix[row, column] = total
        pivot, value = matrix[row, row], right[row]
        for column in range(begin, row):
            factor = matrix[row, column] * matrix[column, column]
            pivot -= matrix[row, column] * factor
            matrix[row, column] = factor
            value -= factor * right[column]
        matrix[row, row] = 1 / pivot
        right[row] = value
    for row in range(unknowns - 1, -1, -1):
        right[row] *= matrix[row, row]
    for row in range(unknowns - 1, -1, -1):
        value = right[row]
        for column in range(first[row], row):
            right[column] -= matrix[row, column] * value
    for k in range(counts.nodes):
        row = graph.nodes[k].row
        if row >= 0:
            for axis in range(3):
                system.direction[k, axis] = right[row + axis]
                falling += system.gradient[row + axis] * right[row + axis]
    return falling


@compiled
def _flat_length(graph, counts, system, slip, falling):
    """See `newton._where_flat`: the length of the step, from 0 to 1, at which the energy is least."""
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        x, y, _ = relative(contact, system.direction)
        contact.parting = x * contact.normal_x + y * contact.normal_y
        contact.slipping = y * contact.normal_x - x * contact.normal_y
    above = slope(graph, counts, system, slip, 1.0)
    if above <= 0.0:
        return 1.0
    low, high, below = 0.0, 1.0, falling
    for _ in range(BRACKETINGS):
        share = min(max(-below / max(above - below, TINY), LEAST_INSIDE), MOST_INSIDE)
        middle = low + share * (high - low)
        now = slope(graph, counts, system, slip, middle)
        if now <= 0.0:
            low, below = middle, now
        else:
            high, above = middle, now
    share = min(max(-below / max(above - below, TINY), 0.0), 1.0)
    return low + share * (high - low)
