"""What the tool touches, and what moves: too deep, untouched, too far from frame to frame; and the robot's lag."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pushgraph.pose import wrap_angle
from pushgraph.recording.assembly import Frames, Series, interpolated
from pushgraph.recording.findings import Finding, spans
from pushgraph.recording.tag_errors import tool_travel
from pushgraph.scene import Scene
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
MOVING = 3e-3
"""A body that moves farther than this (m) around a moment moves then."""
MOST_LAG, FINE_LAG = 0.5, 0.005
"""Lags are sought up to so many seconds, in such steps."""
LEAST_LAG = 0.02
"""A lag below this (s) does no harm."""
LEAST_GAIN = 1.5e-3
"""A lag must bring the tool nearer to what moves by so much (m), on average."""
MOST_MOMENTS = 150
MOST_FRAMES = 4000
"""Frames looked at together."""
MOST_SAMPLES = 300


class Lag(NamedTuple):
    """How much later (s) the robot stands in its own clock, and how far the tool is from what moves with and without."""

    seconds: float
    off: float
    off_without: float

    @property
    def matters(self) -> bool:
        """Whether it explains what was seen better than none."""
        gain = self.off_without - self.off
        return abs(self.seconds) >= LEAST_LAG and gain > LEAST_GAIN and self.off < 0.6 * self.off_without


def estimate_lag(scene: Scene, robot: Series, frames: Frames) -> Lag | None:
    """The lag at which the tool touches what moves when it moves; None if too little moves."""
    moments = _moving_moments(frames)
    if len(moments) < 5:
        return None
    moments = moments[np.linspace(0, len(moments) - 1, min(len(moments), MOST_MOMENTS)).astype(int)]
    moving = _moving(frames)[moments]

    def off(lags: Sequence[float]) -> np.ndarray:
        return np.array([_distance_to_moving(scene, robot, frames, moments, moving, lag) for lag in lags])

    coarse = np.arange(-MOST_LAG, MOST_LAG + 1e-9, 4 * FINE_LAG)
    best = coarse[int(off(coarse).argmin())]
    fine = best + np.arange(-4, 5) * FINE_LAG
    values = off([*fine, 0.0])
    index = int(values[:-1].argmin())
    return Lag(round(float(fine[index]), 4), float(values[index]), float(values[-1]))


def _moving(frames: Frames) -> Bool[np.ndarray, "frames bodies"]:
    """Which bodies move around each frame, while the tool is down."""
    interval = float(np.median(np.diff(frames.times))) if len(frames.times) > 1 else FRAME
    apart = max(1, round(FRAME / interval))
    positions = np.where(frames.seen[:, 1:, None], frames.poses[:, 1:, :2], np.nan)
    moving = np.zeros(positions.shape[:2], dtype=bool)
    if len(positions) > 2 * apart:
        change = positions[2 * apart :] - positions[: -2 * apart]
        soon = frames.times[2 * apart :] - frames.times[: -2 * apart] < 3 * apart * interval
        moving[apart:-apart] = (np.nan_to_num(np.hypot(change[..., 0], change[..., 1])) > MOVING) & soon[:, None]
    return moving & frames.down[:, None]


def _moving_moments(frames: Frames) -> np.ndarray:
    return np.flatnonzero(_moving(frames).any(1))


def _distance_to_moving(
    scene: Scene,
    robot: Series,
    frames: Frames,
    moments: np.ndarray,
    moving: Bool[np.ndarray, "moments bodies"],
    lag: float,
) -> float:
    """Mean over moments of how far the tool is from the nearest body that moves, and how deep in any (m, to 5 cm)."""
    tool, seen = interpolated(robot, frames.times[moments] + lag, 1.5 * max(robot.interval, 2 * FRAME))
    gaps = np.full((len(moments), len(scene.bodies)), 0.05)
    at = moments[seen]
    gaps[seen] = scene.tool_gaps(tool[seen], np.nan_to_num(frames.poses[at, 1:]))
    gaps[~frames.seen[moments, 1:]] = 0.05
    nearest = np.where(moving, gaps, 0.05).min(1).clip(0, 0.05)
    return float((nearest + (-gaps).max(1).clip(0, 0.05)).mean())


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
    return found


def _untouched(scene: Scene, frames: Frames, gaps: Float[np.ndarray, "frames bodies"]) -> list[Finding]:
    reached = _reached(scene, frames, gaps)
    drifts: dict[int, tuple[float, float, float, float]] = {}
    for k in range(len(scene.bodies)):
        for first, last in _runs(~reached[:, k]):
            at = np.arange(first, last)[frames.seen[first:last, k + 1]]
            if len(at) < 2:
                continue
            few = min(5, len(at) // 2)
            ends = [np.nanmedian(frames.poses[some, k + 1], axis=0) for some in (at[:few], at[-few:])]
            shift = float(np.hypot(*(ends[1] - ends[0])[:2]))
            turn = float(np.nan_to_num(np.abs(wrap_angle(ends[1][2:] - ends[0][2:])))[0])
            if (shift > STRAY or turn > STRAY_YAW) and shift + turn > sum(drifts.get(k, (0, 0, 0, 0))[:2]):
                drifts[k] = (shift, turn, float(frames.times[at[0]]), float(frames.times[at[-1]]))
    if len(drifts) > 2 and len(drifts) >= 0.8 * len(scene.bodies):
        shift, turn, first, last = max(drifts.values())
        what = f"{len(drifts)} bodies move untouched, by up to {shift * 100:.1f} cm and {math.degrees(turn):.0f} degrees"
        cause = "a frame of reference that drifts, or robot and camera in different frames or clocks"
        return [Finding(what, "", first, last, cause, "see --axes and --lag", grave=True)]
    cause = "moved by hand or by the arm, or robot and camera in different frames or clocks"
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


def _reached(scene: Scene, frames: Frames, gaps: Float[np.ndarray, "frames bodies"]) -> Bool[np.ndarray, "frames bodies"]:
    """Whether the tool may have moved each body until each frame: it touches it, or what may be joined to it."""
    steps = np.diff(tool_travel(frames), prepend=0.0)
    ahead = np.maximum(steps, np.append(steps[1:], 0.0))
    touched = gaps < REACH + ahead[:, None]
    reached = touched @ _connected(scene, frames)
    last = np.where(reached, frames.times[:, None], -np.inf)
    last = np.maximum.accumulate(last, axis=0)
    before = np.roll(frames.push, 1) != frames.push  # what moved while nothing was recorded was not seen to be reached
    reached = frames.times[:, None] - last < COASTING
    reached[before & frames.down] |= touched[before & frames.down] @ _connected(scene, frames)
    return reached & ~scene.immovable


def _connected(scene: Scene, frames: Frames) -> Bool[np.ndarray, "bodies bodies"]:
    """Bodies that a chain of neighbours connects, as neighbours are that were ever close together."""
    count = len(scene.bodies)
    linked = np.eye(count, dtype=bool)
    pairs = [(a, b) for a in range(count) for b in range(a + 1, count)]
    if pairs:
        some = np.unique(np.linspace(0, len(frames.times) - 1, MOST_SAMPLES).astype(int))
        near = scene.pair_gaps(pairs, np.nan_to_num(frames.poses[some, 1:])) < NEIGHBOURS
        for (a, b), column in zip(pairs, near.T, strict=True):
            both = frames.seen[some, a + 1] & frames.seen[some, b + 1]
            linked[a, b] = linked[b, a] = bool((column & both).any())
    for _ in range(max(1, math.ceil(math.log2(count + 1)))):
        linked = linked @ linked
    return linked


def _runs(where: Bool[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], where, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _too_far_apart(scene: Scene, frames: Frames) -> list[Finding]:
    """A tool that goes farther from frame to frame than bodies or it are wide may have swept them unseen."""
    together = frames.down[1:] & (frames.push[1:] == frames.push[:-1])
    steps = np.hypot(*np.diff(frames.poses[:, 0, :2], axis=0).T)[together]
    if not len(steps):
        return []
    shapes = [part.shape for body in scene.bodies for part in body.shape.parts]
    tool = [part.shape for part in scene.tool.parts]
    width = min(2 * (min(shape.core[:2]) + shape.core[2]) for shape in (*shapes, *tool))
    step, rate = float(np.percentile(steps, 90)), 1 / float(np.median(np.diff(frames.times)[together]))
    if step <= width:
        return []
    what = (
        f"{rate:.3g} frames a second are too few: the tool goes {step * 100:.1f} cm from one to the next, and may have "
        f"swept what is {width * 100:.1f} cm wide between them"
    )
    return [Finding(what, remedy=f"record at {math.ceil(rate * step / width)} Hz or more, or push more slowly")]


