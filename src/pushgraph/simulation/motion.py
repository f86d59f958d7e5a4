"""How the tool moves in a push: along its way-points, with a trapezoidal speed or at given times."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME, LIFTED

ACCELERATION = 1.0
"""Largest acceleration of the end-effector along its path (m/s^2), that of the paper's arm."""
SLACK = 1e-5
"""A push that is longer than a number of frames by less of one has that number: scenes are simulated in a frame of
their own, where way-points are rounded to 1e-10 m."""
LIFTED_FRAMES = 2
"""Frames between two pushes with the tool lifted: above the end of the last, then above the start of the next."""


class ToolMotion:
    """Pose of the tool over the time of one push: along straight lines from way-point to way-point.

    The speed along the whole path is one trapezoid; it is that of the path length, so that no point of the tool is
    faster than the push's speed. Where the push gives times, they say instead when each way-point is reached.
    """

    def __init__(self, push: Push, tool: Tool) -> None:
        self._waypoints = push.waypoints
        if push.times is not None:
            self._profile = None
            self._travelled = np.array([0.0, *push.times])
            self.duration = push.times[-1]
            self.speed = float((push.lengths(tool) / np.diff(self._travelled)).max())
        else:
            self._travelled = np.concatenate(([0.0], np.cumsum(push.lengths(tool))))
            self._profile = _Trapezoid(self._travelled[-1], push.speed)
            self.duration = self._profile.duration
            self.speed = self._profile.speed
        """From the start of the push until the tool has come to its end (s)."""
        self.frames = math.ceil((self.duration + push.rest) / FRAME - SLACK)
        """Frames from the start of the push until the tool lifts."""

    def poses(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times 3"]:
        """pose_world_from_tool at each time (s after the start); the tool rests before the start and after the end."""
        travelled = times if self._profile is None else self._profile.travelled(times)
        return np.stack([np.interp(travelled, self._travelled, column) for column in self._waypoints.T], -1)

    def pose(self, time: float) -> Float[np.ndarray, "3"]:
        """pose_world_from_tool at one time."""
        return self.poses(np.array([time]))[0]


class _Trapezoid:
    """Distance over time, from rest to rest: the speed rises and falls by ACCELERATION and is at most `speed`."""

    def __init__(self, length: float, speed: float) -> None:
        self.length = length
        self.speed = min(speed, math.sqrt(length * ACCELERATION))
        self.ramp = self.speed / ACCELERATION
        self.duration = length / self.speed + self.ramp if length else 0.0

    def travelled(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
        """Distance (m) at each time (s)."""
        since = np.clip(times, 0.0, self.duration)
        left = self.duration - since
        rising, falling = ACCELERATION * since**2 / 2, self.length - ACCELERATION * left**2 / 2
        steady = self.speed * (since - self.ramp / 2)
        return np.where(since < self.ramp, rising, np.where(left < self.ramp, falling, steady))


def plan_tool(
    pushes: Sequence[Push], tool: Tool, frames: int | None = None
) -> tuple[Float[np.ndarray, "frames 3"], Int[np.ndarray, " frames"]]:
    """pose_world_from_tool in every frame of a track of these pushes, and which push is under way, LIFTED between.

    frames: of the first so many only.
    """
    poses: list[np.ndarray] = []
    under_way: list[int] = []
    for index, push in enumerate(pushes):
        if frames is not None and len(poses) >= frames:
            break
        motion = ToolMotion(push, tool)
        if index:
            poses += [poses[-1], motion.pose(0.0)]
            under_way += [LIFTED] * LIFTED_FRAMES
        poses += [*motion.poses(np.arange(motion.frames + 1) * FRAME)]
        under_way += [index] * (motion.frames + 1)
    if not pushes:
        return np.zeros((1, 3)), np.array([LIFTED])
    return np.array(poses)[:frames], np.array(under_way)[:frames]
