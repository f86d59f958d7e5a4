"""Choose pushes that reach bodies, preferring those that were touched least."""

import math
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph import pose
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder, simple
from pushgraph.tool import Push

PUSHES = 9
"""Of a trajectory, unless they are slow."""
CANDIDATES = 64
CHECKED = 16
"""Candidates with a free start whose path is looked at."""
PATH_SAMPLES = (10, 60)
"""Fewest and most places of a path that are looked at: the thinner body and tool, the more."""
START_CLEARANCE = 0.002
DEPTH = 0.01
NARROW = 0.25
"""A path that would cut DEPTH (m) into a body, or this share of its width, is held to push it."""
GRAZE = 0.002
"""So deep (m) where pushes graze."""
TABLE_MARGIN = 0.15
SQUARELY = 0.8
"""A body farther off the way of another than this share of their reaches is passed, or grazed."""


Way = Literal["straight", "back", "bent"]
"""Straight on, out and back again, or along way-points."""


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
    pushes: int = PUSHES
    rest: float = 0.2
    """How long the tool rests after a push (s)."""
    square: bool = False
    """Whether the tool's x-axis points where it goes."""
    along: float | None = None
    """Half of the pushes go along this direction, one way or the other (rad)."""
    grazes: bool = False
    """Whether pushes are aimed at corners and edges: whatever they touch counts."""
    scatters: bool = False
    """Whether bodies count, too, that those on the path are pushed into."""
    ways: tuple[Way, ...] = ("straight",)
    """Each push goes one of these ways."""
    force_limit: float | None = None
    """N"""


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
    still = scene.immovable
    novelty = ~still / (1.0 + touched) ** 2
    way = style.ways[rng.integers(len(style.ways))] if len(style.ways) > 1 else style.ways[0]
    depth = np.minimum(
        GRAZE if style.grazes else DEPTH, NARROW * np.array([_width(simple(body.shape)) for body in scene.bodies])
    )
    for _ in range(4):
        candidates = _candidates(rng, scene, poses, novelty, style, way)
        free = _free_starts(scene, poses, candidates)[: CANDIDATES if style.scatters else CHECKED]
        if not len(free):
            continue
        gaps = _path_gaps(scene, poses, candidates[free])
        pushed = (gaps.min(1) < -depth) & ~still
        early = (gaps[:, : int(0.7 * gaps.shape[1])] < -depth / 2).any((1, 2))
        clear = (gaps[:, :, still] >= START_CLEARANCE).all((1, 2))
        if style.scatters:
            pushed |= _pushed_into(scene, poses, candidates[free], pushed) & ~still
        score = (pushed * novelty).sum(-1) * early * clear
        if score.max() > 0:
            return _push(candidates[free[score.argmax()]], style)
    raise NoPush


def _push(waypoints: Float[np.ndarray, "waypoints 3"], style: PushStyle) -> Push:
    (x, y, yaw), *others = waypoints.tolist()
    fields = {"start": (x, y), "yaw": yaw, "speed": style.speed, "rest": style.rest, "force_limit": style.force_limit}
    if len(others) > 1:
        return Push(path=tuple(map(tuple, others)), **fields)
    end_x, end_y, end_yaw = others[0]
    return Push(end=(end_x, end_y), rotation=end_yaw - yaw, **fields)


