"""Tables with a line for each time and columns for each node, such as `cup_x, cup_y, cup_yaw`, taken apart."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.errors import TrackError
from pushgraph.recording.sightings import NO_PUSH, Declared, ReadOptions, Sightings, SightingsBuilder, planar
from pushgraph.wrench import COMPONENTS, NO_READING

COORDINATES = {
    **{axis: axis for axis in ("x", "y", "z", "yaw", "qx", "qy", "qz", "qw")},
    **{f"{word}_{axis}": axis for word in ("pos", "position", "translation") for axis in "xyz"},
    **dict.fromkeys(("theta", "heading", "angle", "psi", "rz", "rotation"), "yaw"),
    **{f"{word}_{axis}": f"q{axis}" for word in ("orientation", "quaternion", "quat") for axis in "xyzw"},
}
"""What columns are called, by the coordinate that they hold."""
_ENDING = re.compile(rf"(?P<node>.+?)[ _./:-]+(?P<coordinate>{'|'.join(sorted(COORDINATES, key=len, reverse=True))})")


def coordinates_of_nodes(columns: Sequence[str]) -> dict[str, dict[str, int]]:
    """Of every node that the names of the columns mention: the column of each of its coordinates."""
    nodes: dict[str, dict[str, int]] = {}
    for index, name in enumerate(columns):
        if name.strip().lower() in COMPONENTS:
            continue
        if match := _ENDING.fullmatch(name.strip()):
            nodes.setdefault(match["node"], {})[COORDINATES[match["coordinate"]]] = index
    return {node: found for node, found in nodes.items() if {"x", "y"} <= set(found)}


def columns_of_wrench(columns: Sequence[str]) -> list[int]:
    """Columns of force_x, force_y and moment, none if there are none; raises TrackError if some are missing."""
    names = [name.strip().lower() for name in columns]
    found = [name for name in COMPONENTS if name in names]
    if found and len(found) < len(COMPONENTS):
        raise TrackError(f"columns {', '.join(found)} alone are no reading; needed: {', '.join(COMPONENTS)}")
    return [names.index(name) for name in found]


def sightings_of_table(
    nodes: Mapping[str, Mapping[str, int]],
    wrench: Sequence[int],
    times: Float[np.ndarray, " lines"],
    values: Float[np.ndarray, "lines columns"],
    push: Sequence[int] | None,
    declared: Declared,
    options: ReadOptions,
) -> Sightings:
    """Sightings of a table whose columns `nodes` and `wrench` name; raises TrackError if no node is named."""
    if not nodes:
        raise TrackError("no columns such as cup_x, cup_y, cup_yaw: nothing says where a node is")
    builder = SightingsBuilder()
    for line, time in enumerate(times.tolist()):
        for node, column in nodes.items():
            value = {name: float(values[line, index]) for name, index in column.items()}
            pushing = NO_PUSH if push is None else push[line]
            reading = values[line, wrench].tolist() if wrench else NO_READING
            builder.add(node, time, *pose_in_plane(value, options), pushing, reading)
    return builder.finish(declared)


def pose_in_plane(value: Mapping[str, float], options: ReadOptions) -> tuple[float, float, float, float, float]:
    """x, y, yaw, height and tilt from a node's named coordinates; what is missing is NaN."""
    if "qw" in value:
        position = [value.get(axis, 0.0) for axis in "xyz"]
        return planar(position, [value.get(axis, np.nan) for axis in ("qx", "qy", "qz", "qw")], options.up or "z")
    return value["x"], value["y"], value.get("yaw", np.nan), value.get("z", np.nan), np.nan
