"""One step of many scenes: graph, solve, motion; one scene after the other, on as many threads as torch has."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph.graph.contact_features import CLAMP
from pushgraph.graph.state import Control, State
from pushgraph.network import newton
from pushgraph.network.compiled.arrays import Scenes, arrays_of, room_for, room_for_system
from pushgraph.network.compiled.energy import lag_of, measure
from pushgraph.network.compiled.graph import LEVER, build
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.newton import solve
from pushgraph.network.compiled.threads import share_out
from pushgraph.network.contact_problem import CONTACT_STATE, FARTHEST


class Solved(NamedTuple):
    """See `dynamics.Advance`; and of each pair, if asked for, the sum of CONTACT_STATE over its contacts and how many
    there are."""

    motion: Float[np.ndarray, "batch bodies 3"]
    done: Float[np.ndarray, " batch"]
    contact_state: Float[np.ndarray, "batch pairs state"]
    contacts: Int[np.ndarray, "batch pairs"]


def solve_step(state: State, control: Control, contact_state: bool = False) -> Solved:
    """Solve one step of all scenes; tensors on the CPU."""
    scenes = arrays_of(state, control)
    batch, pairs = scenes.kind.shape
    pairs = pairs if contact_state else 0
    states, contacts = np.zeros((batch, pairs, len(CONTACT_STATE))), np.zeros((batch, pairs), np.int64)
    solved = Solved(np.zeros_like(scenes.poses), np.ones(batch), states, contacts)
    share_out(lambda first, last: _solve(scenes, first, last, solved), batch)
    return solved


def _solve(scenes: Scenes, first: int, last: int, solved: Solved) -> None:
    graph, system = room_for(scenes), room_for_system(scenes.poses.shape[1])
    _solve_scenes(scenes, first, last, graph, system, newton.ITERATIONS, newton.CONVERGED, solved)


@compiled
def _solve_scenes(scenes, first, last, graph, system, iterations, converged, solved):
    for scene in range(first, last):
        counts = build(scenes, scene, graph)
        if counts.length == 0.0:
            continue
        solve(graph, counts, system, iterations, converged)
        _move(graph, counts, system.twist, solved.motion[scene])
        if counts.drive > 0.0:
            lag, _, _ = lag_of(graph.nodes[0], counts, system.twist)
            solved.done[scene] = min(max(1 + lag / counts.drive, 0.0), 1.0)
        if solved.contacts.shape[1]:
            _add_contact_state(graph, counts, system.twist, solved.contact_state[scene], solved.contacts[scene])


@compiled
def _move(graph, counts, twist, motion):
    """Pieces move rigidly, from where they start; see `pieces.move_pieces`."""
    for k in range(counts.nodes):
        node = graph.nodes[k]
        if node.given or node.is_tool:
            continue
        x = min(max(twist[k, 0], -FARTHEST), FARTHEST) * counts.length
        y = min(max(twist[k, 1], -FARTHEST), FARTHEST) * counts.length
        turn = min(max(twist[k, 2], -FARTHEST), FARTHEST) * counts.length / LEVER
        sin, versine = math.sin(turn), 2 * math.sin(turn / 2) ** 2
        for number in range(node.begin, node.end):
            body = graph.member[number]
            arm_x, arm_y = graph.bodies[body].start_x - node.start_x, graph.bodies[body].start_y - node.start_y
            motion[body, 0] = x - arm_y * sin - arm_x * versine
            motion[body, 1] = y + arm_x * sin - arm_y * versine
            motion[body, 2] = turn


@compiled
def _add_contact_state(graph, counts, twist, states, contacts):
    """See `dynamics.contact_state`."""
    measure(graph, counts, twist)
    for k in range(counts.contacts):
        contact = graph.contacts[k]
        pair = graph.edges[contact.edge].relation
        if pair < 0:
            continue
        states[pair, 0] += min(max(contact.gap, -CLAMP), CLAMP)
        states[pair, 1] += min(max(-contact.depth - contact.gap, -CLAMP), CLAMP)
        states[pair, 2] += min(max(contact.slip, -CLAMP), CLAMP)
        states[pair, 3] += math.log1p(contact.stiffness * max(contact.depth, 0.0))
        contacts[pair] += 1
