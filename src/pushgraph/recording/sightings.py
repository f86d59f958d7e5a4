"""Sightings: what any recording holds, one row for each node at each time, in the recording's own units and axes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.errors import TrackError
from pushgraph.wrench import COMPONENTS, NO_READING

FARTHEST = 1e8
"""Positions beyond this, whatever their unit, are damaged."""
NO_PUSH = -2
"""The recording does not say which push is under way."""


class Declared(NamedTuple):
    """Units and axes as a recording's header, or its user, names them; None: not said. See `Convention`."""

    length: str | None = None
    angle: str | None = None
    time: str | None = None
    axes: str | None = None
    frame: str | None = None

    def overruled_by(self, other: "Declared") -> "Declared":
        """Take what the other says, and where it says nothing what this one does."""
        return Declared(*(mine if theirs is None else theirs for mine, theirs in zip(self, other, strict=True)))


NOTHING_DECLARED = Declared()


class ReadOptions(NamedTuple):
    """What a reader must be told where its file leaves it open.

    up: the axis of spatial poses that points away from the table: x, y or z, None: as usual for the format. episode: of
    a data set that holds several.
    """

    up: str | None = None
    episode: int | None = None


DEFAULTS = ReadOptions()


@dataclass(frozen=True, eq=False)
class Sightings:
    """Rows in the order of the file.

    names: of the nodes. node: index into them. time, x, y, yaw: in the recording's units; x, y, yaw NaN where lost.
    height: over the table, in the recording's unit of length; tilt: of the node's own upright axis (rad); both NaN in
    planar recordings. push: number of the push under way, -1 while lifted, NO_PUSH where it is not said. force_x,
    force_y, moment: what a force sensor on the tool read then (N, N m, along the recording's axes), NaN where it did
    not; those of the robot's rows count. remarks: what the reader noticed. scene: JSON of the scene that the file
    itself holds, or empty.
    """

    names: tuple[str, ...]
    time: Float[np.ndarray, " rows"]
    node: Int[np.ndarray, " rows"]
    x: Float[np.ndarray, " rows"]
    y: Float[np.ndarray, " rows"]
    yaw: Float[np.ndarray, " rows"]
    height: Float[np.ndarray, " rows"]
    tilt: Float[np.ndarray, " rows"]
    push: Int[np.ndarray, " rows"]
    force_x: Float[np.ndarray, " rows"]
    force_y: Float[np.ndarray, " rows"]
    moment: Float[np.ndarray, " rows"]
    declared: Declared = NOTHING_DECLARED
    remarks: tuple[str, ...] = ()
    scene: str = ""

    def __post_init__(self) -> None:
        if not len(self.time):
            raise TrackError("holds no poses")

    def rows(self, keep: Bool[np.ndarray, " rows"] | Int[np.ndarray, " kept"]) -> "Sightings":
        """Only these rows, or all in this order."""
        return replace(self, **{name: getattr(self, name)[keep] for name in COLUMNS})

    @property
    def wrench(self) -> Float[np.ndarray, "rows 3"]:
        """Readings of the force sensor."""
        return np.stack([getattr(self, name) for name in COMPONENTS], -1)

    @property
    def seen(self) -> Bool[np.ndarray, " rows"]:
        """Whether the node was seen; its yaw alone may be missing."""
        return (np.abs(self.x) < FARTHEST) & (np.abs(self.y) < FARTHEST)


COLUMNS = ("time", "node", "x", "y", "yaw", "height", "tilt", "push", *COMPONENTS)
"""Fields of sightings that hold a value a row."""


class SightingsBuilder:
    """Collects sightings one by one, as readers of rows and messages meet them."""

    def __init__(self) -> None:
        self._index: dict[str, int] = {}
        self._rows: list[tuple[float, ...]] = []

    def add(
        self,
        name: str,
        time: float,
        x: float,
        y: float,
        yaw: float,
        height: float = np.nan,
        tilt: float = np.nan,
        push: int = NO_PUSH,
        wrench: Sequence[float] = NO_READING,
    ) -> None:
        """Add a row."""
        node = self._index.setdefault(name, len(self._index))
        self._rows.append((time, node, x, y, yaw, height, tilt, push, *wrench))

    def finish(self, declared: Declared = NOTHING_DECLARED, remarks: Sequence[str] = ()) -> Sightings:
        """All rows added; raises TrackError if there are none."""
        columns = np.array(self._rows, dtype=float).reshape(-1, len(COLUMNS)).T
        kinds = {"node": np.int64, "push": np.int64}
        named: dict[str, Any] = {
            name: column.astype(kinds.get(name, float)) for name, column in zip(COLUMNS, columns, strict=True)
        }
        return Sightings(tuple(self._index), **named, declared=declared, remarks=tuple(remarks))


class Planar(NamedTuple):
    """A spatial pose as the table sees it; see Sightings."""

    x: float
    y: float
    yaw: float
    height: float
    tilt: float


def planar(position: Sequence[float], quaternion_xyzw: Sequence[float], up: str) -> Planar:
    """Project a spatial pose on the table; `up`: the axis that points away from it, x, y or z, of a right-handed frame.

    The table's x and y are then the recording's y and z, x and -z, or x and y. Without an orientation (NaN, or four
    zeros) the yaw is NaN.
    """
    order, signs = {"x": ((1, 2, 0), (1, 1, 1)), "y": ((0, 2, 1), (1, -1, 1)), "z": ((0, 1, 2), (1, 1, 1))}[up]
    x, y, height = (sign * position[axis] for axis, sign in zip(order, signs, strict=True))
    i, j, k = (sign * quaternion_xyzw[axis] for axis, sign in zip(order, signs, strict=True))
    w = quaternion_xyzw[3]
    norm = i * i + j * j + k * k + w * w
    if not norm > 1e-6:
        return Planar(x, y, np.nan, height, np.nan)
    yaw = np.arctan2(2 * (w * k + i * j), w * w + i * i - j * j - k * k)
    tilt = np.arccos(np.clip((w * w - i * i - j * j + k * k) / norm, -1, 1))
    return Planar(x, y, float(yaw), height, float(tilt))
