"""Pushes to adapt to, from recorded tracks: those that moved one body alone, with a round tool on a straight way."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from pushgraph.adaptation.online import tool_radius
from pushgraph.errors import AdaptationError
from pushgraph.pose import wrap_angle
from pushgraph.real_pushes import RealPushes
from pushgraph.shape import BodyShape
from pushgraph.track import LIFTED, Track

MOVED, TURNED = 3e-3, np.radians(2.0)
"""A body that is displaced (m) or turned (rad) by less did not move: cameras are no better."""
BENT = 2e-3
"""How far off the straight line between its ends a straight way may lead (m)."""


def pushes_of_tracks(tracks: Mapping[str, Track], surface: str) -> RealPushes:
    """The pushes of tracks, by file name, each of one body alone; bodies of one name must be of one shape.

    Raises AdaptationError if there are none, saying why others were left out, or if shapes or tools differ.
    """
    shapes: dict[str, BodyShape] = {}
    radii: set[float] = set()
    rows: list[tuple[str, float, np.ndarray, np.ndarray, np.ndarray]] = []
    left_out: Counter[str] = Counter()
    for name, track in tracks.items():
        for body in track.scene.bodies:
            if shapes.setdefault(body.name, body.shape) != body.shape:
                raise AdaptationError(f"{name}: body {body.name!r} is of another shape than in the tracks before")
        radii.add(tool_radius(track.scene.tool))
        for push in np.unique(track.push[track.push != LIFTED]).tolist():
            frames = np.flatnonzero(track.push == push)
            reason, moved = _fault(track, frames)
            if reason:
                left_out[reason] += 1
                continue
            poses = track.poses[frames]
            way = poses[[0, -1], 0, :2]
            seconds = max(float(track.times[frames[-1]] - track.times[frames[0]]), 1e-3)
            speed = float(np.hypot(*(way[1] - way[0]))) / seconds
            rows.append((track.scene.bodies[moved].name, speed, poses[0, 1 + moved], poses[-1, 1 + moved], way))
    if len(radii) > 1:
        raise AdaptationError("the tracks are of tools of different diameters; adapt to those of each by themselves")
    if not rows:
        why = ", ".join(f"{reason}: {count}" for reason, count in left_out.items()) or "none has its tool down"
        raise AdaptationError(f"no push to learn from, of one body alone on a straight way ({why})")
    names, speeds, before, after, ways = zip(*rows, strict=True)
    return RealPushes(
        shapes=shapes,
        surface=np.array([surface] * len(rows)),
        shape=np.array(names),
        speed=np.array(speeds),
        before=np.array(before),
        after=np.array(after),
        probe_start=np.array(ways)[:, 0],
        probe_end=np.array(ways)[:, 1],
        stated={},
        probe_radius=radii.pop(),
    )


def _fault(track: Track, frames: np.ndarray) -> tuple[str, int]:
    """Why nothing can be learnt from a push, if so, and which body it moved."""
    poses = track.poses[frames]
    if not np.isfinite(poses[[0, -1]]).all():
        return "a body or the tool is not seen at its ends", 0
    change = poses[-1, 1:] - poses[0, 1:]
    moved = np.flatnonzero((np.hypot(*change[:, :2].T) > MOVED) | (np.abs(wrap_angle(change[:, 2])) > TURNED))
    if len(moved) != 1:
        return f"{'no body' if not len(moved) else 'several bodies'} moved", 0
    if _bend(poses[:, 0, :2]) > BENT:
        return "the way of the tool is not straight", 0
    return "", int(moved[0])


def _bend(way: Float[np.ndarray, "frames 2"]) -> float:
    """How far a way leads off the line between its ends (m); infinite if it ends where it begins."""
    ahead = way[-1] - way[0]
    length = float(np.hypot(*ahead))
    if length < MOVED:
        return np.inf
    away = way - way[0]
    return float(np.nanmax(np.abs(away[:, 0] * ahead[1] - away[:, 1] * ahead[0])) / length)
