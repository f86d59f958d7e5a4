"""CSV: a line for each node at each time, or for each time; comma, semicolon or tab; units in the header."""

import contextlib
import csv
import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import chain
from pathlib import Path

import numpy as np

from pushgraph.errors import TrackError
from pushgraph.recording.convention import SYNONYMS, declared_units
from pushgraph.recording.readers.wide_table import (
    COORDINATES,
    columns_of_wrench,
    coordinates_of_nodes,
    pose_in_plane,
    sightings_of_table,
)
from pushgraph.recording.sightings import NO_PUSH, Declared, ReadOptions, Sightings, SightingsBuilder
from pushgraph.wrench import COMPONENTS, NO_READING, UNITS
from pushgraph.written_number import number

COLUMNS = {
    **COORDINATES,
    **dict.fromkeys(("time", "t", "timestamp", "stamp"), "time"),
    **dict.fromkeys(("node", "name", "body", "object", "tag", "id", "marker", "frame_id", "child_frame_id"), "node"),
    **dict.fromkeys(("push", "push_id", "stroke"), "push"),
    "down": "down",
    **{name: name for name in COMPONENTS},
}
LOST = ("", "nan", "na", "n/a", "none", "null", "-", "inf", "-inf", "+inf", "lost")
"""What stands for a number that is not known."""


