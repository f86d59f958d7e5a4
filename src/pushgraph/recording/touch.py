"""What the tool touches, and what moves: too deep, untouched, too far from frame to frame; and the robot's lag."""

import math
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pushgraph import pose
from pushgraph.contact import signed_gap
from pushgraph.pose import wrap_angle
from pushgraph.recording.assembly import Frames, Series, interpolated
from pushgraph.recording.findings import Finding, spans
from pushgraph.recording.tag_errors import tool_travel
from pushgraph.scene import Scene
from pushgraph.scene_parts import parts_of
from pushgraph.shape import take
from pushgraph.track import FRAME

DEEP = 8e-3
"""A tool seen deeper than this in a body (m) is doubtful."""
REACH = 0.015
"""A body nearer than this to the tool (m), or to one that it reaches, may move."""
NEIGHBOURS = 0.025
"""Bodies that were ever nearer than this (m) may be joined, or push each other."""
COASTING = 0.35
"""Seconds in which a body may still move after nothing reaches it any more."""
STRAY, STRAY_YAW = 8e-3, 0.12
"""A body that moved farther than this (m, rad) while nothing reached it is doubtful."""
MOVING, MOVING_NOISE = 3e-3, 6.0
"""A body that moves farther than this (m), and than so many times its noise, around a moment moves then."""
KEPT_MOMENTS = 0.75
"""Share of moments, the best, that a lag is judged by: in others bodies may slide by themselves."""
MOST_LAG, FINE_LAG = 0.5, 0.005
"""Lags are sought up to so many seconds, in such steps."""
LEAST_LAG = 0.02
"""A lag below this (s) does no harm."""
LEAST_GAIN, MOST_OFF = 1.5e-3, 4e-3
"""A lag must bring the tool nearer to what moves by so much (m), on average, and so near."""
MOST_MOMENTS = 150
MOST_FRAMES = 4000
"""Frames looked at together."""
MOST_SAMPLES = 300


class Lag(NamedTuple):
    """By how much (s) the robot's clock is behind; how far (m) the tool is off what moves, with and without."""

    seconds: float
    off: float
    off_without: float

    @property
    def matters(self) -> bool:
        """Whether it explains what was seen better than none."""
        gain = self.off_without - self.off
        return abs(self.seconds) >= LEAST_LAG and gain > LEAST_GAIN and self.off < min(MOST_OFF, 0.6 * self.off_without)


def estimate_lag(scene: Scene, robot: Series, frames: Frames, most: float = MOST_LAG) -> Lag | None:
    """The lag of at most `most` (s) at which the tool touches what moves when it moves; None if too little moves."""
    moments = np.flatnonzero(_moving(frames).any(1))
    if len(moments) < 5:
        return None
    moments = moments[np.linspace(0, len(moments) - 1, min(len(moments), MOST_MOMENTS)).astype(int)]
    moving = _moving(frames)[moments]

    def off(lags: Float[np.ndarray, " lags"]) -> Float[np.ndarray, " lags"]:
        return np.array([_distance_to_moving(scene, robot, frames, moments, moving, lag) for lag in lags.tolist()])

    coarse = np.arange(-most, most + 1e-9, 4 * FINE_LAG)
    best = coarse[int(off(coarse).argmin())]
    fine = best + np.arange(-4, 5) * FINE_LAG
    values = off(np.append(fine, 0.0))
    index = int(values[:-1].argmin())
    return Lag(round(float(fine[index]), 4), float(values[index]), float(values[-1]))


def _moving(frames: Frames) -> Bool[np.ndarray, "frames bodies"]:
    """Which bodies move around each frame."""
    interval = float(np.median(np.diff(frames.times))) if len(frames.times) > 1 else FRAME
    apart = max(1, round(FRAME / interval))
    positions = np.where(frames.seen[:, 1:, None], frames.poses[:, 1:, :2], np.nan)
    moving = np.zeros(positions.shape[:2], dtype=bool)
    if len(positions) > 2 * apart:
        change = positions[2 * apart :] - positions[: -2 * apart]
        soon = frames.times[2 * apart :] - frames.times[: -2 * apart] < 3 * apart * interval
        least = np.maximum(MOVING, MOVING_NOISE * _noise(positions))
        moving[apart:-apart] = (np.nan_to_num(np.hypot(change[..., 0], change[..., 1])) > least) & soon[:, None]
    return moving


