"""Scenes in space: boxes that lie on and beside each other, and a tool that levers one of them up.

SI units; a pose is a position (m) and a unit quaternion (w, x, y, z). See docs/lever-up.md for the file format.
"""

from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
import torch
from jaxtyping import Float
from pydantic import AfterValidator, Field, field_validator, model_validator

from pushgraph import pose_3d
from pushgraph.body import Name
from pushgraph.contact_axes import axes_between
from pushgraph.record import Record
from pushgraph.scene_file import SceneFile, is_trusted
from pushgraph.shape import Coordinate, Length

TOOL = "tool"
"""Name of the tool in tracks; no body may bear it."""
OVERLAP = 5e-4
"""The board may not overlap anything deeper than this (m) at the start."""
UNIT = 1e-3
"""How far the length of a quaternion may be from 1: it is made 1 where it is used."""
FASTEST = 2.0
"""m/s: the tool goes from way-point to way-point no faster."""
LONGEST = 600.0


def _unit(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > UNIT:
        raise ValueError(f"a quaternion (w, x, y, z) must have length 1, this one has {length:.4g}")
    return quaternion


Position = tuple[Coordinate, Coordinate, Coordinate]
Component = Annotated[float, Field(ge=-2, le=2)]
Quaternion = Annotated[tuple[Component, Component, Component, Component], AfterValidator(_unit)]
Size = tuple[Length, Length, Length]
Friction = Annotated[float, Field(ge=0, le=2)]


class Placed(Record):
    """Something with a pose."""

    position: Position
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """w, x, y, z."""

    @property
    def pose(self) -> Float[np.ndarray, "7"]:
        """Position and quaternion, of length 1."""
        return pose_3d.normalized(np.array([*self.position, *self.quaternion]))


class Box(Placed):
    """A box; `size` is its full extent along its own axes, its origin is its centre."""

    name: Name
    size: Size
    fixed: bool = False
    """True where nothing moves it: the drive, a ledge."""
    mass: Annotated[float, Field(ge=0.001, le=1000)] = 0.1
    """kg, spread evenly; that of a fixed box does not matter."""
    friction: Friction = 0.3
    """Of two that touch, the larger counts."""

    @field_validator("name")
    @classmethod
    def _not_the_tool(cls, name: str) -> str:
        if name == TOOL:
            raise ValueError(f"{TOOL!r} is the tool's name; choose another")
        return name


class ToolBox(Placed):
    """A box of the tool, placed in the tool's frame."""

    size: Size


class LeverTool(Record):
    """A tool of boxes, which goes exactly as its path says, whatever is in its way."""

    boxes: Annotated[tuple[ToolBox, ...], Field(min_length=1, max_length=32)]
    friction: Friction = 0.3


class WayPoint(Placed):
    """Where the tool's frame is at a time (s).

    Between two way-points its origin moves along a straight line and it turns about its origin, both evenly: so
    a tool turns exactly about the rim on which its origin lies.
    """

    time: Annotated[float, Field(ge=0, le=LONGEST)]


class LeverScene(SceneFile):
    """A board that lies among fixed boxes, and what the tool will do to it.

    Raises SceneError, naming the body and the field, if anything does not fit.
    """

    format: Literal["pushgraph.lever-scene"] = "pushgraph.lever-scene"
    version: Literal[1] = 1
    bodies: Annotated[tuple[Box, ...], Field(min_length=2, max_length=100)]
    """The board is the one that is not fixed."""
    tool: LeverTool
    path: Annotated[tuple[WayPoint, ...], Field(min_length=1, max_length=100_000)]
    gravity: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, -9.81)
    """m/s2"""

    @model_validator(mode="after")
    def _consistent(self, info: Any) -> "LeverScene":
        if not is_trusted(info):
            self._check_bodies()
            self._check_path()
            self._check_overlap()
        return self

    def _check_bodies(self) -> None:
        for name in self.names:
            if self.names.count(name) > 1:
                raise ValueError(f"bodies: the name {name!r} is used {self.names.count(name)} times; names must differ")
        free = [body.name for body in self.bodies if not body.fixed]
        if len(free) != 1:
            raise ValueError(
                f"bodies: exactly one must not be fixed, the board; of these {len(free)} are not: {', '.join(free)}"
            )

    def _check_path(self) -> None:
        if self.path[0].time != 0:
            raise ValueError(f"path[0].time: the first way-point must be at 0 s, got {self.path[0].time:g}")
        for index, (before, after) in enumerate(pairwise(self.path), start=1):
            if after.time <= before.time:
                raise ValueError(f"path[{index}].time: times must rise, got {after.time:g} after {before.time:g} s")
            speed = np.linalg.norm(np.subtract(after.position, before.position)) / (after.time - before.time)
            if speed > FASTEST:
                raise ValueError(
                    f"path[{index}].position: reached at {speed:.3g} m/s; at most {FASTEST:g} m/s are valid"
                )

    def _check_overlap(self) -> None:
        board, poses = self.bodies[self.board], self.poses_world_from_body
        for index, body in enumerate(self.bodies):
            deep = depth(board.size, poses[self.board], body.size, poses[index])
            if body.fixed and deep > OVERLAP:
                raise ValueError(
                    f"body {board.name!r}: position: it lies inside {body.name!r}, {deep * 1e3:.1f} mm deep; "
                    f"at most {OVERLAP * 1e3:g} mm is valid"
                )
        for box in self.tool.boxes:
            start = pose_3d.compose(self.path[0].pose, box.pose)
            deep = depth(board.size, poses[self.board], box.size, start)
            if deep > OVERLAP:
                raise ValueError(
                    f"path[0].position: the tool starts inside body {board.name!r}, {deep * 1e3:.1f} mm deep; "
                    f"at most {OVERLAP * 1e3:g} mm is valid"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in order."""
        return tuple(body.name for body in self.bodies)

    @property
    def board(self) -> int:
        """Index of the board among the bodies."""
        return next(index for index, body in enumerate(self.bodies) if not body.fixed)

    @property
    def poses_world_from_body(self) -> Float[np.ndarray, "bodies 7"]:
        """Poses of the bodies at the start, in order."""
        return np.array([body.pose for body in self.bodies])

    @property
    def duration(self) -> float:
        """Time of the last way-point (s)."""
        return self.path[-1].time

    def tool_poses(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times 7"]:
        """pose_world_from_tool at times (s); after the last way-point it rests there."""
        points = np.array([point.pose for point in self.path])
        reached = np.array([point.time for point in self.path])
        before = np.clip(np.searchsorted(reached, times, side="right") - 1, 0, len(points) - 1)
        after = np.minimum(before + 1, len(points) - 1)
        length = np.where(after > before, reached[after] - reached[before], 1.0)
        share = np.where(after > before, (times - reached[before]) / length, 0.0)[:, None]
        start, end = points[before], points[after]
        turn = pose_3d.rotation_vector(pose_3d.multiply(pose_3d.conjugate(start[:, 3:]), end[:, 3:]))
        quaternion = pose_3d.multiply(start[:, 3:], pose_3d.from_rotation_vector(share * turn))
        return np.concatenate((start[:, :3] + share * (end[:, :3] - start[:, :3]), quaternion), axis=-1)

    def board_at(self, pose_world_from_board: Float[np.ndarray, "7"]) -> "LeverScene":
        """The same scene with the board at another pose."""
        x, y, z, *quaternion = pose_world_from_board.tolist()
        moved = self.bodies[self.board].replace(position=(x, y, z), quaternion=tuple(quaternion))
        return self.replace(bodies=(*self.bodies[: self.board], moved, *self.bodies[self.board + 1 :]))


def corners(size: Size, poses: Float[np.ndarray, "*batch 7"]) -> Float[np.ndarray, "*batch 8 3"]:
    """The corners of a box at poses (m)."""
    signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij"), axis=-1).reshape(8, 3)
    return pose_3d.transform(poses[..., None, :], signs * np.asarray(size))


def depth(
    size_a: Size, poses_a: Float[np.ndarray, "*#batch 7"], size_b: Size, poses_b: Float[np.ndarray, "*#batch 7"]
) -> Float[np.ndarray, "..."]:
    """How deep two boxes overlap (m): the shortest way to part them; negative where they are apart."""
    pose_a, pose_b = torch.broadcast_tensors(torch.from_numpy(poses_a), torch.from_numpy(poses_b))
    half_a, half_b = (
        torch.tensor(size, dtype=torch.float64).expand(*pose_a.shape[:-1], 3) / 2 for size in (size_a, size_b)
    )
    return (-axes_between(pose_a, half_a, pose_b, half_b).gap.amax(-1)).numpy()
