"""Tracks in CSV: a line for each node at each time at which it was seen."""

import csv
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pushgraph.body import ROBOT
from pushgraph.errors import TrackError
from pushgraph.storage import replacing, size_of
from pushgraph.track_frames import LIFTED, Frames
from pushgraph.wrench import COMPONENTS, NO_READING, reading_from_text
from pushgraph.written_number import number

COLUMNS = ("time", "node", "x", "y", "yaw", "push")


def save_csv(path: Path, nodes: Sequence[str], frames: Frames) -> None:
    """Write the frames of these nodes; node 0 is the robot."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS if frames.wrench is None else COLUMNS + COMPONENTS)
        for frame, time in enumerate(frames.times.tolist()):
            for node, name in enumerate(nodes):
                if frames.seen[frame, node]:
                    wrench = [] if frames.wrench is None else frames.wrench[frame] if node == 0 else NO_READING
                    numbers = [*frames.poses[frame, node].tolist(), frames.push[frame], *map(float, wrench)]
                    writer.writerow((time, name, *("" if math.isnan(value) else value for value in numbers)))


def load_csv(path: Path, nodes: Sequence[str]) -> Frames:
    """Read the frames of these nodes; a node without a line at some time was not seen then."""
    try:
        size_of(path)
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file, strict=True)
            header = tuple(name.strip() for name in next(rows, []))
            if header not in (COLUMNS, COLUMNS + COMPONENTS):
                with_wrench = f"with or without {','.join(COMPONENTS)}"
                raise TrackError(f"line 1: the header must be {','.join(COLUMNS)}, {with_wrench}")
            return _from_rows(rows, nodes, measured=len(header) > len(COLUMNS))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TrackError(f"cannot read this track: {error}") from None


def _from_rows(rows: Iterable[Sequence[str]], nodes: Sequence[str], measured: bool) -> Frames:
    """Frames from all lines but the header. measured: whether they end with the wrench."""
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
            if not re.fullmatch(r"-?[0-9]{1,6}", row[5].strip()):
                raise TrackError(f"line {line}: push: must be a whole number, got {row[5]!r}")
            push[-1] = int(row[5])
    stacked = np.array(poses).reshape(-1, len(nodes), 3)
    return Frames(
        np.array(times, dtype=float),
        stacked,
        np.array(push, dtype=np.int64),
        np.isfinite(stacked[..., :2]).all(-1),
        np.array(wrench, dtype=float).reshape(-1, 3) if measured else None,
    )


def _number(text: str, line: int, column: str) -> float:
    try:
        value = number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TrackError(f"line {line}: {column}: must be a finite number, got {text!r}; leave x, y, yaw empty if lost")
    return value