def read_csv(path: Path, options: ReadOptions) -> Sightings:
    """Read a CSV; raises TrackError by line for what is no number where one is due."""
    with path.open("rb") as file:
        start = file.read(4)
    encodings = ["utf-16"] if start[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252", "latin-1"]
    for encoding in encodings:
        try:
            with path.open(newline="", encoding=encoding) as file:
                return _Table(file, options).read()
        except UnicodeError:
            continue
        except csv.Error as error:
            raise TrackError(f"no CSV: {error}") from None
    raise TrackError(f"no text in {' or '.join(encodings)}")


class _Table:
    """One CSV while it is read."""

    def __init__(self, lines: Iterator[str], options: ReadOptions) -> None:
        self._options, self._declared = options, Declared()
        header, self._skipped = "", 0
        for self._skipped, header in enumerate(lines, start=1):
            comment = header.strip().strip('"').strip(",;")
            if comment.startswith("#"):
                self._declare(comment.lstrip("# "), f"line {self._skipped}")
            elif comment:
                break
        self._delimiter = max(",;\t", key=header.count)
        self._rows = csv.reader(chain([header], lines), delimiter=self._delimiter)
        self._columns = [self._column(name) for name in next(self._rows, [])]
        named = [name.lower() for name in self._columns if name]
        if twice := [name for name in named if named.count(name) > 1]:
            raise TrackError(f"line {self._skipped}: two columns are called {twice[0]!r}")
        self._wrench = columns_of_wrench(self._columns)

    def read(self) -> Sightings:
        places = {COLUMNS[name.lower()]: k for k, name in enumerate(self._columns) if name.lower() in COLUMNS}
        if "time" not in places:
            raise TrackError(f"line {self._skipped}: no column 'time' in the header: {', '.join(self._columns)[:200]}")
        if {"node", "x", "y"} <= set(places):
            return self._read_long(places)
        nodes = coordinates_of_nodes(self._columns)
        if not nodes:
            raise TrackError(
                f"line {self._skipped}: the header needs time, node, x, y and yaw, or time and columns such as cup_x, "
                f"cup_y, cup_yaw; got {', '.join(self._columns)[:200]}"
            )
        return self._read_wide(places, nodes)

    def _read_long(self, places: dict[str, int]) -> Sightings:
        builder = SightingsBuilder()
        numbers = [name for name in places if name not in ("time", "node", "push", "down", *COMPONENTS)]
        for line, row in self._lines():
            name = row[places["node"]].strip()
            if not name:
                raise TrackError(f"line {line}: node: is empty")
            value = {coordinate: self._number(row[places[coordinate]], line, coordinate) for coordinate in numbers}
            time = self._time(row, places, line)
            wrench = [self._number(row[k], line, self._columns[k]) for k in self._wrench] or NO_READING
            builder.add(name, time, *pose_in_plane(value, self._options), self._push(row, places, line), wrench)
        return builder.finish(self._declared)

    def _read_wide(self, places: dict[str, int], nodes: dict[str, dict[str, int]]) -> Sightings:
        times, values, push = [], [], []
        needed = sorted({index for found in nodes.values() for index in found.values()} | {*self._wrench})
        for line, row in self._lines():
            times.append(self._time(row, places, line))
            values.append([self._number(row[index], line, self._columns[index]) for index in needed])
            push.append(self._push(row, places, line))
        table = {node: {name: needed.index(k) for name, k in found.items()} for node, found in nodes.items()}
        wrench = [needed.index(k) for k in self._wrench]
        whole = np.array(values, dtype=float).reshape(-1, len(needed))
        return sightings_of_table(table, wrench, np.array(times), whole, push, self._declared, self._options)

    def _lines(self) -> Iterator[tuple[int, Sequence[str]]]:
        for row in self._rows:
            line = self._skipped - 1 + self._rows.line_num
            if not any(cell.strip() for cell in row) or row[0].lstrip().startswith("#"):
                continue
            if len(row) < len(self._columns) or any(cell.strip() for cell in row[len(self._columns) :]):
                raise TrackError(f"line {line}: {len(self._columns)} columns are needed, got {len(row)}")
            yield line, row

    def _column(self, name: str) -> str:
        """Name of a column without its unit, which is declared."""
        match = re.fullmatch(r"\s*(.*?)\s*(?:[(\[](.*)[)\]])?\s*", name)
        bare, unit = (match[1], match[2]) if match else (name, None)
        stem, _, ending = bare.rpartition("_")
        if unit is None and stem and SYNONYMS.get(ending, ending) in ("cm", "mm", "deg", "rad", "ms", "us", "ns"):
            bare, unit = stem, ending
        if bare.lower() in COMPONENTS:
            self._check_unit_of_wrench(bare.lower(), unit)
        elif unit:
            self._declare(f"units: {unit}", f"line {self._skipped}: column {name.strip()!r}")
        return bare

    def _check_unit_of_wrench(self, name: str, unit: str | None) -> None:
        if unit is not None and re.sub(r"[ *·]", "", unit) != UNITS[name].replace(" ", ""):
            raise TrackError(f"line {self._skipped}: {name} is in {unit!r}; valid: {UNITS[name]}")

    def _declare(self, text: str, where: str) -> None:
        """Take `units: mm deg`, `axes: x,-y`, `frame: 0.1 0 90`; other comments say nothing to us."""
        key, _, value = text.partition(":")
        key, value = key.strip().lower(), value.strip()
        if key in ("unit", "units"):
            said = declared_units(value, where)
        elif key in ("axes", "frame"):
            said = Declared(**{key: value})
        else:
            return
        for field, before, now in zip(Declared._fields, self._declared, said, strict=True):
            if before and now and before != now:
                raise TrackError(f"{where}: {field} is declared twice, as {before} and {now}")
        self._declared = self._declared.overruled_by(said)

    def _time(self, row: Sequence[str], places: dict[str, int], line: int) -> float:
        text = row[places["time"]].strip()
        if re.match(r"\d{4}-\d\d-\d\d[T ]", text):
            with contextlib.suppress(ValueError):
                return datetime.fromisoformat(text).timestamp()
        time = self._number(text, line, "time")
        if not np.isfinite(time):
            raise TrackError(f"line {line}: time: must be a finite number, got {text[:40]!r}")
        return time

    def _number(self, text: str, line: int, column: str) -> float:
        text = text.strip()
        if text.lower() in LOST:
            return np.nan
        try:
            value = number(text.replace(",", ".") if self._delimiter != "," else text)
        except ValueError:
            raise TrackError(
                f"line {line}: {column}: must be a number, got {text[:40]!r}; leave x, y, yaw empty if lost"
            ) from None
        return value if np.isfinite(value) else np.nan

    def _push(self, row: Sequence[str], places: dict[str, int], line: int) -> int:
        """Number of the push; a column `down` says 1 or 0, true or false."""
        if "push" in places:
            text = row[places["push"]].strip()
            if text.lower() in LOST:
                return NO_PUSH
            if not re.fullmatch(r"-?[0-9]{1,6}(\.0*)?", text):
                raise TrackError(f"line {line}: push: must be a whole number, got {text[:40]!r}")
            return max(int(float(text)), -1)
        if "down" in places:
            text = row[places["down"]].strip().lower()
            if text not in ("0", "1", "0.0", "1.0", "true", "false"):
                raise TrackError(f"line {line}: down: must be 0 or 1, got {text[:40]!r}")
            return 0 if text in ("1", "1.0", "true") else -1
        return NO_PUSH