def _noise(positions: Float[np.ndarray, "frames bodies 2"]) -> Float[np.ndarray, " bodies"]:
    """Standard deviation (m, of a coordinate) of noise: what in half of the frames no steady motion explains."""
    bends = positions[2:] - 2 * positions[1:-1] + positions[:-2]
    lengths = np.nan_to_num(np.hypot(bends[..., 0], bends[..., 1]))
    return np.median(lengths, axis=0) / (math.sqrt(6) * math.sqrt(2 * math.log(2)))


def _distance_to_moving(
    scene: Scene,
    robot: Series,
    frames: Frames,
    moments: np.ndarray,
    moving: Bool[np.ndarray, "moments bodies"],
    lag: float,
) -> float:
    """Mean over most moments of how far the tool is from the nearest that moves, and how deep in any (m, to 5 cm)."""
    tool, seen = interpolated(robot, frames.times[moments] + lag, 1.5 * max(robot.interval, 2 * FRAME))
    gaps = np.full((len(moments), len(scene.bodies)), 0.05)
    at = moments[seen]
    gaps[seen] = scene.tool_gaps(tool[seen], np.nan_to_num(frames.poses[at, 1:]))
    gaps[~frames.seen[moments, 1:]] = 0.05
    nearest = np.where(moving, gaps, 0.05).min(1).clip(0, 0.05)
    off = np.sort(nearest + (-gaps).max(1).clip(0, 0.05))
    return float(off[: math.ceil(KEPT_MOMENTS * len(off))].mean())


def touch_findings(scene: Scene, frames: Frames) -> list[Finding]:
    """What tool and bodies do that they cannot, or that may have been missed between frames."""
    parts = [slice(k, k + MOST_FRAMES) for k in range(0, len(frames.times), MOST_FRAMES)]
    poses = np.nan_to_num(frames.poses)
    gaps = np.concatenate([scene.tool_gaps(poses[part, 0], poses[part, 1:]) for part in parts])
    gaps[~frames.down] = np.inf
    gaps[~frames.seen[:, 1:]] = np.inf
    return [*_depths(scene, frames, gaps), *_untouched(scene, frames, gaps), *_too_far_apart(scene, frames)]


def _depths(scene: Scene, frames: Frames, gaps: Float[np.ndarray, "frames bodies"]) -> list[Finding]:
    found = []
    for k, name in enumerate(scene.names):
        deep = gaps[:, k] < -DEEP
        if deep.any():
            what = f"the tool is up to {-gaps[:, k].min() * 1e3:.0f} mm inside, in {deep.sum()} frames"
            cause = "robot and camera in different frames or clocks, a tag off the middle, or wrong sizes in the scene"
            found.append(Finding(what, name, *spans(frames.times, deep), cause, "see --axes, --lag and the scene"))
    if found and _clear_if_clockwise(scene, frames):
        cause, remedy = "yaws that count clockwise", "give --units -rad, or -deg"
        found = [finding._replace(cause=cause, remedy=remedy, grave=True) for finding in found]
    return found


def _clear_if_clockwise(scene: Scene, frames: Frames) -> bool:
    """Whether the tool would stay out of all bodies if they turned the other way."""
    some = np.flatnonzero(frames.down)
    some = some[np.linspace(0, len(some) - 1, min(len(some), MOST_FRAMES)).astype(int)]
    poses = np.nan_to_num(frames.poses[some])
    first = frames.poses[frames.seen.argmax(0), np.arange(frames.poses.shape[1]), 2]
    poses[..., 2] = np.nan_to_num(2 * first) - poses[..., 2]
    gaps = scene.tool_gaps(poses[:, 0], poses[:, 1:])
    return not (gaps[frames.seen[some, 1:]] < -DEEP).any()


