"""What a predictor was checked on: the range of every quantity in the scenes of its data, and what lies outside."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pushgraph import pose_3d
from pushgraph.errors import RangeWarning
from pushgraph.lever_scene import LeverScene
from pushgraph.scene import Scene

UNITS = {
    "table friction": "",
    "side friction": "",
    "mass": " kg",
    "mass over the lightest": "",
    "length": " m",
    "width": " m",
    "speed": " m/s",
    "tool size": " m",
    "bodies": "",
    "thickness": " m",
    "friction": "",
    "tool friction": "",
    "turning": " rad/s",
    "gravity": " m/s2",
}
"""The quantities, and their units."""
SIDES = ("length", "width", "thickness")
MOST_REMARKS = 5
ALIKE = 5e-3
"""So small a share beyond a range is inside: it could not be told apart in what is said."""


class Quantity(NamedTuple):
    """One number that a scene says. of: the field, and the body's name if it is one's."""

    name: str
    of: str
    value: float


def quantities(scene: Scene | LeverScene) -> list[Quantity]:
    """All quantities that a scene gives; unknown masses and frictions, and the masses of fixed bodies, are left out."""
    return _in_space(scene) if isinstance(scene, LeverScene) else _on_table(scene)


def _in_space(scene: LeverScene) -> list[Quantity]:
    board = scene.bodies[scene.board]
    of, sides = f"body {board.name!r}", sorted(board.size, reverse=True)
    found = [Quantity("mass", f"mass of {of}", board.mass)]
    found += [Quantity(name, f"size of {of}", side) for name, side in zip(SIDES, sides, strict=True)]
    found += [Quantity("friction", f"friction of body {body.name!r}", body.friction) for body in scene.bodies]
    found += [Quantity("tool friction", "tool.friction", scene.tool.friction)]
    for index, box in enumerate(scene.tool.boxes):
        found += [Quantity("tool size", f"size of tool.boxes[{index}]", side) for side in box.size]
    for index, (before, after) in enumerate(pairwise(scene.path), start=1):
        seconds = after.time - before.time
        way, turn = after.pose[:3] - before.pose[:3], pose_3d.rotation_error(before.pose, after.pose)
        found.append(Quantity("speed", f"speed to path[{index}]", float(np.linalg.norm(way)) / seconds))
        found.append(Quantity("turning", f"turning to path[{index}]", float(turn) / seconds))
    found.append(Quantity("gravity", "gravity", float(np.linalg.norm(scene.gravity))))
    found.append(Quantity("bodies", "number of bodies", float(len(scene.bodies))))
    return found


def _on_table(scene: Scene) -> list[Quantity]:
    found = [
        Quantity(name, field, value)
        for name, field, value in (
            ("table friction", "table.friction", scene.table.friction),
            ("side friction", "side_friction", scene.side_friction),
        )
        if value is not None
    ]
    masses = {
        body.name: body.mass
        for body, still in zip(scene.bodies, scene.immovable, strict=True)
        if body.mass is not None and not still
    }
    for name, mass in masses.items():
        found.append(Quantity("mass", f"mass of body {name!r}", mass))
        found.append(Quantity("mass over the lightest", f"mass of body {name!r}", mass / min(masses.values())))
    for body in scene.bodies:
        length, width = _extents([(part.shape.core, part.pose_body_from_part) for part in body.shape.parts])
        found.append(Quantity("length", f"shape of body {body.name!r}", length))
        found.append(Quantity("width", f"shape of body {body.name!r}", width))
    for index, push in enumerate(scene.pushes):
        if push.times is None:
            found.append(Quantity("speed", f"speed of pushes[{index}]", push.speed))
    found.append(Quantity("tool size", "tool", 2 * scene.tool.reach))
    found.append(Quantity("bodies", "number of bodies", float(len(scene.bodies))))
    return found


def range_of(scenes: Iterable[Scene | LeverScene]) -> dict[str, list[float]]:
    """Lowest and highest value of every quantity."""
    found: dict[str, list[float]] = {}
    for scene in scenes:
        for name, _, value in quantities(scene):
            low, high = found.get(name, (value, value))
            found[name] = [min(low, value), max(high, value)]
    return found


def outside(scene: Scene | LeverScene, ranges: Mapping[str, Sequence[float]]) -> list[str]:
    """Say of every quantity that lies outside of a range which it is, and what the range is."""
    said = []
    for name, of, value in quantities(scene):
        if name not in ranges:
            continue
        low, high = ranges[name]
        if not low * (1 - ALIKE) <= value <= high * (1 + ALIKE):
            unit = UNITS[name]
            as_said = f"{name} of " if of in ("tool",) else ""
            said.append(f"{as_said}{of}: {value:.3g}{unit} is outside of {low:.3g} to {high:.3g}{unit}")
    more = len(said) - MOST_REMARKS
    return said[:MOST_REMARKS] + [f"{more} more"] * (more > 0)


def warn_of_range(scenes: Iterable[Scene | LeverScene], ranges: Mapping[str, Sequence[float]]) -> bool:
    """Warn of the first scene that is unlike those that a predictor was checked on; returns whether there is one."""
    for scene in scenes if ranges else ():
        if said := outside(scene, ranges):
            warnings.warn(f"unlike what this predictor was checked on: {'; '.join(said)}", RangeWarning, 4)
            return True
    return False


def _extents(parts: Sequence[tuple[tuple[float, float, float], Sequence[float]]]) -> tuple[float, float]:
    """Longer and shorter side (m) of the box around some parts, along the axes of their body."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for (half_x, half_y, radius), (x, y, yaw) in parts:
        cos, sin = abs(np.cos(yaw)), abs(np.sin(yaw))
        half = np.array([half_x * cos + half_y * sin, half_x * sin + half_y * cos]) + radius
        low, high = np.minimum(low, (x, y) - half), np.maximum(high, (x, y) + half)
    shorter, longer = sorted(high - low)
    return float(longer), float(shorter)
