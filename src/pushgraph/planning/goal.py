"""What a plan shall bring about."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from pushgraph.body import Name
from pushgraph.errors import PlanningError
from pushgraph.pose import wrap_angle
from pushgraph.record import Record
from pushgraph.scene import Scene
from pushgraph.shape import Angle, Point


class Goal(Record):
    """A body shall be somewhere, and others shall stay. Positions in the world."""

    body: Name
    position: Point
    yaw: Angle | None = None
    """How it shall be turned (rad); None: however."""
    keep: tuple[Name, ...] = ()
    """Bodies that shall stay where they are."""
    tolerance: Annotated[float, Field(gt=0, le=1)] = 0.03
    """It is there if it is this near (m)."""
    yaw_tolerance: Annotated[float, Field(gt=0, le=math.pi)] = math.radians(15)
    """And turned at most this much too far or too little (rad)."""

    def check(self, scene: Scene) -> None:
        """Raise PlanningError if the scene has no such bodies, nothing moves the body, or the goal is off the table."""
        for name in (self.body, *self.keep):
            index_of(scene, name)
        if scene.immovable[index_of(scene, self.body)]:
            raise PlanningError(f"goal: body {self.body!r} is fixed: nothing moves it")
        if self.body in self.keep:
            raise PlanningError(f"goal: body {self.body!r} shall both move and stay")
        if not scene.table.holds(np.array([self.position])).all():
            x, y = scene.table.size
            raise PlanningError(
                f"goal: ({self.position[0]:g}, {self.position[1]:g}) is off the table of {x:g} x {y:g} m"
            )

    def error(self, pose_world_from_body: np.ndarray) -> tuple[float, float]:
        """How far the body is off its place (m) and its turn (rad, 0 if any will do)."""
        distance = math.dist(self.position, pose_world_from_body[:2])
        turn = 0.0 if self.yaw is None else abs(float(wrap_angle(pose_world_from_body[2:] - self.yaw)[0]))
        return distance, turn

    def reached(self, pose_world_from_body: np.ndarray) -> bool:
        """Whether a body there is where it shall be."""
        distance, turn = self.error(pose_world_from_body)
        return distance <= self.tolerance and turn <= self.yaw_tolerance


def index_of(scene: Scene, body: str) -> int:
    """Where a body stands in the scene; raises PlanningError if it is none of them."""
    if body not in scene.names:
        raise PlanningError(f"goal: no body {body!r}; valid: {', '.join(scene.names)}")
    return scene.names.index(body)
