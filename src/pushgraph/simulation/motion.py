"""How the tool moves in a push: trapezoidal speed along a straight line, turning in proportion."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME, LIFTED

ACCELERATION = 1.0
"""Largest acceleration of the end-effector (m/s^2), that of the paper's arm."""
REST = 0.2
"""How long the tool rests at the end of a push before it lifts (s)."""
LIFTED_FRAMES = 2
"""Frames between two pushes with the tool lifted: above the end of the last, then above the start of the next."""


class ToolMotion:
    """Pose of the tool over the time of one push.

    The speed is that of the path length, so that no point of the tool is faster than the push's speed.
    """

    def __init__(self, push: Push, tool: Tool) -> None:
        self._start = np.array([*push.start, push.yaw])
        self._change = np.array([*push.displacement, push.rotation])
        self._length = push.path_length(tool)
        self._speed = min(push.speed, math.sqrt(self._length * ACCELERATION))
        self._ramp = self._speed / ACCELERATION
        self.duration = self._length / self._speed + self._ramp if self._length else 0.0
        self.frames = math.ceil((self.duration + REST) / FRAME - 1e-9)
        """Frames from the start of the push until the tool lifts."""

    def pose(self, time: float) -> Float[np.ndarray, "3"]:
        """pose_world_from_tool at `time` seconds after the start; the tool rests at both ends."""
        if self._length == 0 or time <= 0:
            return self._start
        left = self.duration - time
        if left <= 0:
            return self._start + self._change
        if time < self._ramp:
            travelled = ACCELERATION * time**2 / 2
        elif left < self._ramp:
            travelled = self._length - ACCELERATION * left**2 / 2
        else:
            travelled = self._speed * (time - self._ramp / 2)
        return self._start + self._change * (travelled / self._length)


def plan_tool(pushes: Sequence[Push], tool: Tool) -> tuple[Float[np.ndarray, "frames 3"], Int[np.ndarray, " frames"]]:
    """pose_world_from_tool in every frame of a track of these pushes, and which push is under way, LIFTED between."""
    poses: list[np.ndarray] = []
    under_way: list[int] = []
    for index, push in enumerate(pushes):
        motion = ToolMotion(push, tool)
        if index:
            poses += [poses[-1], motion.pose(0.0)]
            under_way += [LIFTED] * LIFTED_FRAMES
        poses += [motion.pose(frame * FRAME) for frame in range(motion.frames + 1)]
        under_way += [index] * (motion.frames + 1)
    if not pushes:
        return np.zeros((1, 3)), np.array([LIFTED])
    return np.array(poses), np.array(under_way)
