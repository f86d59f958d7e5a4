"""Tables with a line for each time and columns for each node, such as `cup_x, cup_y, cup_yaw`, taken apart."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from pushgraph.errors import TrackError
from pushgraph.recording.sightings import NO_PUSH, Declared, ReadOptions, Sightings, SightingsBuilder, planar

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
        if match := _ENDING.fullmatch(name.strip()):
            nodes.setdefault(match["node"], {})[COORDINATES[match["coordinate"]]] = index
    return {node: found for node, found in nodes.items() if {"x", "y"} <= set(found)}


def sightings_of_table(
    nodes: Mapping[str, Mapping[str, int]],
    times: Float[np.ndarray, " lines"],
    values: Float[np.ndarray, "lines columns"],
    push: Sequence[int] | None,
    declared: Declared,
    options: ReadOptions,
) -> Sightings:
    """Sightings of a table whose columns `nodes` names; raises TrackError if it names none."""
    if not nodes:
        raise TrackError("no columns such as cup_x, cup_y, cup_yaw: nothing says where a node is")
    builder = SightingsBuilder()
    for line, time in enumerate(times.tolist()):
        for node, column in nodes.items():
            value = {name: float(values[line, index]) for name, index in column.items()}
            builder.add(node, time, *pose_in_plane(value, options), NO_PUSH if push is None else push[line])
    return builder.finish(declared)


def pose_in_plane(value: Mapping[str, float], options: ReadOptions) -> tuple[float, float, float, float, float]:
    """x, y, yaw, height and tilt from a node's named coordinates; what is missing is NaN."""
    if "qw" in value:
        position = [value.get(axis, 0.0) for axis in "xyz"]
        return planar(position, [value.get(axis, np.nan) for axis in ("qx", "qy", "qz", "qw")], options.up or "z")
    return value["x"], value["y"], value.get("yaw", np.nan), value.get("z", np.nan), np.nan
