"""What an arm's joints do over time, with the fields of ROS's trajectory_msgs/JointTrajectory, as JSON."""

import os
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field, model_validator

from pushgraph.errors import ArmError
from pushgraph.json_file import parse_object, read_text, validated
from pushgraph.record import Record
from pushgraph.storage import replacing

NANOSECONDS = 1_000_000_000


class Duration(Record):
    """A time in ROS's whole numbers."""

    sec: Annotated[int, Field(ge=0, lt=2**31)]
    nanosec: Annotated[int, Field(ge=0, lt=NANOSECONDS)]


class JointTrajectoryPoint(Record):
    """Where the joints are at a time, and how they move (rad, rad/s, rad/s^2)."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    accelerations: tuple[float, ...]
    time_from_start: Duration


class JointTrajectory(Record):
    """Named joints over time; between two points a cubic with the positions and velocities of both."""

    joint_names: tuple[str, ...]
    points: tuple[JointTrajectoryPoint, ...]

    @model_validator(mode="after")
    def _whole(self) -> "JointTrajectory":
        if len(set(self.joint_names)) < len(self.joint_names):
            raise ValueError("joint_names: must differ")
        late = np.flatnonzero(np.diff(self.times, prepend=-1.0) <= 0)
        if len(late):
            raise ValueError(f"points[{late[0]}].time_from_start: times must rise")
        for index, point in enumerate(self.points):
            for name in ("positions", "velocities", "accelerations"):
                if len(getattr(point, name)) != len(self.joint_names):
                    raise ValueError(f"points[{index}].{name}: needs one for each of {len(self.joint_names)} joints")
        return self

    @classmethod
    def of(
        cls,
        joint_names: Sequence[str],
        times: Float[np.ndarray, " points"],
        positions: Float[np.ndarray, "points joints"],
        velocities: Float[np.ndarray, "points joints"],
        accelerations: Float[np.ndarray, "points joints"],
    ) -> "JointTrajectory":
        """From arrays; times in s."""
        whole = np.round(times * NANOSECONDS).astype(np.int64).tolist()
        return cls(
            joint_names=tuple(joint_names),
            points=tuple(
                JointTrajectoryPoint(
                    positions=tuple(position),
                    velocities=tuple(velocity),
                    accelerations=tuple(acceleration),
                    time_from_start=Duration(sec=time // NANOSECONDS, nanosec=time % NANOSECONDS),
                )
                for time, position, velocity, acceleration in zip(
                    whole, positions.tolist(), velocities.tolist(), accelerations.tolist(), strict=True
                )
            ),
        )

    @property
    def times(self) -> Float[np.ndarray, " points"]:
        """Of the points (s)."""
        return np.array([p.time_from_start.sec + p.time_from_start.nanosec / NANOSECONDS for p in self.points])

    @property
    def positions(self) -> Float[np.ndarray, "points joints"]:
        """rad."""
        return np.array([point.positions for point in self.points])

    @property
    def velocities(self) -> Float[np.ndarray, "points joints"]:
        """rad/s."""
        return np.array([point.velocities for point in self.points])

    @property
    def accelerations(self) -> Float[np.ndarray, "points joints"]:
        """rad/s^2."""
        return np.array([point.accelerations for point in self.points])

    def save(self, path: str | os.PathLike) -> None:
        """Write JSON."""
        with replacing(path) as temporary:
            temporary.write_text(self.model_dump_json(indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike) -> "JointTrajectory":
        """Read JSON; raises ArmError if it is none."""
        text = read_text(path, "joint trajectory", ArmError)
        parse_object(text, str(path), "joint trajectory", ArmError)
        return validated(cls, text, str(path), ArmError)
