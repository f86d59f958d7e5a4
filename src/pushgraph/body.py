"""Bodies on the table, and the joints between them."""

import math
from typing import Annotated, Literal

from pydantic import Field, StringConstraints, field_validator, model_validator

from pushgraph.record import Record
from pushgraph.shape import BodyShape, Point, Pose

ROBOT = "robot"
"""Name of the end-effector in tracks; no body may bear it."""

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]([A-Za-z0-9_. -]{0,62}[A-Za-z0-9_.-])?$")]

JointKind = Literal["fixed", "revolute", "prismatic"]


class Body(Record):
    """An object on the table."""

    name: Name
    shape: BodyShape
    pose_world_from_body: Pose
    mass: Annotated[float, Field(ge=0.001, le=1000)] | None = None
    """kg; None: unknown."""
    yaw_known: bool = True
    """False where the robot cannot see how the body is turned, as with a plain cylinder."""
    fixed: bool = False
    """True where nothing moves it: a wall, a fixture, the frame of a door."""
    support: Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)] | None = None
    """Points in its own frame on which it stands, such as its feet; None: on all of its outline."""

    @field_validator("name")
    @classmethod
    def _not_the_robot(cls, name: str) -> str:
        if name == ROBOT:
            raise ValueError(f"{ROBOT!r} is the end-effector's name; choose another")
        return name


class Joint(Record):
    """A joint between two bodies, given in the world frame at the bodies' poses in the scene.

    What is left out follows from the geometry: see `Scene.joint_frame`.
    """

    kind: JointKind
    parent: Name
    child: Name
    anchor: Point | None = None
    axis: Point | None = None
    """Direction in which the child slides relative to the parent (prismatic only); any length but zero."""
    limits: tuple[Annotated[float, Field(ge=-100, le=100)], Annotated[float, Field(ge=-100, le=100)]] | None = None
    """Lowest and highest angle (rad) or displacement (m), zero at the scene's poses."""

    @model_validator(mode="after")
    def _consistent(self) -> "Joint":
        if self.parent == self.child:
            raise ValueError(f"joins {self.parent!r} to itself; parent and child must differ")
        if self.axis is not None and self.kind != "prismatic":
            raise ValueError(f"axis: only a prismatic joint has an axis, this one is {self.kind}")
        if self.axis is not None and math.hypot(*self.axis) < 1e-6:
            raise ValueError(f"axis: must be a direction of non-zero length, got {list(self.axis)}")
        if self.limits is not None and self.kind == "fixed":
            raise ValueError("limits: a fixed joint has none")
        if self.limits is not None and (not self.limits[0] <= 0 <= self.limits[1] or self.limits[0] == self.limits[1]):
            raise ValueError(
                f"limits: must be [lowest <= 0, highest >= 0] with lowest < highest, got {list(self.limits)}"
            )
        return self
