"""Units, axes and names that look otherwise than declared: how bodies first stood, beside how the scene has them.

The scene's poses may be nominal, and where its origin lies is free: only the shape of the layout is compared. What it
suggests is said, never applied.
"""

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pushgraph.pose import wrap_angle
from pushgraph.recording.assembly import Frames
from pushgraph.recording.convention import ANGLES, LENGTHS
from pushgraph.recording.findings import Finding
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder

LAYOUT_OFF = 0.03
"""Layouts farther apart than this (m, root mean square) are not the same."""
CLEARLY_BETTER = 0.35
"""Another reading must explain the layout so many times better to be suggested."""
YAW_OFF = 0.15
"""Yaws that differ by more than this (rad) are not the same."""
TURNED, TURNING = 0.5, 2.0
"""A body may turn in a push by this (rad), and by so many times the tool's path over its inradius."""
SPEED_LIMIT = 3.0
"""No tool pushes faster than this (m/s)."""
NAMES = {"in": "inches", "cm": "centimetres", "mm": "millimetres", "m": "metres"}


class Fit(NamedTuple):
    """A similarity that carries one set of points to another: rotation (rad), after a mirror across x if mirrored.

    off: root mean square of what remains (in the units of the first set).
    """

    rotation: float
    scale: float
    off: float


def fit(start: Float[np.ndarray, "points 2"], end: Float[np.ndarray, "points 2"], mirrored: bool, scale: float) -> Fit:
    """The best similarity of a given scale, in closed form."""
    a, b = (complex_of(points - points.mean(0)) for points in (start, end / scale))
    a = a.conj() if mirrored else a
    product = complex(np.vdot(a, b))
    rotation = float(np.angle(product))
    off = np.sqrt(np.mean(np.abs(b - a * np.exp(1j * rotation)) ** 2))
    return Fit(rotation, scale, float(off))


def complex_of(points: Float[np.ndarray, "*batch 2"]) -> np.ndarray:
    """Points as complex numbers x + iy."""
    return points[..., 0] + 1j * points[..., 1]


def suspicions(scene: Scene, frames: Frames) -> list[Finding]:
    """What in units, axes and names contradicts the scene, or the way in which pushed bodies can move."""
    return [*_of_layout(scene, frames), *_of_yaws(scene, frames), *_of_speed(frames)]


def _first_poses(frames: Frames) -> np.ndarray:
    first = frames.seen.argmax(0)
    poses = frames.poses[first, np.arange(frames.poses.shape[1])]
    poses[~frames.seen.any(0)] = np.nan
    return poses[1:]


def _of_layout(scene: Scene, frames: Frames) -> list[Finding]:
    first, there = _first_poses(frames), scene.poses_world_from_body
    seen = np.isfinite(first[:, 0])
    names = [name for name, yes in zip(scene.names, seen, strict=True) if yes]
    start, end = there[seen, :2], first[seen, :2]
    if len(names) < 2:
        return []
    as_is = fit(start, end, False, 1.0)
    spread = float(np.sqrt(np.mean(np.abs(complex_of(start - start.mean(0))) ** 2)))
    if as_is.off < min(LAYOUT_OFF, spread / 2):
        return []

    good = min(CLEARLY_BETTER * as_is.off, LAYOUT_OFF)
    scales = {name: factor for name, factor in LENGTHS.items() if name != "m"} | {"m": 1e3}
    for name, factor in scales.items():
        scaled = [fit(start, end, mirrored, 1 / factor) for mirrored in (False, len(names) > 2)]
        if min(one.off for one in scaled) < good:
            sizes = [float(np.ptp(points, 0).max()) for points in (end, start)]
            what = f"looks like {NAMES[name]}: the bodies stand {sizes[0]:.3g} m apart, in the scene {sizes[1]:.3g}"
            return [Finding(what, cause=f"lengths in {NAMES[name]}", remedy=f"give --units {name}", grave=True)]
    if len(names) > 2 and (mirror := fit(start, end, True, 1.0)).off < good:
        turned = abs(math.remainder(mirror.rotation, math.tau))
        axes = "swapped" if abs(turned - np.pi / 2) < np.pi / 4 else "mirrored"
        cause = "x and y exchanged" if axes == "swapped" else "an axis that points the other way, as y in an image"
        off = f"{mirror.off * 100:.1f} cm off, else {as_is.off * 100:.1f}"
        what = f"the bodies stand as in a mirror of the scene ({off})"
        return [Finding(what, cause=cause, remedy=f"give --axes {axes}", grave=True)]
    for a, b in combinations(range(len(names)), 2):
        order = np.arange(len(names))
        order[[a, b]] = b, a
        if fit(start, end[order], False, 1.0).off < good:
            what = f"{names[a]} and {names[b]} stand where the scene has the other"
            remedy = "give --name for both, or correct the scene"
            return [Finding(what, cause="their names or tags are exchanged", remedy=remedy, grave=True)]
    what = f"the bodies stand otherwise than in the scene, {as_is.off * 100:.0f} cm off on average, however turned"
    return [Finding(what, cause="poses in the scene that are not those of the start, or another scene")]