def _untouched(scene: Scene, frames: Frames, gaps: Float[np.ndarray, "frames bodies"]) -> list[Finding]:
    reached = _reached(scene, frames, gaps)
    drifts: dict[int, tuple[float, float, float, float]] = {}
    for k in range(len(scene.bodies)):
        for begin, end in _runs(~reached[:, k]):
            at = np.arange(begin, end)[frames.seen[begin:end, k + 1]]
            if len(at) < 2:
                continue
            few = min(5, len(at) // 2)
            ends = [np.median(frames.poses[some, k + 1], axis=0) for some in (at[:few], at[-few:])]
            shift = float(np.hypot(*(ends[1] - ends[0])[:2]))
            turn = float(np.nan_to_num(np.abs(wrap_angle(ends[1][2:] - ends[0][2:])))[0])
            if (shift > STRAY or turn > STRAY_YAW) and shift + turn > sum(drifts.get(k, (0, 0, 0, 0))[:2]):
                drifts[k] = (shift, turn, float(frames.times[at[0]]), float(frames.times[at[-1]]))
    if len(drifts) > 2 and len(drifts) >= 0.8 * len(scene.bodies):
        shift, turn, first, last = max(drifts.values())
        most = f"{shift * 100:.1f} cm and {math.degrees(turn):.0f} degrees"
        what = f"{len(drifts)} bodies move untouched, by up to {most}"
        cause = "a frame of reference that drifts, or robot and camera in different frames or clocks"
        return [Finding(what, "", first, last, cause, "see --axes and --lag", grave=True)]
    cause = "moved by hand or by the arm, a frame of reference that drifts, or robot and camera in different frames"
    return [
        Finding(
            f"moves untouched, by {shift * 100:.1f} cm and {math.degrees(turn):.0f} degrees",
            scene.names[k],
            first,
            last,
            cause,
        )
        for k, (shift, turn, first, last) in drifts.items()
    ]


def _reached(
    scene: Scene, frames: Frames, gaps: Float[np.ndarray, "frames bodies"]
) -> Bool[np.ndarray, "frames bodies"]:
    """Whether the tool may have moved each body until each frame: it touches it, or what may be joined to it."""
    steps = np.diff(tool_travel(frames), prepend=0.0)
    ahead = np.maximum(steps, np.append(steps[1:], 0.0))
    touched = gaps < REACH + ahead[:, None]
    reached = np.zeros_like(touched)
    for begin, end, connected in _connected(scene, frames):
        reached[begin:end] = touched[begin:end] @ connected
    last = np.maximum.accumulate(np.where(reached, frames.times[:, None], -np.inf), axis=0)
    return (frames.times[:, None] - last < COASTING) & ~scene.immovable


def _connected(scene: Scene, frames: Frames) -> Iterator[tuple[int, int, Bool[np.ndarray, "bodies bodies"]]]:
    """Stretches of frames (first, after the last), and which bodies a chain of neighbours connects in them.

    Neighbours are those that are close together, or were before.
    """
    count = len(scene.bodies)
    some = np.unique(np.linspace(0, len(frames.times) - 1, MOST_SAMPLES).astype(int))
    parts = parts_of([body.shape for body in scene.bodies])
    owner, circles = parts.owner, parts.circles
    poses = parts.poses(np.nan_to_num(frames.poses[some, 1:]))
    linked = np.zeros((len(some), count, count), dtype=bool)
    linked[:, range(count), range(count)] = True
    for a, b in combinations(range(len(owner)), 2):
        between = pose.relative(poses[:, a], poses[:, b])
        near = np.hypot(between[:, 0], between[:, 1]) < circles[a] + circles[b] + NEIGHBOURS
        near &= frames.seen[some, owner[a] + 1] & frames.seen[some, owner[b] + 1]
        if near.any():
            box_a, box_b = (take(parts.boxes, np.full(near.sum(), part)) for part in (a, b))
            near[near] = signed_gap(box_a, box_b, between[near]) < NEIGHBOURS
            near = np.maximum.accumulate(near)
            linked[:, owner[a], owner[b]] |= near
            linked[:, owner[b], owner[a]] |= near
    for _ in range(math.ceil(math.log2(count + 1))):
        linked = linked @ linked
    for sample, (first, last) in enumerate(pairwise([*some.tolist(), len(frames.times)])):
        yield first, last, linked[min(sample + 1, len(some) - 1)]


def _runs(where: Bool[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], where, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _too_far_apart(scene: Scene, frames: Frames) -> list[Finding]:
    """A tool that goes farther from frame to frame than it and a body are wide, on average, may sweep that unseen."""
    together = frames.down[1:] & (frames.push[1:] == frames.push[:-1])
    steps = np.hypot(*np.diff(frames.poses[:, 0, :2], axis=0).T)[together]
    if not len(steps):
        return []
    bodies = [part.shape for body in scene.bodies for part in body.shape.parts]
    tool = [part.shape for part in scene.tool.parts]
    width = sum(min(min(shape.core[:2]) + shape.core[2] for shape in shapes) for shapes in (bodies, tool))
    step, rate = float(np.percentile(steps, 90)), 1 / float(np.median(np.diff(frames.times)[together]))
    if step <= width:
        return []
    what = (
        f"{rate:.3g} frames a second are too few: the tool goes {step * 100:.1f} cm from one to the next, and may have "
        f"swept bodies between them; at most {width * 100:.1f} cm are good, the mean width of it and the narrowest body"
    )
    return [Finding(what, remedy=f"record at {math.ceil(rate * step / width)} Hz or more, or push more slowly")]


