"""Which bodies may move in a step: `broad_phase.reachable(...).may_move`, from body to body."""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from pushgraph.graph import broad_phase
from pushgraph.graph.broad_phase import node_poses, node_shapes, reachable
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.graph.state import STILL, Control, State
from pushgraph.network.compiled.arrays import as_array
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.reach import pair_of

LEVER, MARGIN, LENGTHS_CLOSED = broad_phase.LEVER, broad_phase.MARGIN, broad_phase.LENGTHS_CLOSED
SLIDER_GAP = broad_phase.SLIDER_GAP
FIXED = JOINT_CODES["fixed"]


class Arrays(NamedTuple):
    """Fields of State, SceneBatch and Control; see there. nodes: poses of bodies, then of the tool's parts. circle:
    radius around each (m)."""

    nodes: np.ndarray
    motions: np.ndarray
    still: float
    present: np.ndarray
    immovable: np.ndarray
    group: np.ndarray
    kind: np.ndarray
    known: np.ndarray
    remembered: np.ndarray
    circle: np.ndarray
    part_present: np.ndarray
    travel: np.ndarray
    frames: np.ndarray


def bodies_in_reach(state: State, control: Control) -> Bool[Tensor, "batch bodies"]:
    """Bodies that may move in the step; the rest stays put."""
    if state.poses.device.type != "cpu":
        return reachable(state, control).may_move
    scenes, relations = state.scenes, state.relations
    shapes = node_shapes(scenes)
    circle = shapes.half_extents.norm(dim=-1) + shapes.radius
    frames = torch.as_tensor(control.frames, dtype=torch.float64).expand(len(state.poses))
    of_scenes = (scenes.present, scenes.immovable, scenes.group, relations.kind, relations.known, relations.remembered)
    arrays = Arrays(
        as_array(node_poses(state, control)),
        as_array(state.motions),
        float(state.still),
        *(as_array(values) for values in of_scenes),
        *(
            as_array(values)
            for values in (circle, scenes.part_present, broad_phase.tool_travel(state, control), frames)
        ),
    )
    reached = np.zeros(scenes.present.shape, bool)
    _reach_all(arrays, reached)
    return torch.from_numpy(reached)


@compiled
def _reach_all(arrays, reached):
    for scene in range(len(reached)):
        _reach(arrays, scene, reached[scene])


@compiled
def _reach(arrays, scene, reached):
    bodies = len(reached)
    present, immovable, circle = arrays.present[scene], arrays.immovable[scene], arrays.circle[scene]
    nodes, motions = arrays.nodes[scene], arrays.motions[scene]
    speed = np.zeros(bodies)
    for k in range(bodies):
        if present[k] and not immovable[k]:
            of_body = math.hypot(motions[k, 0], motions[k, 1]) + LEVER * abs(motions[k, 2])
            speed[k] = of_body if of_body > arrays.still else 0.0
    travel = arrays.travel[scene]
    length = max(travel, speed.max() * arrays.frames[scene])
    if length <= 0.0:
        return
    widest = MARGIN + LENGTHS_CLOSED * length
    queue, last = np.zeros(bodies, np.int64), 0
    for k in range(bodies):
        if speed[k] > 0.0:
            last = _add_piece(arrays, scene, k, reached, queue, last)
    if travel > STILL:
        for part in range(bodies, len(nodes)):
            if arrays.part_present[scene, part - bodies]:
                for k in range(bodies):
                    if present[k] and _gap(nodes, circle, part, k) < widest:
                        last = _add_piece(arrays, scene, k, reached, queue, last)
    first = 0
    while first < last:
        here = queue[first]
        first += 1
        for there in range(bodies):
            if present[there] and not reached[there]:
                keep = _keep(arrays, scene, pair_of(here, there, bodies))
                if _gap(nodes, circle, here, there) < max(keep, widest):
                    last = _add_piece(arrays, scene, there, reached, queue, last)


@compiled
def _add_piece(arrays, scene, body, reached, queue, last):
    """Queue the bodies that move as one with a body, unless one of them cannot move."""
    bodies = len(reached)
    if reached[body]:
        return last
    group, kind = arrays.group[scene], arrays.kind[scene]
    first, moves = last, True
    queue[last], reached[body] = body, True
    last += 1
    k = first
    while k < last:
        here = queue[k]
        moves &= not arrays.immovable[scene, here]
        for there in range(bodies):
            if reached[there] or not arrays.present[scene, there]:
                continue
            if group[there] == group[here] or kind[pair_of(here, there, bodies)] == FIXED:
                queue[last], reached[there] = there, True
                last += 1
        k += 1
    if moves:
        return last
    for k in range(first, last):
        reached[queue[k]] = False
    return first


@compiled
def _gap(nodes, circle, a, b):
    return math.hypot(nodes[a, 0] - nodes[b, 0], nodes[a, 1] - nodes[b, 1]) - circle[a] - circle[b]


@compiled
def _keep(arrays, scene, pair):
    """Gap (m) up to which a pair belongs together whatever the step."""
    if arrays.kind[scene, pair] > 0:
        return math.inf
    if arrays.remembered[scene, pair] and not arrays.known[scene, pair]:
        return SLIDER_GAP
    return -math.inf
