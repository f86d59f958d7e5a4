"""Where the tool of an arm goes over time: along a push, rounded at its corners, and from one push to the next."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph import pose
from pushgraph.arm import Arm
from pushgraph.simulation.motion import ToolMotion
from pushgraph.track import FRAME

SAMPLES_PER_FRAME = 5
SAMPLE = FRAME / SAMPLES_PER_FRAME
"""Between two samples of a path (s)."""
ROUNDING = 2 * FRAME
"""The tool's motion is the mean of the push's over so long (s), for an arm cannot turn a corner at speed: at 0.1 m/s
a right angle is cut by 2 mm. It begins and ends where the push does, and lasts so much longer."""
FINE = SAMPLE / 8
LIFTED_SPEED, LIFTED_ACCELERATION = 0.5, 1.0
"""Of the tool on its way between pushes (m/s, m/s^2)."""
TURNING_SPEED, TURNING_ACCELERATION = 1.5, 3.0
"""Of the first and the last joint on that way (rad/s, rad/s^2)."""


class ToolPath(NamedTuple):
    """Poses of the tool in the world, every SAMPLE from 0 on, and how high it is lifted (m)."""

    poses: Float[np.ndarray, "samples 3"]
    lift: Float[np.ndarray, " samples"]

    def then(self, other: "ToolPath") -> "ToolPath":
        """This path and another that begins where it ends."""
        return ToolPath(np.vstack((self.poses, other.poses[1:])), np.concatenate((self.lift, other.lift[1:])))


def along_push(motion: ToolMotion, pace: float = 1.0) -> ToolPath:
    """The tool down on the table, from the push's start until it lifts; pace: of its motion, as a share of the push's.

    It rests as long as the push does at any pace.
    """
    slower = math.ceil(motion.duration * (1 / pace - 1) / FRAME - 1e-9)
    frames = motion.frames + slower + round(ROUNDING / FRAME)
    window = round(ROUNDING / FINE)
    times = (np.arange(frames * SAMPLES_PER_FRAME * 8 + window) + 0.5) * FINE - ROUNDING
    fine = motion.poses(times * pace)
    # Summed as differences to the start, so that what rests there is exactly there.
    sums = np.vstack((np.zeros(3), np.cumsum(fine - fine[0], axis=0)))
    poses = fine[0] + ((sums[window:] - sums[:-window]) / window)[:: round(SAMPLE / FINE)]
    return ToolPath(poses, np.zeros(len(poses)))


def to_start(arm: Arm, last: ToolPath | None, start: Float[np.ndarray, "3"], pace: float = 1.0) -> ToolPath:
    """Up from where the last push ended, around the base and down on the start; only down if there was none."""
    down = _vertical(start, arm.lift, 0.0, pace)
    if last is None:
        return down
    up = _vertical(last.poses[-1], 0.0, arm.lift, pace)
    return up.then(_around_base(arm, last, start, pace)).then(down)


def _vertical(at: Float[np.ndarray, "3"], first: float, last: float, pace: float) -> ToolPath:
    share = _smooth(_duration(abs(last - first), LIFTED_SPEED, LIFTED_ACCELERATION) / pace)
    return ToolPath(np.tile(at, (len(share), 1)), first + share * (last - first))


def _around_base(arm: Arm, last: ToolPath, start: Float[np.ndarray, "3"], pace: float) -> ToolPath:
    """Lifted, in polar coordinates of the base, so that the arm never reaches across its own base.

    It comes within half a turn of where the base faces: turns of one push are taken back before the next.
    """
    pose_world_from_base = np.array(arm.pose_world_from_base)
    pushed = pose.relative(pose_world_from_base, last.poses)
    ends = np.stack((pushed[-1], pose.relative(pose_world_from_base, start)))
    angles, distances = np.arctan2(ends[:, 1], ends[:, 0]), np.hypot(ends[:, 0], ends[:, 1])
    angles[0] = np.unwrap(np.arctan2(pushed[:, 1], pushed[:, 0]))[-1]
    turn, yaw = abs(angles[1] - angles[0]), abs(ends[1, 2] - ends[0, 2])
    way = turn * distances.max() + abs(distances[1] - distances[0])
    share = _smooth(
        max(
            _duration(way, LIFTED_SPEED, LIFTED_ACCELERATION),
            _duration(turn + yaw, TURNING_SPEED, TURNING_ACCELERATION),
        )
        / pace
    )
    angle, distance = (ends[0] + share * (ends[1] - ends[0]) for ends in (angles, distances))
    yaws = ends[0, 2] + share * (ends[1, 2] - ends[0, 2])
    in_base = np.column_stack((distance * np.cos(angle), distance * np.sin(angle), yaws))
    return ToolPath(pose.compose(pose_world_from_base, in_base), np.full(len(share), arm.lift))


def _duration(length: float, speed: float, acceleration: float) -> float:
    """Of the smooth motion over a length whose peaks stay within both (s)."""
    return max(1.875 * length / speed, math.sqrt(5.78 * length / acceleration))


def _smooth(duration: float) -> Float[np.ndarray, " samples"]:
    """From 0 to 1 with neither speed nor acceleration at the ends, in the next whole number of frames."""
    frames = max(1, math.ceil(duration / FRAME - 1e-9))
    share = np.linspace(0.0, 1.0, frames * SAMPLES_PER_FRAME + 1)
    return share**3 * (10 - 15 * share + 6 * share**2)
