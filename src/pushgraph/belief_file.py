"""What stands in beliefs.json, and what may stand there."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from pushgraph.believed_joint import BelievedJoint
from pushgraph.graph.scene_batch import JOINT_CODES
from pushgraph.mass_history import MassHistory
from pushgraph.record import Record
from pushgraph.scene import Scene

ROUNDED = 1e-3
"""Probabilities are rounded where they are written: together they are 1 within this."""

Share = Annotated[float, Field(ge=0, le=1)]
Point = tuple[float, float]
Interval = tuple[float, float, float]
"""Median, low, high."""


class JointEntry(Record):
    """See `BelievedJoint`."""

    parent: str
    child: str
    kind: Literal["fixed", "prismatic", "revolute"]
    probability: Share
    anchor: Point | None = None
    anchor_spread: Annotated[float, Field(ge=0)] | None = None
    axis: Point | None = None
    axis_spread: Annotated[float, Field(ge=0)] | None = None
    reached: Point | None = None

    @model_validator(mode="after")
    def _fits_its_kind(self) -> "JointEntry":
        for name, kind in (("anchor", "revolute"), ("axis", "prismatic")):
            given = [getattr(self, field) is not None for field in (name, f"{name}_spread")]
            if given != [self.kind == kind] * 2:
                raise ValueError(f"{name}, {name}_spread: {kind} joints have both, others neither")
        if self.axis is not None and abs(math.hypot(*self.axis) - 1) > ROUNDED:
            raise ValueError(f"axis: must have length 1, got {list(self.axis)}")
        if self.reached is not None and self.reached[0] > self.reached[1]:
            raise ValueError(f"reached: must be [lowest, highest], got {list(self.reached)}")
        return self


class MassEntry(Record):
    """See `BelievedMass`."""

    body: str
    classes: dict[str, float]
    mass: Interval
    slide: Interval
    ratios: dict[str, Interval]


class MassEntries(Record):
    """See `MassHistory`."""

    classes: tuple[str, ...]
    times: tuple[float, ...]
    probabilities: tuple[tuple[tuple[float, ...], ...], ...]
    quantiles: tuple[tuple[Interval, ...], ...]
    believed: tuple[MassEntry, ...]
    friction: tuple[Interval, ...] | None = None


class BeliefFile(Record):
    """See `BeliefHistory`. joints: names of the columns of `probabilities`."""

    format: Literal["pushgraph.beliefs"] = "pushgraph.beliefs"
    version: Literal[3] = 3
    joints: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    times: Annotated[tuple[float, ...], Field(min_length=1)]
    probabilities: tuple[tuple[tuple[Share, ...], ...], ...]
    lost: dict[str, tuple[tuple[float, float], ...]]
    believed_joints: tuple[JointEntry, ...]
    masses: MassEntries | None
    scene: Scene
    checksum: str | None = None

    @model_validator(mode="after")
    def _whole(self) -> "BeliefFile":
        if self.joints != tuple(JOINT_CODES):
            raise ValueError(f"joints: must be {list(JOINT_CODES)}, in this order, got {list(self.joints)}")
        names = self.scene.names
        for pair in (*self.pairs, *((joint.parent, joint.child) for joint in self.believed_joints)):
            _check_names(pair, names)
            if pair[0] == pair[1]:
                raise ValueError(f"{pair[0]!r} makes no pair with itself")
        pairs = [frozenset(pair) for pair in self.pairs]
        if len(set(pairs)) < len(pairs):
            raise ValueError("pairs: one stands there twice")
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if len(late):
            raise ValueError(f"times[{late[0] + 1}]: times must rise, got {self.times[late[0] + 1]:g} s")
        self._check_probabilities()
        for name, stretches in self.lost.items():
            _check_names((name,), ("robot", *names))
            if any(first > last for first, last in stretches):
                raise ValueError(f"lost: {name!r}: must be [first, last] times, got {list(map(list, stretches))}")
        return self

    def _check_probabilities(self) -> None:
        shape = len(self.times), len(self.pairs), len(JOINT_CODES)
        if len(self.probabilities) != shape[0]:
            raise ValueError(f"probabilities: shape must be {shape}, got {len(self.probabilities)} rows")
        for frame, rows in enumerate(self.probabilities):
            if len(rows) != shape[1] or any(len(row) != shape[2] for row in rows):
                raise ValueError(f"probabilities: shape must be {shape}, row {frame} differs")
            for pair, row in zip(self.pairs, rows, strict=True):
                if abs(sum(row) - 1) > ROUNDED:
                    of_pair = f"{pair[0]!r} and {pair[1]!r}"
                    raise ValueError(f"probabilities[{frame}]: of {of_pair}: must be 1 together, got {sum(row):g}")

    def joints_believed(self) -> list[BelievedJoint]:
        """Those of the end."""
        return [BelievedJoint.from_json(entry.model_dump()) for entry in self.believed_joints]

    def mass_history(self, where: str) -> MassHistory | None:
        """What was believed of masses; raises BeliefError, which begins with `where`, if it cannot be."""
        if self.masses is None:
            return None
        content: dict[str, Any] = self.masses.model_dump()
        return MassHistory.from_json(content, self.scene, where)


def _check_names(names: Sequence[str], valid: Sequence[str]) -> None:
    for name in names:
        if name not in valid:
            raise ValueError(f"{name!r} is no body of the scene; valid: {', '.join(valid)}")
