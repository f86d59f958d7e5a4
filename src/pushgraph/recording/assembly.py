"""From sightings of all nodes, each at its own times, to frames: all nodes at the same times."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.body import ROBOT
from pushgraph.errors import TrackError
from pushgraph.pose import wrap_angle
from pushgraph.recording.findings import Finding, listed, plural, spans
from pushgraph.recording.sightings import NO_PUSH, Sightings
from pushgraph.track import FRAME, LIFTED, ON_TIME
from pushgraph.wrench import check_measured, mean_since

CLOCK_RESET = 1.0
"""Times that fall back by more than this (s) are a clock set anew; by less, rows out of order."""
AT_ORIGIN = 0.02
"""A node seen this near to the origin (m) may truly stand on it."""
LIFT_HEIGHT = 0.015
"""A tool this much higher (m) than it ever works is lifted."""
LIFT_JUMP = 0.1
"""A tool whose pushes are not said was lifted where it moves farther than this (m) between two sightings."""
TIMES_APART = 1e-4
"""Poses of one frame may have been stamped this far apart (s) without need to interpolate."""


class Series(NamedTuple):
    """Sightings of one node, in order of time."""

    time: Float[np.ndarray, " sightings"]
    pose: Float[np.ndarray, "sightings 3"]
    push: Int[np.ndarray, " sightings"]
    wrench: Float[np.ndarray, "sightings 3"]

    @property
    def interval(self) -> float:
        """Usual time from one sighting to the next (s)."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else FRAME


