"""How the tool moves in a push: trapezoidal speed along a straight line, turning in proportion."""

import math

import numpy as np
from jaxtyping import Float

from pushgraph.tool import Push, Tool

ACCELERATION = 1.0
"""Largest acceleration of the end-effector (m/s^2), that of the paper's arm."""


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
