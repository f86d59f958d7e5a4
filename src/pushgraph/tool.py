"""What the end-effector pushes with, and how it pushes."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from pushgraph.record import Record
from pushgraph.shape import Angle, Cylinder, Point, Pose, Shape


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


class Push(Record):
    """A straight push: the tool comes down at `start`, moves, rests, and lifts.

    Where it goes: either `end`, or `direction` (rad, in the world) and `distance` (m).
    """

    start: Point
    end: Point | None = None
    direction: Angle | None = None
    distance: Annotated[float, Field(ge=0, le=5)] | None = None
    speed: Annotated[float, Field(ge=0.001, le=2)] = 0.2
    """Largest speed (m/s) of the end-effector; with a rotation, of any point of the tool."""
    yaw: Angle = 0.0
    """How the tool is turned at the start (rad)."""
    rotation: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = 0.0
    """How far the tool turns during the push (rad, counter-clockwise)."""

    @model_validator(mode="after")
    def _one_way_to_say_where(self) -> "Push":
        polar = (self.direction is not None, self.distance is not None)
        if any(polar) == (self.end is not None) or any(polar) != all(polar):
            raise ValueError("needs either end, or direction and distance")
        if self.end is not None and math.dist(self.start, self.end) > 5:
            raise ValueError(f"end: at most 5 m from start, got {math.dist(self.start, self.end):.3g} m")
        return self

    def path_length(self, tool: Tool) -> float:
        """Distance plus rotation times the tool's reach (m): no point of the tool moves farther."""
        return math.hypot(*self.displacement) + abs(self.rotation) * tool.reach

    @property
    def displacement(self) -> tuple[float, float]:
        """End minus start (m)."""
        if self.end is not None:
            return self.end[0] - self.start[0], self.end[1] - self.start[1]
        return self.distance * math.cos(self.direction), self.distance * math.sin(self.direction)