class Frames(NamedTuple):
    """All nodes at the same times, the robot first; as in Track."""

    times: Float[np.ndarray, " frames"]
    poses: Float[np.ndarray, "frames nodes 3"]
    push: Int[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames nodes"]
    wrench: Float[np.ndarray, "frames 3"]

    @property
    def down(self) -> Bool[np.ndarray, " frames"]:
        """Whether the tool is down."""
        return self.push != LIFTED


def series_of_nodes(
    sightings: Sightings, matched: Mapping[str, str], nodes: Sequence[str]
) -> tuple[list[Series], list[Finding]]:
    """Sightings in the world frame, sorted by node and time, without what is lost or stands twice."""
    findings = [Finding(remark) for remark in sightings.remarks]
    of_node = np.full(len(sightings.names), -1)
    for recorded, node_name in matched.items():
        of_node[sightings.names.index(recorded)] = nodes.index(node_name)
    node_of_row = of_node[sightings.node]
    push = _pushes(sightings, node_of_row == nodes.index(ROBOT), findings)
    series, unordered, doubled, differing = [], 0, 0, 0
    resets: dict[str, tuple[float, float]] = {}
    for node, name in enumerate(nodes):
        rows = np.flatnonzero((node_of_row == node) & np.isfinite(sightings.time))
        given = len(rows)
        rows = _without_copies(sightings, rows)
        doubled += given - len(rows)
        falls = np.diff(sightings.time[rows])
        if (falls < -CLOCK_RESET).any():
            resets[name] = float(falls.min()), float(sightings.time[rows[int(falls.argmin())]])
        unordered += int((falls < 0).sum())
        rows = rows[np.argsort(sightings.time[rows], kind="stable")]
        poses = np.stack((sightings.x, sightings.y, sightings.yaw), -1)[rows]
        lost = _lost_at_origin(poses)
        if lost.any():
            what = f"{plural(int(lost.sum()), 'pose')} of 0,0,0 taken as lost"
            findings.append(Finding(what, name, *spans(sightings.time[rows], lost)))
        kept = sightings.seen[rows] & ~lost
        rows, poses = rows[kept], poses[kept]
        again = np.diff(sightings.time[rows], prepend=-np.inf) < ON_TIME
        doubled += int(again.sum())
        differing += int((np.abs(poses[1:] - poses[:-1])[again[1:]] > 1e-6).any(-1).sum())
        rows, poses = rows[~again], poses[~again]
        series.append(Series(sightings.time[rows], poses, push[rows], sightings.wrench[rows]))
    if resets:
        fall, time = min(resets.values())
        cause = "a clock that was set anew, or two recordings in one file"
        what = f"times fall back by {-fall:g} s"
        findings.append(Finding(what, listed(list(resets)), time, time, cause, "split the file there", grave=True))
    if unordered:
        findings.append(Finding(f"{plural(unordered, 'row')} out of order of time: sorted"))
    if doubled:
        differ = f", {differing} of them with other poses" if differing else ""
        findings.append(Finding(f"{plural(doubled, 'row')} of a node and time that stood before{differ}: left out"))
    unseen = [name for name, one in zip(nodes, series, strict=True) if not len(one.time)]
    if ROBOT in unseen or len(unseen) == len(nodes) - 1:
        raise TrackError(f"{ROBOT if ROBOT in unseen else 'any body'} was never seen")
    check_measured(series[0].wrench, series[0].time)
    if unseen:
        findings.append(Finding(f"{listed(unseen)}: never seen, nothing is learnt of them"))
    return series, findings


def assemble(series: Sequence[Series], lag: float = 0.0) -> Frames:
    """Frames at the times of the bodies' sightings, the robot interpolated; it stands `lag` (s) later in its own clock.

    Frames in which the robot's pose is not known are left out. Raises TrackError if none is left.
    """
    robot, bodies = series[0], series[1:]
    times = _frame_times([body for body in bodies if len(body.time)])
    poses = np.full((len(times), len(series), 3), np.nan)
    seen = np.zeros(poses.shape[:2], dtype=bool)
    for node, body in enumerate(bodies, start=1):
        poses[:, node], seen[:, node] = interpolated(body, times, 1.5 * body.interval)
    poses[:, 0], seen[:, 0] = interpolated(robot, times + lag, 1.5 * max(robot.interval, 2 * FRAME))
    at = times + lag
    before = (np.searchsorted(robot.time, at + ON_TIME) - 1).clip(min=0)
    after = np.searchsorted(robot.time, at - ON_TIME).clip(max=len(robot.time) - 1)
    push = robot.push[before].copy()
    both_down = (robot.push[before] != LIFTED) & (robot.push[after] != LIFTED)
    push[both_down & (robot.push[before] != robot.push[after])] = LIFTED
    kept = seen[:, 0]
    if not kept.any():
        ends = [(float(t[0]), float(t[-1])) for t in (robot.time, times)]
        raise TrackError(
            f"the robot was seen from {ends[0][0]:.2f} to {ends[0][1]:.2f} s and bodies from {ends[1][0]:.2f} to "
            f"{ends[1][1]:.2f} s, never together: give the robot's lag with --lag"
        )
    wrench = mean_since(at, robot.time, robot.wrench, FRAME, ON_TIME)
    return Frames(times[kept], poses[kept], push[kept], seen[kept], wrench[kept])


def clock_offset(series: Sequence[Series]) -> float:
    """Seconds from the first sighting of a body to that of the robot if their clocks never agree; else 0."""
    robot, times = series[0].time, _frame_times([body for body in series[1:] if len(body.time)])
    apart = robot[-1] < times[0] or robot[0] > times[-1]
    return float(robot[0] - times[0]) if apart else 0.0


def interpolated(
    series: Series, times: Float[np.ndarray, " frames"], bridge: float
) -> tuple[Float[np.ndarray, "frames 3"], Bool[np.ndarray, " frames"]]:
    """Poses at some times between sightings at most `bridge` (s) apart; elsewhere NaN, not seen."""
    if not len(series.time):
        return np.full((len(times), 3), np.nan), np.zeros(len(times), dtype=bool)
    after = np.searchsorted(series.time, times - TIMES_APART).clip(max=len(series.time) - 1)
    before = (np.searchsorted(series.time, times + TIMES_APART) - 1).clip(min=0)
    at, then = series.time[before], series.time[after]
    exact = before >= after  # a sighting at this very time
    seen = (at <= times + TIMES_APART) & (then >= times - TIMES_APART) & (exact | (then - at <= bridge))
    share = np.where(exact, 0.0, (times - at) / np.where(then > at, then - at, 1.0))[:, None]
    change = series.pose[after] - series.pose[before]
    change[:, 2] = wrap_angle(change[:, 2])
    poses = series.pose[before] + np.where(share > 0, share * change, 0.0)
    poses[~seen] = np.nan
    return poses, seen


def _frame_times(bodies: Sequence[Series]) -> Float[np.ndarray, " frames"]:
    """Times of frames: sightings of the bodies less than half of their interval apart belong together."""
    times = np.unique(np.concatenate([body.time for body in bodies]))
    half = 0.5 * min(body.interval for body in bodies)
    first, members = [0], times.tolist()
    for index, time in enumerate(members):
        if time - members[first[-1]] > half:
            first.append(index)
    bounds = [*first, len(times)]
    return np.array([times[(a + b - 1) // 2] for a, b in pairwise(bounds)])


def _without_copies(sightings: Sightings, rows: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " kept"]:
    """Rows of one node without those that repeat an earlier one in time and pose."""
    content = np.stack([column[rows] for column in (sightings.time, sightings.x, sightings.y, sightings.yaw)], -1)
    _, first = np.unique(np.nan_to_num(content, nan=np.inf), axis=0, return_index=True)
    return rows[np.sort(first)]


def _lost_at_origin(poses: Float[np.ndarray, "rows 3"]) -> Bool[np.ndarray, " rows"]:
    """Rows of exact zeros that stand for a lost tag: all but those of a node that was also seen close to the origin."""
    zero = (poses[:, :2] == 0).all(-1) & ((poses[:, 2] == 0) | np.isnan(poses[:, 2]))
    others = poses[~zero & np.isfinite(poses[:, :2]).all(-1)]
    if not zero.any() or not len(others) or np.hypot(others[:, 0], others[:, 1]).min() < AT_ORIGIN:
        return np.zeros(len(poses), dtype=bool)
    return zero


def _pushes(
    sightings: Sightings, robot: Bool[np.ndarray, " rows"], findings: list[Finding]
) -> Int[np.ndarray, " rows"]:
    """Push of each row of the robot: as said, or by its height, or one from each of its jumps to the next."""
    push = sightings.push.copy()
    unsaid = robot & (push == NO_PUSH)
    if not unsaid.any():
        return push
    rows = np.flatnonzero(robot & sightings.seen)
    if (push[rows] != NO_PUSH).any():  # said in some rows: it goes on until another is said
        said = np.maximum.accumulate(np.where(push[rows] != NO_PUSH, np.arange(len(rows)), 0))
        push[rows] = np.where(push[rows][said] == NO_PUSH, LIFTED, push[rows][said])
        push[unsaid & (push == NO_PUSH)] = LIFTED
        return push
    height = sightings.height[rows]
    if np.isfinite(height).all() and len(rows) and np.ptp(height) > LIFT_HEIGHT:
        down = height < np.percentile(height, 5) + LIFT_HEIGHT
        how = "no push is said: the tool is taken as lifted where it is higher than it works"
    else:
        down = np.ones(len(rows), dtype=bool)
        how = "no push is said: the tool is taken as down, but where it jumps"
    findings.append(Finding(how))
    leap = np.hypot(np.diff(sightings.x[rows], prepend=np.nan), np.diff(sightings.y[rows], prepend=np.nan)) > LIFT_JUMP
    begins = down & (leap | ~np.concatenate(([False], down[:-1])))
    push[robot] = LIFTED
    push[rows] = np.where(down, np.cumsum(begins) - 1, LIFTED)
    return push
