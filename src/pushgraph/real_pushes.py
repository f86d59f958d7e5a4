"""Recorded straight pushes of single objects by a round probe: poses before and after, and the outlines of the objects.

The table is a CSV file, packed with gzip or not, one push a row, in the columns COLUMNS; further columns
`NAME_x1, NAME_y1, NAME_yaw1` are final poses as another model states them. The outlines are JSON,
`{shape: {"polygon": [[x, y], ...]} or {"ellipse": [full x axis, full y axis]}}`, in the object's frame. SI units, but
for the speed.
"""

import csv
import gzip
import hashlib
import io
import math
import os
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from pushgraph import pose
from pushgraph.errors import RealPushError, SceneError
from pushgraph.json_file import parse, read_text
from pushgraph.shape import BodyShape, Cuboid, Cylinder, Polygon
from pushgraph.storage import read_plain
from pushgraph.written_number import number

BEFORE, AFTER = ("x0", "y0", "yaw0"), ("x1", "y1", "yaw1")
PROBE_START, PROBE_END = ("tip_x0", "tip_y0"), ("tip_x1", "tip_y1")
SPEED = "speed_mm_s"
LABELS = ("surface", "shape")
NUMBERS = (SPEED, *BEFORE, *AFTER, *PROBE_START, *PROBE_END)
COLUMNS = (*LABELS, *NUMBERS)
MOST_BYTES = 64 * 2**20
"""Largest table that is read, unpacked."""
PROBE_RADIUS = 0.00475
"""Of the probe (m), unless told otherwise."""
DEEPEST = 0.008
"""A probe that starts deeper inside the outline (m) is refused; less comes from measuring both."""
SIDES = 64
"""An ellipse stands as a polygon of so many sides."""


