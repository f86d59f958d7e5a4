"""Choose pushes that reach bodies, preferring those that were touched least."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph import pose
from pushgraph.scene import Scene
from pushgraph.simulation.placement import reach
from pushgraph.tool import Push

CANDIDATES = 64
CHECKED = 16
"""Candidates with a free start whose path is looked at."""
PATH_SAMPLES = 10
START_CLEARANCE = 0.002
DEPTH = 0.01
"""A path that would cut this deep (m) into a body is held to push it."""
TABLE_MARGIN = 0.15


class PushStyle(NamedTuple):
    """What the pushes of a trajectory have in common."""

    distance: float
    """m"""
    speed: float
    """m/s"""
    turned: bool = False
    """Whether the tool comes down at any yaw; else at zero."""
    rotation: float = 0.0
    """Largest rotation of the tool in a push (rad)."""


class NoPush(Exception):
    """No push reaches a body from a free start; draw again."""


def aim(
    rng: np.random.Generator,
    scene: Scene,
    poses: Float[np.ndarray, "bodies 3"],
    touched: Int[np.ndarray, " bodies"],
    style: PushStyle,
) -> Push:
    """A push from a free start, along a path that cuts into the bodies that `touched` counts least."""
    novelty = 1.0 / (1.0 + touched) ** 2
    for _ in range(4):
        candidates = _candidates(rng, scene, poses, novelty, style)
        free = _free_starts(scene, poses, candidates)[:CHECKED]
        if not len(free):
            continue
        gaps = _path_gaps(scene, poses, candidates[free])
        pushed = gaps.min(1) < -DEPTH
        early = (gaps[:, : int(0.7 * PATH_SAMPLES)] < -DEPTH / 2).any((1, 2))
        score = (pushed * novelty).sum(-1) * early
        if score.max() > 0:
            x, y, yaw, end_x, end_y, end_yaw = candidates[free[score.argmax()]].tolist()
            return Push(start=(x, y), end=(end_x, end_y), speed=style.speed, yaw=yaw, rotation=end_yaw - yaw)
    raise NoPush


def _candidates(
    rng: np.random.Generator,
    scene: Scene,
    poses: Float[np.ndarray, "bodies 3"],
    novelty: Float[np.ndarray, " bodies"],
    style: PushStyle,
) -> Float[np.ndarray, "candidates 6"]:
    """Tool poses at start and end of pushes towards a body each, off its centre by up to most of its reach."""
    target = rng.choice(len(poses), CANDIDATES, p=novelty / novelty.sum())
    radius = np.array([reach(body.shape) for body in scene.bodies])[target]
    direction = rng.uniform(-math.pi, math.pi, CANDIDATES)
    aside = rng.uniform(-0.7, 0.7, CANDIDATES) * radius
    back = radius + scene.tool.reach + rng.uniform(START_CLEARANCE, 0.6 * style.distance, CANDIDATES)
    yaw = rng.uniform(-math.pi, math.pi, CANDIDATES) * style.turned
    rotation = rng.uniform(-style.rotation, style.rotation, CANDIDATES)
    # The middle of the tool is aimed, which may lie off the end-effector.
    middle = np.mean([part.pose_tool_from_part[:2] for part in scene.tool.parts], axis=0)
    back -= np.hypot(*middle)
    along = pose.rotate(np.array([1.0, 0.0]), direction)
    across = np.column_stack((-along[:, 1], along[:, 0]))
    start = poses[target, :2] - back[:, None] * along + aside[:, None] * across - pose.rotate(middle, yaw)
    end = start + style.distance * along
    return np.column_stack((start, yaw, end, yaw + rotation))


def _free_starts(
    scene: Scene, poses: Float[np.ndarray, "bodies 3"], candidates: Float[np.ndarray, "candidates 6"]
) -> Int[np.ndarray, " free"]:
    on_table = np.abs(candidates[:, [0, 1, 3, 4]]).max(-1) <= min(scene.table.size) / 2 - TABLE_MARGIN
    inside = np.flatnonzero(on_table)
    if not len(inside):
        return inside
    gaps = scene.tool_gaps(candidates[inside, :3], poses)
    return inside[gaps.min(-1) >= START_CLEARANCE]


def _path_gaps(
    scene: Scene, poses: Float[np.ndarray, "bodies 3"], candidates: Float[np.ndarray, "candidates 6"]
) -> Float[np.ndarray, "candidates samples bodies"]:
    """Gap of the tool along each path to the bodies as they lie now."""
    share = np.linspace(0, 1, PATH_SAMPLES)[:, None]
    path = candidates[:, None, :3] * (1 - share) + candidates[:, None, 3:] * share
    gaps = scene.tool_gaps(path.reshape(-1, 3), poses)
    return gaps.reshape(len(candidates), PATH_SAMPLES, len(poses))