def _of_yaws(scene: Scene, frames: Frames) -> list[Finding]:
    """Yaws in degrees turn by far more than a push can turn a body, and less if taken as degrees."""
    found = []
    degree = ANGLES["deg"]
    radius = [float(min(_inradius(part.shape) for part in body.shape.parts)) for body in scene.bodies]
    for node, name in enumerate(scene.names, start=1):
        for stretch in _stretches(frames):
            seen = stretch[frames.seen[stretch, node]]
            if len(seen) < 2:
                continue
            yaw = frames.poses[seen, node, 2]
            path = np.hypot(*np.diff(frames.poses[stretch, 0, :2], axis=0).T).sum()
            most = TURNED + TURNING * path / radius[node - 1]
            steps = np.abs(wrap_angle(np.diff(yaw)))
            turns = np.ptp(yaw)
            raw = np.abs(np.diff(yaw))
            # In degrees, small steps are large but not near half turns only, and the whole turn is beyond reason.
            flips = np.abs(steps - np.pi) < 0.3
            if turns > most and turns * degree < most and (raw[~flips] > 0.02).sum() >= 2 and _not_by_full_turns(raw):
                found.append((name, seen, float(turns)))
    first, there = _first_poses(frames)[:, 2], scene.poses_world_from_body[:, 2]
    alike = _yaws_alike(scene, first, there, degree)
    if not found and not alike:
        return _of_handedness(scene, frames)
    if found:
        name, seen, turns = max(found, key=lambda one: one[2])
        times = frames.times[seen]
        what = f"yaw looks like degrees: it turns by {turns:.1f} in one push"
        return [Finding(what, name, float(times[0]), float(times[-1]), "yaws in degrees", "give --units deg", True)]
    return [Finding(f"yaw looks like degrees: {alike}", cause="yaws in degrees", remedy="give --units deg", grave=True)]


def _of_handedness(scene: Scene, frames: Frames) -> list[Finding]:
    """Yaws that start as in the scene only if they count clockwise."""
    first, there = _first_poses(frames), scene.poses_world_from_body
    shown = np.isfinite(first).all(-1) & np.array([not isinstance(body.shape, Cylinder) for body in scene.bodies])
    if not shown.any() or np.isfinite(first[:, 0]).sum() < 2:
        return []
    seen = np.isfinite(first[:, 0])
    turned = fit(there[seen, :2], first[seen, :2], False, 1.0)
    if turned.off > LAYOUT_OFF:
        return []
    as_is, clockwise = (
        np.abs(wrap_angle(2 * (sign * first[shown, 2] - there[shown, 2] - turned.rotation))) / 2 for sign in (1, -1)
    )
    if as_is.max() < 2 * YAW_OFF or clockwise.max() > YAW_OFF:
        return []
    name = [name for name, yes in zip(scene.names, shown, strict=True) if yes][int(as_is.argmax())]
    what = f"yaw starts {np.degrees(as_is.max()):.0f} degrees off the scene's, and as there if it counts clockwise"
    return [Finding(what, name, cause="yaws that count clockwise", remedy="give --units -rad, or -deg", grave=True)]


def _not_by_full_turns(raw: Float[np.ndarray, " steps"]) -> bool:
    """Whether what makes the turn great is no leap by full turns, which yaws may make."""
    return float(raw[np.abs(raw - 2 * np.pi * np.round(raw / (2 * np.pi))) > 1e-3].sum()) > np.pi


def _yaws_alike(scene: Scene, first: np.ndarray, there: np.ndarray, degree: float) -> str:
    """Say which first yaw is no angle in radians but the scene's in degrees."""
    known = np.isfinite(first) & np.array([not isinstance(body.shape, Cylinder) for body in scene.bodies])
    for node in np.flatnonzero(known & (np.abs(first) > 2 * np.pi)).tolist():
        others = known & (np.abs(there) < 0.01)
        turned = np.median(first[others] * degree - there[others]) if others.any() else 0.0
        if abs(math.remainder(first[node] * degree - there[node] - turned, math.tau)) < YAW_OFF:
            return f"{scene.names[node]} starts at {first[node]:.1f}, in the scene at {there[node]:.2f} rad"
    return ""


def _stretches(frames: Frames) -> list[np.ndarray]:
    """Frames of each push, in order."""
    ends = np.flatnonzero(np.diff(frames.push)) + 1
    parts = np.split(np.arange(len(frames.push)), ends)
    return [part for part in parts if frames.down[part[0]] and len(part) > 1]


def _inradius(shape: Cylinder | Cuboid) -> float:
    a, b, radius = shape.core
    return min(a, b) + radius


def _of_speed(frames: Frames) -> list[Finding]:
    """A tool that pushes faster than any robot: lengths or times have another unit."""
    speeds = [
        np.hypot(*np.diff(frames.poses[stretch, 0, :2], axis=0).T) / np.diff(frames.times[stretch])
        for stretch in _stretches(frames)
    ]
    if not speeds or not (speed := float(np.median(np.concatenate(speeds)))) > SPEED_LIMIT:
        return _of_slowness(frames)
    cause = "lengths in millimetres or centimetres, or clocks that differ"
    return [Finding(f"the tool pushes at {speed:.3g} m/s", cause=cause, remedy="give --units", grave=True)]


def _of_slowness(frames: Frames) -> list[Finding]:
    """Intervals of minutes are no rate: times are in milliseconds, or finer."""
    interval = float(np.median(np.diff(frames.times))) if len(frames.times) > 1 else 0.0
    for name, longest in (("ns", np.inf), ("us", 1e6), ("ms", 1e3)):
        factor = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}[name]
        if 2.0 < interval <= longest and 1e-3 < interval * factor < 1.0:
            what = f"looks like {name}: frames come every {interval:.3g} s"
            return [Finding(what, cause=f"times in {name}", remedy=f"give --units {name}", grave=True)]
    return []