def _candidates(
    rng: np.random.Generator,
    scene: Scene,
    poses: Float[np.ndarray, "bodies 3"],
    novelty: Float[np.ndarray, " bodies"],
    style: PushStyle,
    way: Way,
) -> Float[np.ndarray, "candidates waypoints 3"]:
    """Tool poses along pushes towards a body each, off its centre by up to most of its reach, or to its edge."""
    target = rng.choice(len(poses), CANDIDATES, p=novelty / novelty.sum())
    radius = np.array([body.shape.reach for body in scene.bodies])[target]
    direction = rng.uniform(-math.pi, math.pi, CANDIDATES)
    if style.along is not None:
        near = style.along + math.pi * rng.integers(2, size=CANDIDATES) + rng.normal(0, 0.05, CANDIDATES)
        direction = np.where(rng.random(CANDIDATES) < 0.5, near, direction)
    aside = rng.uniform(-0.7, 0.7, CANDIDATES) * radius
    if style.grazes:
        aside = np.sign(aside) * (rng.uniform(0.6, 1.0, CANDIDATES) * (radius + 0.8 * scene.tool.reach))
    back = radius + scene.tool.reach + rng.uniform(START_CLEARANCE, 0.6 * style.distance, CANDIDATES)
    yaw = rng.uniform(-math.pi, math.pi, CANDIDATES) * style.turned
    rotation = rng.uniform(-style.rotation, style.rotation, CANDIDATES)
    if style.square:
        yaw = direction
    # The middle of the tool is aimed, which may lie off the end-effector.
    middle = np.mean([part.pose_tool_from_part[:2] for part in scene.tool.parts], axis=0)
    back -= np.hypot(*middle)
    along = pose.rotate(np.array([1.0, 0.0]), direction)
    across = np.column_stack((-along[:, 1], along[:, 0]))
    start = poses[target, :2] - back[:, None] * along + aside[:, None] * across - pose.rotate(middle, yaw)
    end = start + style.distance * along
    first, last = np.column_stack((start, yaw)), np.column_stack((end, yaw + rotation))
    if way == "back":
        return np.stack((first, last, first), 1)
    if way == "bent":
        turn = direction + rng.uniform(-1.2, 1.2, CANDIDATES)
        bent = (start + end) / 2 + style.distance / 2 * pose.rotate(np.array([1.0, 0.0]), turn)
        return np.stack((first, (first + last) / 2, np.column_stack((bent, yaw + rotation))), 1)
    return np.stack((first, last), 1)


def _free_starts(
    scene: Scene, poses: Float[np.ndarray, "bodies 3"], candidates: Float[np.ndarray, "candidates waypoints 3"]
) -> Int[np.ndarray, " free"]:
    on_table = np.abs(candidates[..., :2]).max((1, 2)) <= min(scene.table.size) / 2 - TABLE_MARGIN
    inside = np.flatnonzero(on_table)
    if not len(inside):
        return inside
    gaps = scene.tool_gaps(candidates[inside, 0], poses)
    return inside[gaps.min(-1) >= START_CLEARANCE]


def _path_gaps(
    scene: Scene, poses: Float[np.ndarray, "bodies 3"], candidates: Float[np.ndarray, "candidates waypoints 3"]
) -> Float[np.ndarray, "candidates samples bodies"]:
    """Gap of the tool along each path to the bodies as they lie now."""
    thin = min(_width(simple(body.shape)) for body in scene.bodies)
    thin += min(_width(part.shape) for part in scene.tool.parts)
    long = np.hypot(*np.diff(candidates[..., :2], axis=1).reshape(-1, 2).T).max()
    samples = int(np.clip(math.ceil(2 * long / thin), *PATH_SAMPLES))
    share = np.linspace(0, 1, samples)[:, None]
    starts, ends = candidates[:, :-1, None], candidates[:, 1:, None]
    path = starts * (1 - share) + ends * share
    gaps = scene.tool_gaps(path.reshape(-1, 3), poses)
    return gaps.reshape(len(candidates), -1, len(poses))


def _pushed_into(
    scene: Scene,
    poses: Float[np.ndarray, "bodies 3"],
    candidates: Float[np.ndarray, "candidates waypoints 3"],
    pushed: Bool[np.ndarray, "candidates bodies"],
) -> Bool[np.ndarray, "candidates bodies"]:
    """Bodies that those on the path meet before the push ends, if these go straight on before the tool."""
    way = candidates[:, -1, :2] - candidates[:, 0, :2]
    distance = np.hypot(*way.T)[:, None]
    along, across = way / distance, np.column_stack((-way[:, 1], way[:, 0])) / distance
    from_start = poses[:, :2] - candidates[:, :1, :2]
    ahead, aside = (np.einsum("cbi,ci->cb", from_start, axis) for axis in (along, across))
    radius = np.array([body.shape.reach for body in scene.bodies])
    farthest = distance + scene.tool.reach + 2 * radius
    reaches = ahead[:, None] - radius < farthest[..., None]
    reaches &= ahead[:, None] > ahead[..., None]
    reaches &= np.abs(aside[:, None] - aside[..., None]) < SQUARELY * (radius[:, None] + radius)
    return (pushed[..., None] & reaches).any(1)


def _width(shape: Cylinder | Cuboid) -> float:
    """Its least extent (m)."""
    half_x, half_y, radius = shape.core
    return 2 * (radius or min(half_x, half_y))
