"""What a recording holds of each node, at a glance."""

from typing import NamedTuple

import numpy as np

from pushgraph.recording.findings import Finding
from pushgraph.recording.sightings import Sightings

LONG_GAP = 2.5
"""A time without sightings this many intervals long is a gap."""
JUMP = 0.1
"""A node farther than this (m) from where it was seen before has jumped."""
WIDEST_TABLE = 10.0
"""Farther than this (m) no arm reaches."""
MOST_TURNS = 4
SLOWEST_RATE = 0.5
"""Fewer frames a second (Hz) show no push."""


class NodeSummary(NamedTuple):
    """Sightings of one node, in order of time.

    rate: Hz, in the median. lost: rows without a position. gaps: times without sightings, the longest of `longest_gap`
    seconds. jumps: farther than JUMP from one sighting to the next.
    """

    name: str
    sightings: int
    lost: int
    first: float
    last: float
    rate: float
    gaps: int
    longest_gap: float
    jumps: int


def summarize(sightings: Sightings) -> list[NodeSummary]:
    """Summaries of all nodes; sightings in m, rad and s."""
    return [_of_node(sightings, node) for node in range(len(sightings.names))]


def doubts(sightings: Sightings) -> list[Finding]:
    """Units that no table and no body has, whatever the scene; sightings taken to be in m, rad and s."""
    found = []
    seen = sightings.seen
    extent = float(max(np.ptp(sightings.x[seen]), np.ptp(sightings.y[seen]))) if seen.any() else 0.0
    if extent > WIDEST_TABLE:
        cause = "lengths in millimetres or centimetres"
        found.append(Finding(f"positions spread over {extent:.3g} m", cause=cause, remedy="give --units mm, or cm"))
    yaws = [sightings.yaw[(sightings.node == node) & seen] for node in range(len(sightings.names))]
    turning = [float(np.ptp(yaw)) for yaw in yaws if np.isfinite(yaw).any()]
    if turning and max(turning) > MOST_TURNS * 2 * np.pi:
        what = f"yaws turn by up to {max(turning):.3g} rad"
        found.append(Finding(what, cause="yaws in degrees", remedy="give --units deg"))
    rates = [one.rate for one in summarize(sightings) if one.sightings > 1]
    if rates and max(rates) < SLOWEST_RATE:
        what = f"frames come every {1 / max(rates):.3g} s"
        found.append(Finding(what, cause="times in milliseconds, or finer", remedy="give --units ms, us or ns"))
    return found


def _of_node(sightings: Sightings, node: int) -> NodeSummary:
    rows = np.flatnonzero(sightings.node == node)
    rows = rows[np.argsort(sightings.time[rows], kind="stable")]
    seen = rows[sightings.seen[rows]]
    times = sightings.time[seen]
    if not len(seen):
        return NodeSummary(sightings.names[node], 0, len(rows), np.nan, np.nan, 0.0, 0, 0.0, 0)
    intervals = np.diff(times)
    usual = float(np.median(intervals[intervals > 0])) if (intervals > 0).any() else np.inf
    steps = np.hypot(np.diff(sightings.x[seen]), np.diff(sightings.y[seen]))
    gaps = intervals > LONG_GAP * usual
    return NodeSummary(
        name=sightings.names[node],
        sightings=len(seen),
        lost=len(rows) - len(seen),
        first=float(times[0]),
        last=float(times[-1]),
        rate=1 / usual,
        gaps=int(gaps.sum()),
        longest_gap=float(intervals[gaps].max(initial=0.0)),
        jumps=int((steps > JUMP).sum()),
    )
