"""What the end-effector pushes with, and how it pushes."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from pushgraph import pose
from pushgraph.record import Record
from pushgraph.shape import Angle, Coordinate, Cylinder, Point, Pose, Shape

FASTEST = 2.0
"""No point of a tool is faster (m/s)."""


class Part(Record):
    """A part of a tool."""

    shape: Shape
    pose_tool_from_part: Pose = (0.0, 0.0, 0.0)


class Tool(Record):
    """What the end-effector pushes with: parts that move as one with it. They may overlap."""

    parts: Annotated[tuple[Part, ...], Field(min_length=1, max_length=64)]

    @classmethod
    def round(cls, diameter: float) -> "Tool":
        """A round pusher around the end-effector; diameter in m."""
        return cls(parts=(Part(shape=Cylinder(diameter=diameter)),))

    @property
    def reach(self) -> float:
        """Distance from the end-effector to the farthest point of the tool (m)."""
        return max(
            math.hypot(*part.pose_tool_from_part[:2]) + math.hypot(*part.shape.core[:2]) + part.shape.core[2]
            for part in self.parts
        )


WayPoint = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3)]
"""[x, y] (m), or [x, y, yaw] (m, rad), in the world."""


class Push(Record):
    """A push: the tool comes down at `start`, moves, rests, and lifts.

    Where it goes, one of three: `end`; `direction` (rad, in the world) and `distance` (m); or `path`.
    """

    start: Point
    end: Point | None = None
    direction: Angle | None = None
    distance: Annotated[float, Field(ge=0, le=5)] | None = None
    path: Annotated[tuple[WayPoint, ...], Field(min_length=1, max_length=10_000)] | None = None
    """Way-points after the start, joined by straight lines. The tool turns evenly from yaw to yaw (not wrapped), and
    stays as it is turned on the way to a point without one. It does not stop at corners."""
    times: Annotated[tuple[Annotated[float, Field(gt=0, le=600)], ...], Field(min_length=1)] | None = None
    """When it reaches each way-point of the path (s after the start), evenly between them; `speed` is of no matter."""
    speed: Annotated[float, Field(ge=0.001, le=FASTEST)] = 0.2
    """Largest speed (m/s) of the end-effector; where the tool turns, of any point of it."""
    yaw: Angle = 0.0
    """How the tool is turned at the start (rad)."""
    rotation: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = 0.0
    """How far the tool turns during a straight push (rad, counter-clockwise)."""
    rest: Annotated[float, Field(ge=0, le=60)] = 0.2
    """How long the tool rests at the end before it lifts (s)."""
    force_limit: Annotated[float, Field(ge=0.001, le=1e6)] | None = None
    """Largest force that the pusher exerts along its motion before it stalls (N); None: infinite."""

    @model_validator(mode="after")
    def _one_way_to_say_where(self) -> "Push":
        polar = (self.direction is not None, self.distance is not None)
        ways = (self.end is not None, any(polar), self.path is not None)
        if sum(ways) != 1 or any(polar) != all(polar):
            raise ValueError("needs either end, or direction and distance, or path")
        if self.end is not None and math.dist(self.start, self.end) > 5:
            raise ValueError(f"end: at most 5 m from start, got {math.dist(self.start, self.end):.3g} m")
        if self.path is not None and self.rotation:
            raise ValueError("rotation: belongs to straight pushes; give the way-points of the path a yaw: [x, y, yaw]")
        return self

    @model_validator(mode="after")
    def _times_fit_the_path(self) -> "Push":
        if self.times is None:
            return self
        if self.path is None:
            raise ValueError("times: belong to the way-points of a path; a straight push has a speed")
        if len(self.times) != len(self.path):
            raise ValueError(
                f"times: needs one for each of the {len(self.path)} way-points of the path, got {len(self.times)}"
            )
        for index, (before, after) in enumerate(pairwise(self.times), start=1):
            if after <= before:
                raise ValueError(f"times[{index}]: must rise, got {after:g} s after {before:g} s")
        return self

    def until(self, seconds: float) -> "Push":
        """The same push, ended so long after its start (s), without a rest; only where `times` say when it is where."""
        if self.times is None or self.path is None:
            raise ValueError("until: needs a push with times")
        if seconds >= self.times[-1]:
            return self
        waypoints = self.waypoints
        times = np.array([0.0, *self.times])
        end = tuple(float(np.interp(seconds, times, column)) for column in waypoints.T)
        before = int(np.searchsorted(times, seconds)) - 1
        return self.replace(path=(*self.path[:before], end), times=(*self.times[:before], seconds))

    def moved(self, pose_new_from_world: Float[np.ndarray, "3"]) -> "Push":
        """Return the same push, seen from another world frame."""

        def seen(point: Sequence[float]) -> tuple[float, ...]:
            old = np.asarray(point, dtype=float)
            new = (pose.transform if len(point) == 2 else pose.compose)(pose_new_from_world, old)
            return tuple(new.tolist())

        turn = float(pose_new_from_world[2])
        return self.replace(
            start=seen(self.start),
            end=None if self.end is None else seen(self.end),
            direction=None if self.direction is None else self.direction + turn,
            path=None if self.path is None else tuple(seen(point) for point in self.path),
            yaw=self.yaw + turn,
        )

    @property
    def waypoints(self) -> Float[np.ndarray, "points 3"]:
        """pose_world_from_tool at the start and at every way-point after it; a straight push has one, its end."""
        if self.path is None:
            x, y = self.displacement
            return np.array([*self.start, self.yaw]) + np.array([[0.0, 0.0, 0.0], [x, y, self.rotation]])
        poses = [[*self.start, self.yaw]]
        for point in self.path:
            poses.append([*point] if len(point) == 3 else [*point, poses[-1][2]])
        return np.array(poses)

    def lengths(self, tool: Tool) -> Float[np.ndarray, " lines"]:
        """Of each line between way-points: distance plus rotation times the tool's reach (m).

        No point of the tool moves farther.
        """
        change = np.abs(np.diff(self.waypoints, axis=0))
        return np.hypot(change[:, 0], change[:, 1]) + change[:, 2] * tool.reach

    def path_length(self, tool: Tool) -> float:
        """Sum of the `lengths` (m)."""
        return float(self.lengths(tool).sum())

    @property
    def displacement(self) -> tuple[float, float]:
        """End minus start (m)."""
        if self.direction is not None and self.distance is not None:
            return self.distance * math.cos(self.direction), self.distance * math.sin(self.direction)
        end = self.path[-1] if self.path is not None else self.end or self.start
        return end[0] - self.start[0], end[1] - self.start[1]
