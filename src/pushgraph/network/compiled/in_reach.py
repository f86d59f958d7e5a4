"""Which bodies may move in a step: `broad_phase.reachable(...).may_move`, from body to body."""

import math
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from pushgraph.graph import broad_phase
from pushgraph.graph.broad_phase import reachable
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.graph.state import STILL, Control, State
from pushgraph.network.compiled.arrays import as_array, of_each
from pushgraph.network.compiled.jit import compiled
from pushgraph.network.compiled.links import keep_of, pair_of

LEVER, MARGIN, LENGTHS_CLOSED = broad_phase.LEVER, broad_phase.MARGIN, broad_phase.LENGTHS_CLOSED
FIXED = JOINT_CODES["fixed"]


class Arrays(NamedTuple):
    """Fields of State, SceneBatch, Relations and Control; see there."""

    poses: np.ndarray
    motions: np.ndarray
    still: float
    present: np.ndarray
    immovable: np.ndarray
    group: np.ndarray
    half_extents: np.ndarray
    radius: np.ndarray
    kind: np.ndarray
    known: np.ndarray
    remembered: np.ndarray
    part_present: np.ndarray
    part_half_extents: np.ndarray
    part_radius: np.ndarray
    pose_tool_from_part: np.ndarray
    tool_radius: np.ndarray
    tool_pose: np.ndarray
    tool_motion: np.ndarray
    tool_down: np.ndarray
    frames: np.ndarray


def bodies_in_reach(state: State, control: Control) -> Bool[Tensor, "batch bodies"]:
    """Bodies that may move in the step; the rest stays put."""
    if state.poses.device.type != "cpu":
        return reachable(state, control).may_move
    scenes, relations = state.scenes, state.relations
    tensors = (
        *(scenes.present, scenes.immovable, scenes.group, *scenes.boxes),
        *(relations.kind, relations.known, relations.remembered),
        *(scenes.part_present, *scenes.parts, scenes.pose_tool_from_part, scenes.tool_radius),
        *(control.pose, control.motion, control.down),
    )
    moving = as_array(state.poses), as_array(state.motions), float(state.still)
    arrays = [*map(as_array, tensors), of_each(control.frames, len(state.poses))]
    reached = np.zeros(scenes.present.shape, bool)
    _reach_all(Arrays(*moving, *arrays), reached)
    return torch.from_numpy(reached)


@compiled
def _reach_all(arrays, reached):
    for scene in range(len(reached)):
        _reach(arrays, scene, reached[scene])


@compiled
def _reach(arrays, scene, reached):
    bodies = len(reached)
    present, immovable = arrays.present[scene], arrays.immovable[scene]
    motions, tool_motion = arrays.motions[scene], arrays.tool_motion[scene]
    travel = 0.0
    if arrays.tool_down[scene]:
        travel = math.hypot(tool_motion[0], tool_motion[1]) + abs(tool_motion[2]) * arrays.tool_radius[scene]
    fastest, slides = 0.0, np.zeros(bodies, np.bool_)
    for k in range(bodies):
        if present[k] and not immovable[k]:
            speed = math.hypot(motions[k, 0], motions[k, 1]) + LEVER * abs(motions[k, 2])
            slides[k] = speed > arrays.still
            fastest = max(fastest, speed) if slides[k] else fastest
    length = max(travel, fastest * arrays.frames[scene])
    if length <= 0.0:
        return
    places, circle = arrays.poses[scene, :, :2], _circles(arrays.half_extents[scene], arrays.radius[scene])
    widest = MARGIN + LENGTHS_CLOSED * length
    queue, last = np.zeros(bodies, np.int64), 0
    for k in range(bodies):
        if slides[k]:
            last = _add_piece(arrays, scene, k, reached, queue, last)
    if travel > STILL:
        part_circle = _circles(arrays.part_half_extents[scene], arrays.part_radius[scene])
        tool = arrays.tool_pose[scene]
        cos, sin = math.cos(tool[2]), math.sin(tool[2])
        for part in range(len(part_circle)):
            if not arrays.part_present[scene, part]:
                continue
            own = arrays.pose_tool_from_part[scene, part]
            x, y = tool[0] + cos * own[0] - sin * own[1], tool[1] + sin * own[0] + cos * own[1]
            for k in range(bodies):
                apart = math.hypot(places[k, 0] - x, places[k, 1] - y) - part_circle[part] - circle[k]
                if present[k] and apart < widest:
                    last = _add_piece(arrays, scene, k, reached, queue, last)
    first = 0
    while first < last:
        here = queue[first]
        first += 1
        for there in range(bodies):
            if present[there] and not reached[there]:
                apart = math.hypot(places[here, 0] - places[there, 0], places[here, 1] - places[there, 1])
                pair = pair_of(here, there, bodies)
                keep = keep_of(arrays.kind[scene, pair], arrays.known[scene, pair], arrays.remembered[scene, pair])
                if apart - circle[here] - circle[there] < max(keep, widest):
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
def _circles(half_extents, radius):
    """Radii of circles around rounded boxes."""
    circle = np.zeros(len(radius))
    for k in range(len(radius)):
        circle[k] = math.hypot(half_extents[k, 0], half_extents[k, 1]) + radius[k]
    return circle
