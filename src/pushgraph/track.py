"""Tracks: poses over time of a scene's end-effector and bodies, simulated, predicted or measured."""

import csv
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.body import ROBOT
from pushgraph.errors import SceneError, TrackError
from pushgraph.pose import wrap_angle
from pushgraph.scene import Scene
from pushgraph.spread import UNITS, Spread
from pushgraph.storage import replacing, replacing_hdf5
from pushgraph.stored_array import stored
from pushgraph.wrench import COMPONENTS, NO_READING, check_whole, mean_since, reading_from_text

FRAME = 0.05
"""Seconds from one frame to the next."""
ON_TIME = 1e-6
"""Times this near to each other (s) are the same."""
LIFTED = -1
"""Stands for the push while the tool is lifted."""
FORMAT = "pushgraph.track"
VERSION = 1
MOST_PUSHES = 1_000_000
"""Of a track whose scene does not say which pushes were made."""
LONGEST_BRIDGE = 1.0
"""Across more than this (s) no pose is interpolated, however low the rate."""
RESTED, RESTED_YAW = 3e-3, math.radians(1.0)
"""A body that moved less than this (m, rad) while the recorder paused has rested."""
COLUMNS = ("time", "node", "x", "y", "yaw", "push")


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of node 0, the end-effector, and of the scene's bodies in order, in the world frame.

    times: seconds, rising. poses: x (m), y (m), yaw (rad, not wrapped). push: which of the scene's pushes is under way
    (any number from 0 on if it has none), LIFTED between them. seen: False where a camera lost the node; its pose is
    NaN there. The yaw alone may be NaN for bodies whose yaw is not known. wrench: what the bodies exert on the tool, on
    average since the frame before: force (N, world frame) and moment about the end-effector (N m), all NaN where there
    is no reading; None if it was not measured.
    spread: how far off predicted poses of the bodies may be, [frames bodies]; None if nothing is stated.
    Raises TrackError if anything does not fit.
    """

    scene: Scene
    times: Float[np.ndarray, " frames"]
    poses: Float[np.ndarray, "frames nodes 3"]
    push: Int[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames nodes"]
    wrench: Float[np.ndarray, "frames 3"] | None = None
    spread: Spread | None = None

    def __post_init__(self) -> None:
        frames, nodes = len(self.times), 1 + len(self.scene.bodies)
        if frames == 0:
            raise TrackError("a track needs at least one frame")
        for name, shape in (("poses", (frames, nodes, 3)), ("push", (frames,)), ("seen", (frames, nodes))):
            if getattr(self, name).shape != shape:
                raise TrackError(f"{name}: shape must be {shape}, got {getattr(self, name).shape}")
        if self.wrench is not None:
            check_whole(self.wrench, self.times)
        if self.spread is not None:
            for name, values in self.spread._asdict().items():
                if values.shape != (frames, nodes - 1):
                    raise TrackError(f"spread, {name}: shape must be {(frames, nodes - 1)}, got {values.shape}")
        self._check_times()
        self._check_poses()
        most = len(self.scene.pushes) or MOST_PUSHES
        valid = (self.push == LIFTED) | ((self.push >= 0) & (self.push < most))
        if not valid.all():
            frame = int(np.argmin(valid))
            raise TrackError(
                f"push {self.push[frame]} at frame {frame}: valid are {LIFTED} (lifted) and the scene's pushes, "
                f"0 to {most - 1}"
            )

    def _check_times(self) -> None:
        if not np.isfinite(self.times).all():
            raise TrackError(f"time at frame {int(np.argmin(np.isfinite(self.times)))} is not finite")
        steps = np.diff(self.times)
        if (steps <= 0).any():
            frame = int(np.argmax(steps <= 0)) + 1
            raise TrackError(
                f"times must rise: frame {frame} has {self.times[frame]:g} s after {self.times[frame - 1]:g} s"
            )

    def _check_poses(self) -> None:
        finite = np.isfinite(self.poses)
        yaw_optional = np.array([False, *(not body.yaw_known for body in self.scene.bodies)])
        finite[..., 2] |= yaw_optional & np.isnan(self.poses[..., 2])
        bad = self.seen & ~finite.all(-1)
        if bad.any():
            frame, node = np.argwhere(bad)[0]
            raise TrackError(
                f"pose of {self.nodes[node]!r} at {self.times[frame]:g} s is {self.poses[frame, node].tolist()}; "
                "it must be finite, or the node marked as not seen (only a body with yaw_known false may lack yaw)"
            )
        if not self.seen[:, 0].all():
            raise TrackError(f"{ROBOT!r} is missing at {self.times[int(np.argmin(self.seen[:, 0]))]:g} s")

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return (ROBOT, *self.scene.names)

    @property
    def down(self) -> Bool[np.ndarray, " frames"]:
        """Whether the tool is down on the table."""
        return self.push != LIFTED

    @property
    def push_start(self) -> Bool[np.ndarray, " frames"]:
        """Whether a frame is the first of a push."""
        return self.down & (self.push != np.concatenate(([LIFTED], self.push[:-1])))

    @property
    def gaps(self) -> dict[str, list[tuple[float, float]]]:
        """For every node that was lost, the stretches (first and last time, s) in which it was not seen."""
        lost: dict[str, list[tuple[float, float]]] = {}
        for node, name in enumerate(self.nodes):
            missing = np.concatenate(([False], ~self.seen[:, node], [False]))
            edges = np.flatnonzero(missing[1:] != missing[:-1]).reshape(-1, 2)
            if len(edges):
                lost[name] = [(float(self.times[a]), float(self.times[b - 1])) for a, b in edges]
        return lost

    def at_frames(self) -> "Track":
        """The same track in frames of 0.05 s; itself if it is so already.

        Every push begins with a frame at its first sample. A pause, or another push without a lift between, is cut
        out: one lifted frame stands for it, in which bodies that moved meanwhile are not seen. Poses between two
        sightings are interpolated if these are no farther apart than `longest_bridge`; else the node was not seen.
        Yaws turn the shorter way. The wrench is the mean of the readings since the frame before, if there are any.
        """
        joined = self.down[1:] & self.down[:-1] & (self.push[1:] != self.push[:-1])
        grid = self.times[0] + np.arange(len(self.times)) * FRAME
        if not joined.any() and np.abs(self.times - grid).max() < ON_TIME:
            return self
        begins = self.down[1:] & (self.push[1:] != self.push[:-1]) | (np.diff(self.times) > self.longest_bridge)
        bounds = [0, *(np.flatnonzero(begins) + 1).tolist(), len(self.times)]
        stretches = [self._stretch_in_frames(slice(*ends)) for ends in pairwise(bounds)]
        parts = stretches[:1]
        for before, after in pairwise(stretches):
            lifts = before.push[-1] != LIFTED and after.push[0] != LIFTED
            parts += [_lift_between(before, after), after] if lifts else [after]
        columns = _Frames(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        return Track(self.scene, *columns[:-1], wrench=None if self.wrench is None else columns.wrench)

    def frames(self) -> Iterator[tuple[Float[np.ndarray, "nodes 3"], bool]]:
        """Poses of all nodes, NaN where not seen, and whether the tool is down, every 0.05 s; see `at_frames`."""
        track = self.at_frames()
        yield from zip(np.where(track.seen[..., None], track.poses, np.nan), track.down.tolist(), strict=True)

    @property
    def longest_bridge(self) -> float:
        """Seconds between two sightings across which poses are interpolated; a longer gap is a pause."""
        interval = float(np.median(np.diff(self.times))) if len(self.times) > 1 else FRAME
        return min(1.5 * max(interval, 2 * FRAME), LONGEST_BRIDGE)

    def _stretch_in_frames(self, stretch: slice) -> "_Frames":
        at_samples, down = self.times[stretch] - self.times[stretch.start], self.down[stretch]
        times = np.arange(int((at_samples[-1] + ON_TIME) / FRAME) + 1) * FRAME
        if not down[-1] and at_samples[-1] - times[-1] > ON_TIME:  # keep the lift, and where the push ended
            times = np.append(times, at_samples[-1])
        poses = np.full((len(times), *self.poses.shape[1:]), np.nan)
        seen = np.zeros(poses.shape[:2], dtype=bool)
        for node in range(poses.shape[1]):
            sighted = self.seen[stretch, node]
            if not sighted.any():
                continue
            at, values = at_samples[sighted], self.poses[stretch, node][sighted]
            after = np.searchsorted(at, times - ON_TIME).clip(max=len(at) - 1)
            before = (np.searchsorted(at, times + ON_TIME) - 1).clip(min=0)
            seen[:, node] = (
                (at[before] <= times + ON_TIME)
                & (at[after] >= times - ON_TIME)
                & (at[after] - at[before] <= self.longest_bridge)
            )
            values[:, 2] = np.unwrap(values[:, 2])
            poses[:, node] = np.stack([np.interp(times, at, column) for column in values.T], -1)
        poses[~seen] = np.nan
        last = (np.searchsorted(at_samples, times + ON_TIME) - 1).clip(min=0)
        wrench = np.full((len(times), 3), np.nan)
        if self.wrench is not None:
            wrench = mean_since(times, at_samples, self.wrench[stretch], FRAME, ON_TIME)
        return _Frames(self.times[stretch.start] + times, poses, self.push[stretch][last], seen, wrench)

    def save(self, path: str | os.PathLike) -> None:
        """Write HDF5, or CSV if the name ends in .csv; the CSV holds neither scene nor spread."""
        if Path(path).suffix.lower() == ".csv":
            self._save_csv(path)
        else:
            self._save_hdf5(path)

    @classmethod
    def load(cls, path: str | os.PathLike, scene: Scene | None = None) -> "Track":
        """Read HDF5, or CSV if the name ends in .csv; a CSV needs the scene."""
        if Path(path).suffix.lower() == ".csv":
            if scene is None:
                raise TrackError(f"{path}: a CSV track does not hold its scene; pass one")
            return cls._load_csv(path, scene)
        return cls._load_hdf5(path, scene)

    def _save_hdf5(self, path: str | os.PathLike) -> None:
        with replacing_hdf5(path) as file:
            file.attrs.update(format=FORMAT, version=VERSION, scene=self.scene.to_json())
            file["nodes"] = list(self.nodes)
            for name, unit in (("times", "s"), ("poses", "x (m), y (m), yaw (rad)"), ("push", ""), ("seen", "")):
                file.create_dataset(name, data=getattr(self, name)).attrs["unit"] = unit
            if self.wrench is not None:
                file.create_dataset("wrench", data=self.wrench).attrs["unit"] = "force (N), world; moment (N m)"
            if self.spread is not None:
                for name, values in self.spread._asdict().items():
                    file.create_dataset(f"spread/{name}", data=values).attrs["unit"] = UNITS[name]

    @classmethod
    def _load_hdf5(cls, path: str | os.PathLike, scene: Scene | None) -> "Track":
        try:
            with h5py.File(path, "r") as file:
                if str(file.attrs.get("format")) != FORMAT:
                    raise TrackError(f"{path}: not a track: attribute 'format' must be {FORMAT!r}")
                if str(file.attrs.get("version")) != str(VERSION):
                    raise TrackError(
                        f"{path}: track version {file.attrs.get('version')}, this pushgraph reads {VERSION}"
                    )
                scene = scene or Scene.from_json(file.attrs["scene"], f"{path}: scene")
                nodes = [name.decode() for name in stored(file, "nodes").ravel()]
                if nodes != [ROBOT, *scene.names]:
                    raise TrackError(f"{path}: its nodes {nodes} are not those of the scene, {[ROBOT, *scene.names]}")
                arrays = {name: _array(file, name, kind, axes) for name, (kind, axes) in _ARRAYS.items()}
                if "wrench" in file:
                    arrays["wrench"] = _array(file, "wrench", "f", 2)
                spread = None
                if "spread" in file:
                    spread = Spread(*(_array(file, f"spread/{name}", "f", 2) for name in Spread._fields))
            return cls(scene, **arrays, spread=spread)
        except (OSError, KeyError, AttributeError, TypeError, ValueError) as error:
            raise TrackError(f"{path}: cannot read this track, it may be truncated: {error}") from None
        except (TrackError, SceneError) as error:
            raise TrackError(str(error) if str(path) in str(error) else f"{path}: {error}") from None

    def _save_csv(self, path: str | os.PathLike) -> None:
        with replacing(path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS if self.wrench is None else COLUMNS + COMPONENTS)
            for frame, time in enumerate(self.times.tolist()):
                for node, name in enumerate(self.nodes):
                    if self.seen[frame, node]:
                        wrench = [] if self.wrench is None else self.wrench[frame] if node == 0 else NO_READING
                        numbers = [*self.poses[frame, node].tolist(), self.push[frame], *map(float, wrench)]
                        writer.writerow((time, name, *("" if math.isnan(value) else value for value in numbers)))

    @classmethod
    def _load_csv(cls, path: str | os.PathLike, scene: Scene) -> "Track":
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                rows = list(csv.reader(file))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise TrackError(f"{path}: cannot read this track: {error}") from None
        header = tuple(name.strip() for name in rows[0]) if rows else ()
        if header not in (COLUMNS, COLUMNS + COMPONENTS):
            raise TrackError(
                f"{path}: line 1: the header must be {','.join(COLUMNS)}, with or without {','.join(COMPONENTS)}"
            )
        try:
            return cls(scene, **_from_rows(rows[1:], (ROBOT, *scene.names), measured=len(header) > len(COLUMNS)))
        except TrackError as error:
            raise TrackError(f"{path}: {error}") from None


class _Frames(NamedTuple):
    """Some frames of a track; see there."""

    times: Float[np.ndarray, " frames"]
    poses: Float[np.ndarray, "frames nodes 3"]
    push: Int[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames nodes"]
    wrench: Float[np.ndarray, "frames 3"]


def _lift_between(before: _Frames, after: _Frames) -> _Frames:
    """One lifted frame after the first of two stretches, and before the second.

    A body that moved from one to the other is not seen in it, so that its motion is not taken for one without cause.
    """
    poses = after.poses[:1].copy()
    change = np.abs(poses[0] - before.poses[-1])
    change[:, 2] = np.abs(wrap_angle(change[:, 2]))
    change[np.isnan(poses[0])] = 0.0  # a yaw that cannot be known
    rested = (np.hypot(change[:, 0], change[:, 1]) < RESTED) & (change[:, 2] < RESTED_YAW)
    rested[0] = True
    seen = after.seen[:1] & before.seen[-1:] & rested
    poses[~seen] = np.nan
    time = np.minimum((before.times[-1:] + after.times[:1]) / 2, before.times[-1:] + FRAME)
    return _Frames(time, poses, np.full(1, LIFTED, dtype=after.push.dtype), seen, np.full((1, 3), np.nan))


_ARRAYS = {"times": ("f", 1), "poses": ("f", 3), "push": ("i", 1), "seen": ("b", 2)}
"""Kind of number and number of axes of each array in HDF5."""


def _array(file: h5py.File, name: str, kind: str, axes: int) -> np.ndarray:
    array = stored(file, name)
    if array.dtype.kind != kind or array.ndim != axes:
        raise TrackError(f"{name}: must be {axes}-dimensional of kind {kind!r}, got {array.dtype} of {array.shape}")
    return array


def _from_rows(rows: Sequence[Sequence[str]], nodes: Sequence[str], measured: bool) -> dict[str, np.ndarray]:
    """Arrays of a track from the lines of its CSV; a node without a line at some time was not seen then.

    measured: whether lines end with the wrench.
    """
    columns = len(COLUMNS) + measured * len(COMPONENTS)
    times: list[float] = []
    poses: list[np.ndarray] = []
    push: list[int] = []
    wrench: list[tuple[float, ...]] = []
    for line, row in enumerate(rows, start=2):
        if not row:
            continue
        if len(row) != columns:
            raise TrackError(f"line {line}: {columns} columns are needed, got {len(row)}")
        time = _number(row[0], line, "time")
        name = row[1].strip()
        if name not in nodes:
            raise TrackError(f"line {line}: no body {name!r}; valid: {', '.join(nodes)}")
        node = nodes.index(name)
        if times and time < times[-1]:
            raise TrackError(f"line {line}: times must rise: {time:g} s after {times[-1]:g} s")
        if not times or time != times[-1]:
            times.append(time)
            poses.append(np.full((len(nodes), 3), np.nan))
            push.append(LIFTED)
            wrench.append(NO_READING)
        reading = reading_from_text(row[len(COLUMNS) :], f"line {line}") if measured else NO_READING
        if name == ROBOT:
            wrench[-1] = reading
        elif reading is not NO_READING:
            raise TrackError(f"line {line}: {', '.join(COMPONENTS)}: belong to the lines of {ROBOT!r}, not of {name!r}")
        if not row[2].strip() and not row[3].strip():
            continue
        if np.isfinite(poses[-1][node, 0]):
            raise TrackError(f"line {line}: {name!r} stands twice at {time:g} s")
        yaw = _number(row[4], line, "yaw") if row[4].strip() else math.nan
        poses[-1][node] = (_number(row[2], line, "x"), _number(row[3], line, "y"), yaw)
        if name == ROBOT:
            if not re.fullmatch(r"-?\d{1,6}", row[5].strip()):
                raise TrackError(f"line {line}: push: must be a whole number, got {row[5]!r}")
            push[-1] = int(row[5])
    stacked = np.array(poses).reshape(-1, len(nodes), 3)
    arrays = {
        "times": np.array(times, dtype=float),
        "poses": stacked,
        "push": np.array(push, dtype=np.int64),
        "seen": np.isfinite(stacked[..., :2]).all(-1),
    }
    return arrays | ({"wrench": np.array(wrench, dtype=float).reshape(-1, 3)} if measured else {})


def _number(text: str, line: int, column: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TrackError(f"line {line}: {column}: must be a finite number, got {text!r}; leave x, y, yaw empty if lost")
    return value
