"""A scene's own frame: simulated in it, a scene goes the same way to the last bit wherever it lies and is turned."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.scene import Scene
from pushgraph.tool import Push

GRID = 10
"""Decimals of places (m) and angles (rad) in the own frame: what a shift and a turn leave of rounding lies below."""


class OwnFrame:
    """The frame of the scene's first body by name, as the scene places it; on a table with a grain, turned along
    that."""

    def __init__(self, scene: Scene) -> None:
        first = min(scene.bodies, key=lambda body: body.name)
        self._pose_world_from_own = np.array(first.pose_world_from_body, dtype=float)
        if scene.table.anisotropy:
            self._pose_world_from_own[2] = scene.table.grain_world
        self._pose_own_from_world = pose.inverse(self._pose_world_from_own)

    def scene(self, scene: Scene) -> Scene:
        """The scene without its pushes, seen from here."""
        seen = scene.replace(pushes=()).moved(self._pose_own_from_world)
        return seen.replace(
            bodies=tuple(b.replace(pose_world_from_body=_rounded(b.pose_world_from_body)) for b in seen.bodies),
            joints=tuple(
                j.replace(
                    anchor=None if j.anchor is None else _rounded(j.anchor),
                    axis=None if j.axis is None else _rounded(j.axis),
                )
                for j in seen.joints
            ),
        )

    def push(self, push: Push) -> Push:
        """The push, seen from here."""
        seen = push.moved(self._pose_own_from_world)
        return seen.replace(
            start=_rounded(seen.start),
            end=None if seen.end is None else _rounded(seen.end),
            direction=None if seen.direction is None else round(seen.direction, GRID),
            path=None if seen.path is None else tuple(_rounded(point) for point in seen.path),
            yaw=round(seen.yaw, GRID),
        )

    def poses_in_world(self, poses_own: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Poses seen from here, in the world."""
        return pose.compose(self._pose_world_from_own, poses_own)

    def poses_from_world(self, poses_world: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Poses in the world, seen from here."""
        return pose.compose(self._pose_own_from_world, poses_world)

    def wrench_in_world(self, wrench_own: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Forces along x and y and moments, along the world's axes."""
        force = pose.rotate(wrench_own[..., :2], self._pose_world_from_own[2])
        return np.concatenate((force, wrench_own[..., 2:]), -1)


def _rounded(numbers: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(number, GRID) for number in numbers)