@dataclass(frozen=True, eq=False)
class RealPushes:
    """Recorded pushes.

    shapes: by name. surface, shape: names of each push's. speed: of the probe (m/s). before, after:
    pose_world_from_body. probe_start, probe_end: its centre, in the world (m). stated: final poses as other models
    state them, by model. probe_radius: (m).
    """

    shapes: Mapping[str, BodyShape]
    surface: np.ndarray
    shape: np.ndarray
    speed: Float[np.ndarray, " pushes"]
    before: Float[np.ndarray, "pushes 3"]
    after: Float[np.ndarray, "pushes 3"]
    probe_start: Float[np.ndarray, "pushes 2"]
    probe_end: Float[np.ndarray, "pushes 2"]
    stated: Mapping[str, Float[np.ndarray, "pushes 3"]]
    probe_radius: float = PROBE_RADIUS

    def __len__(self) -> int:
        return len(self.speed)

    def take(self, index: Int[np.ndarray, " some"] | Bool[np.ndarray, " pushes"]) -> "RealPushes":
        """Some of the pushes, in the order of `index`."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        chosen = {name: values[index] for name, values in columns.items() if isinstance(values, np.ndarray)}
        return replace(self, **chosen, stated={name: poses[index] for name, poses in self.stated.items()})

    @property
    def materials(self) -> list[tuple[str, str]]:
        """The pairs of surface and shape there are, in order of their first push."""
        return list(dict.fromkeys(zip(self.surface.tolist(), self.shape.tolist(), strict=True)))

    def material(self, index: int) -> tuple[str, str]:
        """Surface and shape of one push."""
        return str(self.surface[index]), str(self.shape[index])

    @property
    def fingerprint(self) -> str:
        """Tells other pushes from these."""
        names = np.array([f"{surface}\0{shape}\0" for surface, shape in map(self.material, range(len(self)))])
        numbers = np.column_stack((self.speed, self.before, self.after, self.probe_start, self.probe_end))
        return hashlib.sha256(names.tobytes() + numbers.tobytes()).hexdigest()

    def of(self, surface: str | None = None, shape: str | None = None) -> Bool[np.ndarray, " pushes"]:
        """Which pushes are on a surface and of a shape; None: of all."""
        chosen = np.ones(len(self), dtype=bool)
        for values, name in ((self.surface, surface), (self.shape, shape)):
            chosen &= True if name is None else values == name
        return chosen

    @property
    def motion(self) -> Float[np.ndarray, "pushes 3"]:
        """pose_before_from_after: how each object moved, in its own frame before; yaw within half a turn."""
        return self.in_body(self.after)

    def in_body(self, poses_world: Float[np.ndarray, "pushes 3"]) -> Float[np.ndarray, "pushes 3"]:
        """Final poses in the frame of each object before its push."""
        found = pose.relative(self.before, poses_world)
        found[:, 2] = pose.wrap_angle(found[:, 2])
        return found

    @property
    def start_in_body(self) -> Float[np.ndarray, "pushes 2"]:
        """Where the probe starts, in the frame of the object (m)."""
        return pose.transform(pose.inverse(self.before), self.probe_start)

    @property
    def end_in_body(self) -> Float[np.ndarray, "pushes 2"]:
        """Where the probe ends, in the frame of the object before the push (m)."""
        return pose.transform(pose.inverse(self.before), self.probe_end)


def read_pushes(data: str | os.PathLike, outlines: str | os.PathLike) -> RealPushes:
    """Read recorded pushes and the outlines of their objects.

    Raises RealPushError, naming the file, row and column, if there is anything that cannot be.
    """
    shapes = read_outlines(outlines)
    names, rows = _table(Path(data))
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise RealPushError(f"{data}: row 1: no column {', '.join(missing)}; needed: {', '.join(COLUMNS)}")
    if not rows:
        raise RealPushError(f"{data}: holds no push below its header; each row is one")
    endings = tuple(f"_{column}" for column in AFTER)
    stated = [name for name in names if name.endswith(endings) and name not in COLUMNS]
    models = list(dict.fromkeys(name.rsplit("_", 1)[0] for name in stated))
    missing = [f"{model}{ending}" for model in models for ending in endings if f"{model}{ending}" not in names]
    if missing:
        raise RealPushError(f"{data}: row 1: no column {', '.join(missing)}, which goes with others of that model")
    columns = {name: _numbers(data, rows, name) for name in (*NUMBERS, *(f"{m}_{c}" for m in models for c in AFTER))}

    def stacked(*names: str) -> np.ndarray:
        return np.stack([columns[name] for name in names], -1)

    for line, row in enumerate(rows, start=2):
        if row["shape"] not in shapes:
            raise RealPushError(
                f"{data}: row {line}, column shape: no outline of {row['shape']!r} in {outlines}; "
                f"it has: {', '.join(shapes)}"
            )
    pushes = RealPushes(
        shapes=shapes,
        surface=np.array([row["surface"] for row in rows]),
        shape=np.array([row["shape"] for row in rows]),
        speed=columns[SPEED] / 1e3,
        before=stacked(*BEFORE),
        after=stacked(*AFTER),
        probe_start=stacked(*PROBE_START),
        probe_end=stacked(*PROBE_END),
        stated={model: stacked(*(f"{model}_{column}" for column in AFTER)) for model in models},
    )
    _check(data, pushes)
    return pushes


def read_outlines(path: str | os.PathLike) -> dict[str, BodyShape]:
    """Shapes by name; raises RealPushError, naming the shape, if one is none."""
    described = parse(read_text(path, "file of outlines", RealPushError), str(path), RealPushError)
    if not isinstance(described, dict) or not described:
        raise RealPushError(f"{path}: outlines must be an object of {{shape: outline}}")
    shapes = {}
    for name, outline in described.items():
        try:
            shapes[name] = _shape_of(outline)
        except (SceneError, TypeError, ValueError) as error:
            raise RealPushError(f"{path}: shape {name!r}: {error}") from None
    return shapes


def outline_of(shape: BodyShape) -> Float[np.ndarray, "points 2"]:
    """The outline of a shape, counter-clockwise (m); circles as polygons of SIDES."""
    if isinstance(shape, Cuboid):
        return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * np.array(shape.size) / 2
    if isinstance(shape, Cylinder):
        return _ellipse(shape.diameter, shape.diameter)
    return shapely.get_coordinates(shapely.Polygon(shape.points).normalize().reverse())[:-1]


def _shape_of(outline: Any) -> BodyShape:
    kinds = set(outline) if isinstance(outline, dict) else set()
    if kinds == {"ellipse"}:
        x, y = _plain(outline["ellipse"])
        if not (0 < x < math.inf and 0 < y < math.inf):
            raise ValueError(f"ellipse: both axes must be positive lengths, got {[x, y]}")
        return Cylinder(diameter=x) if x == y else Polygon(points=_tuples(_ellipse(x, y)))
    if kinds != {"polygon"}:
        raise ValueError('must be {"polygon": [[x, y], ...]} or {"ellipse": [full x axis, full y axis]}')
    if not isinstance(outline["polygon"], list) or not outline["polygon"]:
        raise ValueError("polygon: must be a list of points [x, y]")
    points = np.array([_plain(point) for point in outline["polygon"]])
    size = np.ptp(points, axis=0)
    if len(points) == 4 and np.allclose(np.abs(points), size / 2, atol=1e-9) and len(np.unique(points, axis=0)) == 4:
        polygon = Polygon(points=_tuples(points))  # refuses what crosses itself
        return Cuboid(size=(float(size[0]), float(size[1])), height=polygon.height)
    return Polygon(points=_tuples(points))


def _plain(pair: Any) -> tuple[float, float]:
    """Two numbers."""
    if not isinstance(pair, list) or [type(value) in (int, float) for value in pair] != [True, True]:
        raise ValueError(f"must be two numbers [x, y], got {str(pair)[:60]}")
    x, y = (float(value) if abs(value) <= sys.float_info.max else math.inf for value in pair)
    return x, y


def _ellipse(x: float, y: float) -> Float[np.ndarray, "points 2"]:
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    return np.stack((x / 2 * np.cos(angle), y / 2 * np.sin(angle)), -1)


def _tuples(points: Float[np.ndarray, "points 2"]) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in points.tolist())


def _table(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    """Names of the columns, and rows."""
    try:
        content = read_plain(path, MOST_BYTES)
        if content[:2] == b"\x1f\x8b":
            content = gzip.GzipFile(fileobj=io.BytesIO(content)).read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise RealPushError(f"{path}: cannot read these pushes: unpacked, more than {MOST_BYTES >> 20} MiB")
        reader = csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True)
        names = next(reader, [])
        rows = []
        for row in reader:
            if row and len(row) != len(names):
                raise RealPushError(f"{path}: line {reader.line_num}: {len(names)} columns are needed, got {len(row)}")
            rows += [dict(zip(names, row, strict=True))] if row else []
    except (OSError, EOFError, zlib.error, UnicodeDecodeError, csv.Error) as error:
        raise RealPushError(f"{path}: cannot read these pushes: {error}") from None
    if twice := [name for name in names if names.count(name) > 1]:
        raise RealPushError(f"{path}: row 1: two columns are called {twice[0]!r}")
    return names, rows


def _numbers(path: str | os.PathLike, rows: Sequence[Mapping[str, str]], name: str) -> Float[np.ndarray, " rows"]:
    values = np.empty(len(rows))
    for k, row in enumerate(rows):
        try:
            values[k] = number(row[name])
        except (TypeError, ValueError):
            raise RealPushError(f"{path}: row {k + 2}, column {name}: {row[name]!r} is no number") from None
        if not math.isfinite(values[k]):
            raise RealPushError(f"{path}: row {k + 2}, column {name}: {row[name]} is not finite; poses must be")
    return values


def _check(path: str | os.PathLike, pushes: RealPushes) -> None:
    slow = np.flatnonzero(pushes.speed <= 0)
    if len(slow):
        raise RealPushError(f"{path}: row {slow[0] + 2}, column {SPEED}: must be positive, got {pushes.speed[slow[0]]}")
    moved = np.hypot(*(pushes.probe_end - pushes.probe_start).T)
    still = np.flatnonzero(moved == 0)
    if len(still):
        raise RealPushError(
            f"{path}: row {still[0] + 2}, columns {', '.join(PROBE_START + PROBE_END)}: the probe does not move"
        )
    start = pushes.start_in_body
    for name in dict.fromkeys(pushes.shape.tolist()):
        chosen = np.flatnonzero(pushes.of(shape=name))
        deep = pushes.probe_radius + depths(pushes.shapes[name], start[chosen])
        if deep.max() > DEEPEST:
            worst = int(deep.argmax())
            raise RealPushError(
                f"{path}: row {chosen[worst] + 2}, columns {', '.join(PROBE_START)}: the probe, of radius "
                f"{1e3 * pushes.probe_radius:g} mm, starts {1e3 * deep[worst]:.1f} mm inside {name!r}; at most "
                f"{1e3 * DEEPEST:g} mm is taken for an error of measuring"
            )


def depths(shape: BodyShape, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, " points"]:
    """How deep points of the body's frame lie inside its outline (m); negative outside."""
    polygon = shapely.Polygon(outline_of(shape))
    places = shapely.points(points)
    with np.errstate(over="ignore"):  # what is too far away to be squared is infinitely far
        distance = shapely.distance(polygon.exterior, places)
    return np.where(shapely.contains(polygon, places), 1.0, -1.0) * distance
