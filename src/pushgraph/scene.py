"""Scenes: bodies, joints, a tool and its pushes on a table. SI units, radians, poses (x, y, yaw).

A number that is None is unknown to the robot. See docs/scene.md for the file format.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field, model_validator

from pushgraph import pose
from pushgraph.arm import Arm
from pushgraph.body import Body, Joint, Name
from pushgraph.contact import Contact, signed_gap
from pushgraph.mass_prior import MASS_CLASSES, MassClass, check_classes
from pushgraph.notebook import png_of
from pushgraph.parts import contacts_of_bodies, parts_of
from pushgraph.record import Record
from pushgraph.scene_file import SceneFile, is_trusted
from pushgraph.shape import Length, Point, Pose, rounded_boxes, take
from pushgraph.tool import FASTEST, Push, Tool

FORMAT = "pushgraph.scene"
VERSION = 1
OVERLAP = 1e-3
"""Bodies that overlap deeper than this (m) are refused, unless one rigid group holds both."""

NEAR = 0.05
"""Gaps to the tool are exact where they are less than this (m)."""
LONGEST_PUSH = 600.0
"""A push that takes longer (s) is refused: a speed or a rotation that nobody meant."""
SWING, SLIDE = math.pi / 2, 0.08
"""How far a hinge turns to either side (rad), and a slider moves apart (m), unless a joint says otherwise."""
NOMINAL_MASS = 0.6
NOMINAL_TABLE_FRICTION = 0.45
NOMINAL_SIDE_FRICTION = 0.25
MOST_ANISOTROPY = 0.5
"""Friction along the grain of a table is at most three times that across it."""


class Table(Record):
    """A rectangular table top centred at its own frame; `friction` is that of the bodies' feet on it.

    A table with a grain, of brushed metal or wood, has two frictions: along the direction `grain` (rad, in its own
    frame) friction times 1 + anisotropy, across it times 1 - anisotropy.
    """

    size: tuple[Length, Length] = (2.0, 2.0)
    friction: Annotated[float, Field(gt=0, le=2)] | None = NOMINAL_TABLE_FRICTION
    pose_world_from_table: Pose = (0.0, 0.0, 0.0)
    anisotropy: Annotated[float, Field(ge=0, le=MOST_ANISOTROPY)] = 0.0
    grain: float = 0.0

    @property
    def grain_world(self) -> float:
        """Direction of the grain in the world frame (rad)."""
        return self.pose_world_from_table[2] + self.grain

    def holds(self, points_world: Float[np.ndarray, "*batch 2"]) -> np.ndarray:
        """Whether each point lies on the table."""
        pose_table_from_world = pose.inverse(np.asarray(self.pose_world_from_table, dtype=float))
        points = pose.transform(pose_table_from_world, np.asarray(points_world, dtype=float))
        return (np.abs(points) <= np.asarray(self.size) / 2).all(-1)


class JointFrame(NamedTuple):
    """Where a joint sits, in the world frame at the bodies' poses in the scene (m, rad)."""

    anchor: Float[np.ndarray, "2"]
    axis: Float[np.ndarray, "2"]
    limits: tuple[float, float]


def place_joint(
    joint: Joint,
    pose_world_from_parent: Float[np.ndarray, "3"],
    pose_world_from_child: Float[np.ndarray, "3"],
    gap: float,
    middle: Float[np.ndarray, "2"],
) -> JointFrame:
    """Where a joint sits, given the gap of its bodies and the middle of where they face, in the frame of the parent.

    What is left out: the anchor is that middle (see `Contact.middle`); the axis the line of centres, parent to
    child; the limits half pi to either side (revolute), until the two touch, or 8 cm apart (prismatic).
    """
    anchor = np.array(joint.anchor) if joint.anchor else pose.transform(pose_world_from_parent, middle)
    axis = np.array(joint.axis) if joint.axis else pose_world_from_child[:2] - pose_world_from_parent[:2]
    length = np.hypot(*axis)
    axis = axis / length if length > 1e-9 else np.array([1.0, 0.0])
    default = {
        "fixed": (0.0, 0.0),
        "revolute": (-SWING, SWING),
        "prismatic": (-max(gap, 0.0), SLIDE),
    }[joint.kind]
    return JointFrame(anchor, axis, joint.limits or default)


