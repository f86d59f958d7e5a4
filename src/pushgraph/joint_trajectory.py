"""What an arm's joints do over time, with the fields of ROS's trajectory_msgs/JointTrajectory, as JSON."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from pydantic import ValidationError, model_validator

from pushgraph.errors import ArmError
from pushgraph.record import Record, explain
from pushgraph.storage import replacing

NANOSECONDS = 1_000_000_000


class Duration(Record):
    """A time in ROS's whole numbers."""

    sec: int
    nanosec: int


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
            temporary.write_text(self.model_dump_json(indent=1))

    @classmethod
    def load(cls, path: str | os.PathLike) -> "JointTrajectory":
        """Read JSON; raises ArmError if it is none."""
        try:
            return cls.model_validate_json(Path(path).read_bytes())
        except OSError as error:
            raise ArmError(f"{path}: cannot read this joint trajectory: {error.strerror}") from None
        except ValidationError as error:
            raise ArmError(explain(error, str(path), None)) from None
