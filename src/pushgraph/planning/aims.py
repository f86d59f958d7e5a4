"""Straight pushes aimed at bodies: what continuous planning draws, and improves."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pushgraph.planning.admissible import CLEARANCE
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.tool import Push

BACK = np.arange(0.02, 0.46, 0.01)
"""How far behind the body that it is aimed at a push may begin (m)."""
MARGIN = 1e-3
"""Starts keep this much more than the clearance (m)."""
PAST = 0.03
"""A push is tried this much farther than a body has to go (m)."""
STEP = 0.01
"""Places on the way of a push at which it is looked whether it leaves the table (m)."""


class Aims(NamedTuple):
    """Lines along which the tool is pushed at bodies, one a row.

    body: index of the one aimed at. direction: of the push, in the world (rad). offset: how far to the left of the
    body's place the line passes (m). yaw: how the tool is turned (rad).
    """

    body: Int[np.ndarray, " aims"]
    direction: Float[np.ndarray, " aims"]
    offset: Float[np.ndarray, " aims"]
    yaw: Float[np.ndarray, " aims"]

    def take(self, index: Sequence[int] | np.ndarray) -> "Aims":
        """Some of them, in this order."""
        return Aims(*(column[np.asarray(index, dtype=int)] for column in self))

    def varied(self, rng: np.random.Generator, count: int, scale: float, scene: Scene) -> "Aims":
        """So many like these. scale: standard deviation of directions (rad), and twice that of offsets in reaches of
        the body."""
        drawn = self.take(rng.integers(len(self.body), size=count))
        turn, shift, twist = rng.normal(scale=scale, size=(3, count))
        return drawn._replace(
            direction=drawn.direction + turn,
            offset=drawn.offset + 0.5 * shift * reach_of(scene)[drawn.body],
            yaw=drawn.yaw if _is_round(scene) else drawn.yaw + twist,
        )


def first_aims(
    rng: np.random.Generator,
    scene: Scene,
    poses_world_from_body: Float[np.ndarray, "bodies 3"],
    body: int,
    place: Sequence[float],
    count: int,
) -> Aims:
    """Pushes that may bring a body to a place: half at the body itself, the others at what it is joined to and at what
    stands near; most of them the way it has to go, the others any way. The first is right at it.
    """
    poses, reach = poses_world_from_body, reach_of(scene)
    way = np.asarray(place) - poses[body, :2]
    chosen = rng.choice(len(scene.bodies), size=count, p=_worth(scene, poses, body, way))
    chosen[: (count + 1) // 2] = body
    ahead = math.atan2(way[1], way[0])
    turn = np.where(rng.random(count) < 0.6, rng.normal(scale=0.6, size=count), rng.uniform(-math.pi, math.pi, count))
    offset = rng.uniform(-0.9, 0.9, count) * reach[chosen]
    turn[0] = offset[0] = 0.0
    direction = ahead + turn
    yaw = np.zeros(count) if _is_round(scene) else direction + rng.uniform(-math.pi, math.pi, count)
    return Aims(chosen, direction, offset, yaw)


def aimed_pushes(
    scene: Scene,
    poses_world_from_body: Float[np.ndarray, "bodies 3"],
    aims: Aims,
    body: int,
    place: Sequence[float],
    speed: float,
    longest: float,
) -> list[Push | None]:
    """The pushes along these lines: from where the tool first comes down clear of all bodies, as far as the body would
    have to go, on the table, and no longer than `longest` (m). None where there is no room for one.
    """
    poses, reach = poses_world_from_body, reach_of(scene)
    ahead = np.column_stack((np.cos(aims.direction), np.sin(aims.direction)))
    left = np.column_stack((-ahead[:, 1], ahead[:, 0]))
    through = poses[aims.body, :2] + aims.offset[:, None] * left
    starts = through[:, None] - BACK[:, None] * ahead[:, None]
    tool = np.concatenate((starts, np.broadcast_to(aims.yaw[:, None, None], (*starts.shape[:2], 1))), -1)
    clearance = (CLEARANCE if scene.clearance is None else scene.clearance) + MARGIN
    clear = scene.tool_gaps(tool.reshape(-1, 3), poses).min(-1).reshape(len(tool), -1) >= clearance
    clear &= scene.table.holds(starts)
    needed = max(math.dist(place, poses[body, :2]), 0.05)
    pushes: list[Push | None] = []
    for row, free in enumerate(clear):
        if not free.any():
            pushes.append(None)
            continue
        back = BACK[int(free.argmax())]
        touches = 0.7 * (reach[aims.body[row]] + scene.tool.reach)
        distance = min(max(back - touches, 0.0) + 1.2 * needed + PAST, longest)
        start = starts[row, int(free.argmax())]
        stations = np.arange(0.0, distance + STEP, STEP).clip(max=distance)
        on_table = scene.table.holds(start + stations[:, None] * ahead[row])
        if not on_table.all():
            distance = float(stations[max(int(on_table.argmin()) - 1, 0)])
        pushes.append(
            Push(
                start=tuple(start.tolist()),
                direction=float(aims.direction[row]),
                distance=distance,
                speed=speed,
                yaw=float(aims.yaw[row]),
            )
        )
    return pushes


def reach_of(scene: Scene) -> Float[np.ndarray, " bodies"]:
    """Distance of each body's farthest point from its place (m)."""
    return np.array([body.shape.reach for body in scene.bodies])


def _worth(scene: Scene, poses: np.ndarray, body: int, way: np.ndarray) -> Float[np.ndarray, " bodies"]:
    """How likely each body is aimed at: those that the body hangs together with twice as likely as those near its way;
    others, and what cannot move, are not."""
    hanging = {scene.names[body]}
    edges = [{joint.parent, joint.child} for joint in scene.joints] + [set(group) for group in scene.rigid_groups]
    while grown := [edge for edge in edges if edge & hanging and not edge <= hanging]:
        hanging |= set().union(*grown)
    from_body = poses[:, :2] - poses[body, :2]
    along = np.clip(from_body @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
    near = np.hypot(*(from_body - along[:, None] * way).T) < 2 * reach_of(scene).max() + scene.tool.reach
    worth = 1.0 * near + 2.0 * np.array([name in hanging for name in scene.names])
    worth[scene.immovable] = 0.0
    return worth / worth.sum()


def _is_round(scene: Scene) -> bool:
    parts = scene.tool.parts
    return len(parts) == 1 and isinstance(parts[0].shape, Cylinder) and parts[0].pose_tool_from_part[:2] == (0.0, 0.0)