class Scene(SceneFile):
    """Everything on the table, what the robot will do, and what it does not know.

    Raises SceneError, naming the body and the field, if anything does not fit.
    """

    format: Literal["pushgraph.scene"] = "pushgraph.scene"
    version: Literal[1] = 1
    bodies: Annotated[tuple[Body, ...], Field(min_length=1, max_length=1000)]
    joints: tuple[Joint, ...] = ()
    rigid_groups: tuple[Annotated[tuple[Name, ...], Field(min_length=2)], ...] = ()
    """Names of bodies known to be one piece; they may overlap."""
    tool: Tool = Tool.round(0.10)
    pushes: tuple[Push, ...] = ()
    table: Table = Table()
    arm: Arm | None = None
    """What holds the tool; None: not said."""
    side_friction: Annotated[float, Field(ge=0, le=2)] | None = NOMINAL_SIDE_FRICTION
    """Between bodies, and between bodies and tool; None: unknown."""
    unknown_pairs: tuple[tuple[Name, Name], ...] | Literal["unlisted"] = ()
    """Pairs that may be joined or not; "unlisted": all that `joints` and `rigid_groups` do not list."""
    mass_classes: tuple[MassClass, ...] | None = None
    """What bodies of unknown mass may weigh; None: MASS_CLASSES."""
    clearance: Annotated[float, Field(ge=0, le=1)] | None = None
    """How far from every body planned pushes come down (m); None: as the planner does by default."""

    @model_validator(mode="after")
    def _consistent(self, info: Any) -> "Scene":
        if not is_trusted(info):
            self._check_names()
            self._check_places()
            check_classes(self.classes_of_mass)
        return self

    def _repr_png_(self) -> bytes | None:
        return png_of(self)

    @property
    def classes_of_mass(self) -> tuple[MassClass, ...]:
        """What bodies of unknown mass may weigh."""
        return MASS_CLASSES if self.mass_classes is None else self.mass_classes

    def _check_names(self) -> None:
        names = [body.name for body in self.bodies]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"bodies: the name {name!r} is used {names.count(name)} times; names must differ")
        valid = f"valid: {', '.join(names[:20])}{', ...' if len(names) > 20 else ''}"
        for index, joint in enumerate(self.joints):
            for end in ("parent", "child"):
                if getattr(joint, end) not in names:
                    raise ValueError(f"joints[{index}].{end}: no body {getattr(joint, end)!r}; {valid}")
        grouped: set[str] = set()
        for index, group in enumerate(self.rigid_groups):
            for name in group:
                if name not in names:
                    raise ValueError(f"rigid_groups[{index}]: no body {name!r}; {valid}")
                if name in grouped:
                    raise ValueError(f"rigid_groups[{index}]: body {name!r} stands twice in rigid groups")
                grouped.add(name)
        joined: set[frozenset[str]] = set()
        for index, joint in enumerate(self.joints):
            pair = frozenset((joint.parent, joint.child))
            if pair in joined:
                raise ValueError(f"joints[{index}]: {joint.parent!r} and {joint.child!r} are joined already")
            if any(pair <= set(group) for group in self.rigid_groups):
                raise ValueError(f"joints[{index}]: a rigid group holds both {joint.parent!r} and {joint.child!r}")
            joined.add(pair)
        still = {name for name, immovable in zip(names, self.immovable, strict=True) if immovable}
        for index, joint in enumerate(self.joints):
            if {joint.parent, joint.child} <= still:
                raise ValueError(
                    f"joints[{index}]: neither {joint.parent!r} nor {joint.child!r} can move, being fixed or of one "
                    "piece with a fixed body; one of the two must be free"
                )
        for index, names_of_pair in enumerate(self.unknown_pairs if isinstance(self.unknown_pairs, tuple) else ()):
            pair = frozenset(names_of_pair)
            for name in pair - set(names):
                raise ValueError(f"unknown_pairs[{index}]: no body {name!r}; {valid}")
            if len(pair) < 2 or pair in joined or any(pair <= set(group) for group in self.rigid_groups):
                raise ValueError(f"unknown_pairs[{index}]: {list(names_of_pair)} is one body, or known to be joined")

    def _check_places(self) -> None:
        on_table = self.on_table(self.poses_world_from_body)
        for body, valid in zip(self.bodies, on_table | self.immovable, strict=True):
            if not valid:
                x, y = self.table.size
                raise ValueError(
                    f"body {body.name!r}: pose_world_from_body: the centre stands off the table of {x:g} x {y:g} m"
                )
        apart = self.pairs_that_collide
        if apart:
            gaps = self.contacts(apart).gap
            if gaps.min() < -OVERLAP:
                i, j = apart[int(gaps.argmin())]
                raise ValueError(
                    f"bodies {self.bodies[i].name!r} and {self.bodies[j].name!r}: pose_world_from_body: they overlap "
                    f"by {-gaps.min() * 1e3:.1f} mm; at most {OVERLAP * 1e3:g} mm is valid outside a rigid group"
                )
        self._check_pushes()
        if self.pushes:
            start = np.array([[*self.pushes[0].start, self.pushes[0].yaw]])
            gaps = self.tool_gaps(start, self.poses_world_from_body)[0]
            if gaps.min() < -OVERLAP:
                raise ValueError(
                    f"pushes[0].start: the tool would come down on body {self.bodies[int(gaps.argmin())].name!r}, "
                    f"{-gaps.min() * 1e3:.1f} mm deep; at most {OVERLAP * 1e3:g} mm is valid"
                )

    def _check_pushes(self) -> None:
        for index, push in enumerate(self.pushes):
            if push.times is not None:
                speeds = push.lengths(self.tool) / np.diff((0.0, *push.times))
                if speeds.max() > FASTEST * (1 + 1e-9):
                    raise ValueError(
                        f"pushes[{index}].path[{int(speeds.argmax())}]: reached at {speeds.max():.3g} m/s by its "
                        f"times (rotation counts at the tool's reach); at most {FASTEST:g} m/s are valid"
                    )
            elif push.path_length(self.tool) / push.speed > LONGEST_PUSH:
                raise ValueError(
                    f"pushes[{index}]: takes {push.path_length(self.tool) / push.speed:.0f} s at this speed; at most "
                    f"{LONGEST_PUSH:g} s are valid"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in order."""
        return tuple(body.name for body in self.bodies)

    @property
    def poses_world_from_body(self) -> Float[np.ndarray, "bodies 3"]:
        """Poses of the bodies, in order."""
        return np.array([body.pose_world_from_body for body in self.bodies])

    @property
    def immovable(self) -> Bool[np.ndarray, " bodies"]:
        """Whether each body stays where it is: fixed itself, or of one rigid group with a fixed one."""
        fixed = {body.name for body in self.bodies if body.fixed}
        fixed |= {name for group in self.rigid_groups if fixed & set(group) for name in group}
        return np.array([name in fixed for name in self.names])

    def on_table(self, poses_world_from_body: Float[np.ndarray, "*batch bodies 3"]) -> Bool[np.ndarray, "..."]:
        """Whether the centre of each body's outline lies on the table."""
        centroids = np.array([body.shape.centroid for body in self.bodies])
        return self.table.holds(pose.transform(poses_world_from_body, centroids))

    @property
    def pairs_apart(self) -> list[tuple[int, int]]:
        """Pairs of bodies (indices, in order) that no rigid group holds both of."""
        piece = {name: index for index, group in enumerate(self.rigid_groups) for name in group}
        pieces = [piece.get(body.name, -1 - k) for k, body in enumerate(self.bodies)]
        return [(i, j) for i, j in combinations(range(len(pieces)), 2) if pieces[i] != pieces[j]]

    @property
    def pairs_that_collide(self) -> list[tuple[int, int]]:
        """Those of `pairs_apart` of which one can move: they may not overlap."""
        still = self.immovable
        return [(i, j) for i, j in self.pairs_apart if not (still[i] and still[j])]

    def contacts(self, pairs: Sequence[tuple[int, int]]) -> Contact:
        """Contact of each pair of bodies (indices), in the frame of the first (float64)."""
        parts = parts_of([body.shape for body in self.bodies])
        return contacts_of_bodies(parts, self.poses_world_from_body, pairs).contact

    def pair_gaps(
        self, pairs: Sequence[tuple[int, int]], poses_world_from_body: Float[np.ndarray, "frames bodies 3"]
    ) -> Float[np.ndarray, "frames pairs"]:
        """Signed gap (m) of pairs of bodies (indices) as they move; infinite where their circles stand apart."""
        parts = parts_of([body.shape for body in self.bodies])
        owned = [np.flatnonzero(parts.owner == body) for body in range(len(self.bodies))]
        of_pair, first, second = np.array(
            [(k, m, n) for k, (a, b) in enumerate(pairs) for m in owned[a] for n in owned[b]]
        ).T
        poses = parts.poses(poses_world_from_body)
        distance = np.hypot(*np.moveaxis(poses[:, first, :2] - poses[:, second, :2], -1, 0))
        frame, near = np.nonzero(distance < parts.circles[first] + parts.circles[second])
        a, b = first[near], second[near]
        gaps = signed_gap(
            take(parts.boxes, a), take(parts.boxes, b), pose.relative(poses[frame, a], poses[frame, b])
        )
        least = np.full((len(poses), len(pairs)), np.inf)
        np.minimum.at(least, (frame, of_pair[near]), gaps)
        return least

    def tool_gaps(
        self,
        poses_world_from_tool: Float[np.ndarray, "poses 3"],
        poses_world_from_body: Float[np.ndarray, "*#poses bodies 3"],
    ) -> Float[np.ndarray, "poses bodies"]:
        """Signed gap (m) between the tool at each pose and each body, which may move from pose to pose.

        Exact where it is less than NEAR; where it is more, at least NEAR and at most what it is.
        """
        tool_parts = self.tool.parts
        poses_tool_from_part = np.array([part.pose_tool_from_part for part in tool_parts])
        poses_world_from_part = pose.compose(poses_world_from_tool[:, None], poses_tool_from_part)
        tool_boxes = rounded_boxes([part.shape for part in tool_parts])
        bodies = parts_of([body.shape for body in self.bodies])
        poses = np.broadcast_to(bodies.poses(poses_world_from_body), (len(poses_world_from_tool), len(bodies.owner), 3))
        between = poses[:, :, None, :2] - poses_world_from_part[:, None, :, :2]
        circles = bodies.circles[:, None] + np.hypot(*tool_boxes.half_extents.T) + tool_boxes.radius
        gaps = np.hypot(between[..., 0], between[..., 1]) - circles
        at, body, part = np.nonzero(gaps < NEAR)
        gaps[at, body, part] = signed_gap(
            take(bodies.boxes, body),
            take(tool_boxes, part),
            pose.relative(poses[at, body], poses_world_from_part[at, part]),
        )
        return bodies.least(gaps.min(-1))

    def joint_frame(self, joint: Joint) -> JointFrame:
        """Anchor, axis and limits of a joint, those left out drawn from the geometry; see `place_joint`."""
        parent, child = self.names.index(joint.parent), self.names.index(joint.child)
        touch = self.contacts([(parent, child)])
        poses = self.poses_world_from_body
        return place_joint(joint, poses[parent], poses[child], float(touch.gap[0]), touch.middle[0])

    def with_nominal_values(self) -> "Scene":
        """Return the scene with every unknown mass and friction at its nominal value."""
        return self.replace(
            bodies=tuple(b.replace(mass=NOMINAL_MASS) if b.mass is None else b for b in self.bodies),
            table=self.table.replace(friction=self.table.friction or NOMINAL_TABLE_FRICTION),
            side_friction=NOMINAL_SIDE_FRICTION if self.side_friction is None else self.side_friction,
        )

    def moved(self, pose_new_from_world: Sequence[float] | np.ndarray) -> "Scene":
        """Return the same scene, table and all, seen from another world frame."""
        motion = np.asarray(pose_new_from_world, dtype=float)

        def at(old: Sequence[float]) -> tuple[float, ...]:
            return tuple(pose.compose(motion, np.asarray(old, dtype=float)).tolist())

        def point(old: Point | None) -> Point | None:
            return None if old is None else tuple(pose.transform(motion, np.asarray(old, dtype=float)).tolist())

        def turned(old: Point | None) -> Point | None:
            return None if old is None else tuple(pose.rotate(np.asarray(old, dtype=float), motion[2]).tolist())

        return self.replace(
            bodies=tuple(b.replace(pose_world_from_body=at(b.pose_world_from_body)) for b in self.bodies),
            joints=tuple(j.replace(anchor=point(j.anchor), axis=turned(j.axis)) for j in self.joints),
            pushes=tuple(push.moved(motion) for push in self.pushes),
            table=self.table.replace(pose_world_from_table=at(self.table.pose_world_from_table)),
            arm=None if self.arm is None else self.arm.moved(motion),
        )
