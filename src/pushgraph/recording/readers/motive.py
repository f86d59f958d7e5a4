"""CSV exports of OptiTrack's Motive: rigid bodies with positions and quaternions, y up unless said otherwise."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pushgraph.errors import TrackError
from pushgraph.recording.sightings import Declared, ReadOptions, Sightings, SightingsBuilder, planar
from pushgraph.written_number import number

UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}


class _Header(NamedTuple):
    """Rows of names over the columns, and the fields of the first line."""

    fields: dict[str, str]
    kinds: Sequence[str]
    names: Sequence[str]
    quantities: Sequence[str]
    axes: Sequence[str]


def is_motive(start: bytes) -> bool:
    """Whether a file that starts so is such an export."""
    return start.removeprefix(b"\xef\xbb\xbf").lstrip(b'"').startswith(b"Format Version")


def read_motive(path: Path, options: ReadOptions) -> Sightings:
    """Read an export of rigid bodies; raises TrackError if it holds none, or rotations that are no quaternions."""
    try:
        with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
            rows = csv.reader(file)
            header = _read_header(rows)
            return _read_rows(rows, header, options)
    except csv.Error as error:
        raise TrackError(f"no CSV: {error}") from None


def _read_header(rows: Iterator[list[str]]) -> _Header:
    first: list[str] = next(rows, [])
    fields = dict(zip(first[::2], first[1::2], strict=False))
    above: list[list[str]] = []
    for row in rows:
        if row and row[0].strip() == "Frame":
            named = {row[1].strip(): row for row in above if len(row) > 1}
            if "Type" not in named or "Name" not in named or not above:
                break
            return _Header(fields, named["Type"], named["Name"], above[-1], row)
        above = [*above, row][-12:]
    raise TrackError("no rows 'Type', 'Name' and 'Frame' over the columns, as exports of Motive have them")


def _read_rows(rows: Any, header: _Header, options: ReadOptions) -> Sightings:
    places: dict[str, dict[str, int]] = {}
    columns = zip(header.kinds, header.names, header.quantities, header.axes, strict=False)
    for index, (kind, name, quantity, axis) in enumerate(columns):
        if kind.strip() == "Rigid Body" and quantity in ("Rotation", "Position"):
            places.setdefault(name.strip(), {})[("q" if quantity == "Rotation" else "") + axis.strip().lower()] = index
    whole = {"x", "y", "z", "qx", "qy", "qz", "qw"}
    for name, found in places.items():
        if not whole <= set(found):
            raise TrackError(f"rigid body {name!r}: export positions, and rotations as quaternions")
    if not places:
        raise TrackError("no column of type 'Rigid Body': export rigid bodies, not markers alone")
    builder = SightingsBuilder()
    time_column = next((k for k, axis in enumerate(header.axes) if axis.strip().startswith("Time")), 1)
    up = options.up or "y"
    for row in rows:
        if len(row) <= time_column or not row[time_column].strip():
            continue
        where = f"line {rows.line_num}"
        time = _number(row, time_column, where)
        if not np.isfinite(time):
            raise TrackError(f"{where}: time: must be a finite number")
        for name, found in places.items():
            value = {axis: _number(row, index, where) for axis, index in found.items()}
            pose = planar([value[axis] for axis in "xyz"], [value[f"q{axis}"] for axis in "xyzw"], up)
            builder.add(name, time, *pose)
    units = header.fields.get("Length Units", "Meters").strip().lower()
    if units not in UNITS:
        raise TrackError(f"Length Units {units!r}; valid: {', '.join(UNITS)}")
    declared = Declared(length=UNITS[units], angle="rad", time="s")
    return builder.finish(declared, [f"{up} is taken as up; --up says otherwise"])


def _number(row: Sequence[str], index: int, where: str) -> float:
    text = row[index].strip() if index < len(row) else ""
    try:
        return number(text or "nan")
    except ValueError:
        raise TrackError(f"{where}: column {index + 1}: must be a number, got {text[:40]!r}") from None
