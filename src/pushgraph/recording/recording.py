"""A recording of pushes, read into a track, with what is doubtful about it."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pushgraph.body import ROBOT
from pushgraph.errors import TrackError
from pushgraph.recording.assembly import Frames, assemble, clock_offset, series_of_nodes
from pushgraph.recording.convention import Convention
from pushgraph.recording.files import read_sightings
from pushgraph.recording.findings import Finding, plural, spans
from pushgraph.recording.layout import suspicions
from pushgraph.recording.naming import match_names, unmatched
from pushgraph.recording.sightings import DEFAULTS, NOTHING_DECLARED, Declared, ReadOptions, Sightings
from pushgraph.recording.tag_errors import without_tag_errors
from pushgraph.recording.touch import MOST_LAG, Lag, estimate_lag, touch_findings
from pushgraph.scene import Scene
from pushgraph.track import FRAME, LIFTED, ON_TIME, Track
from pushgraph.wrench import present

WIDE_SEARCH = 3.0
"""Clocks that never agree are first matched by when both begin, then by motions up to so many seconds away."""
MISMATCH = 0.01
"""A tool farther than this (m) from what moves, at the best lag, does not push it."""
LEANING = 0.35
"""Nodes that lean more than this (rad) do not lie on the table."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What was read.

    track: every node where it could be believed, at the recording's own times. findings: what is doubtful. lag: by how
    much (s) the robot's times were shifted. source: the file, where it is of one.
    """

    track: Track
    findings: tuple[Finding, ...]
    lag: float = 0.0
    source: str = "this recording"

    def believed(self) -> Track:
        """The track; raises TrackError with every grave finding if there is one."""
        grave = [str(finding) for finding in self.findings if finding.grave]
        if grave:
            raise TrackError(f"{self.source}: cannot be believed as it is:\n" + "\n".join(f"- {one}" for one in grave))
        return self.track

    @property
    def rate(self) -> float:
        """Frames a second, in the median."""
        return rate_of(self.track.times)


def rate_of(times: Float[np.ndarray, " frames"]) -> float:
    """Frames a second, in the median; 0 of a single frame."""
    return float(1 / np.median(np.diff(times))) if len(times) > 1 else 0.0


def read_recording(
    path: str | os.PathLike,
    scene: Scene,
    *,
    names: Mapping[str, str] | None = None,
    declared: Declared = NOTHING_DECLARED,
    options: ReadOptions = DEFAULTS,
    lag: float | None = None,
    mend: bool = False,
) -> Recording:
    """Read any recording of a scene: CSV, HDF5, Motive, ROS bags, MCAP, LeRobot parquet.

    names: the scene's node of recorded names that do not say it. declared: units and axes, beyond the file's header.
    lag: how much later the robot stands in its own clock than in the camera's (s); None: estimated where it matters.
    mend: set right what can be, such as tags that were read turned, instead of leaving it out. Raises TrackError if the
    file cannot be read, or lacks the robot.

        track = pg.read_recording("camera.csv", scene).believed()
    """
    sightings = read_sightings(Path(path), options)
    try:
        return recording_of(sightings, scene, names or {}, declared, lag, mend, str(path))
    except TrackError as error:
        raise TrackError(f"{path}: {error}") from None


def recording_of(
    sightings: Sightings,
    scene: Scene,
    names: Mapping[str, str],
    declared: Declared,
    lag: float | None,
    mend: bool,
    source: str = "this recording",
) -> Recording:
    """From sightings to a recording; see `read_recording`."""
    found = _recording_of(sightings, scene, names, declared, lag, mend)
    return replace(found, source=source)


def _recording_of(
    sightings: Sightings, scene: Scene, names: Mapping[str, str], declared: Declared, lag: float | None, mend: bool
) -> Recording:
    nodes = (ROBOT, *scene.names)
    matched = match_names(sightings.names, nodes, names)
    convention = Convention.of(sightings.declared.overruled_by(declared))
    sightings = convention.apply(sightings)
    series, findings = series_of_nodes(sightings, matched, nodes)
    findings = unmatched(sightings.names, matched) + findings + _leaning(sightings, matched)
    if any(finding.grave for finding in findings):
        return Recording(_track(scene, assemble(series)), tuple(findings))

    offset = clock_offset(series) if lag is None else 0.0
    if offset:
        series[0] = series[0]._replace(time=series[0].time - offset)
    frames = assemble(series, lag or 0.0)
    if doubts := [*suspicions(scene, frames)]:
        findings += doubts
        if any(finding.grave for finding in doubts):  # all else would follow from it
            return Recording(_track(scene, frames), tuple(findings))

    cleaned, wrong = without_tag_errors(scene, frames, mend)
    shifted = lag or 0.0
    if lag is None and (found := estimate_lag(scene, series[0], cleaned, WIDE_SEARCH if offset else MOST_LAG)):
        if found.matters or offset:
            shifted = found.seconds
            findings.append(_lag_finding(found, offset))
        elif found.off_without > MISMATCH:
            what = f"what moves is {found.off_without * 1e3:.0f} mm from the tool, on average"
            cause = "robot and camera in different frames or clocks, or a tool of another size"
            findings.append(Finding(what, cause=cause, remedy="see --frame, --lag and the scene's tool"))
        if shifted:
            cleaned, wrong = without_tag_errors(scene, assemble(series, shifted), mend)
    elif offset:
        what = f"the robot's clock is {offset:g} s off the bodies', and too little moves to match them"
        findings.append(Finding(what, cause="clocks of robot and camera that differ", remedy="give --lag", grave=True))
    findings += wrong + _unread(cleaned)
    if not any(finding.grave for finding in wrong):
        findings += touch_findings(scene, cleaned)
    return Recording(_track(scene, cleaned), tuple(findings), offset + shifted)


def _lag_finding(lag: Lag, offset: float) -> Finding:
    seconds = offset + lag.seconds
    off = f"{lag.off * 1e3:.1f} mm off what moves" + f" instead of {lag.off_without * 1e3:.1f}" * (not offset)
    side = "behind" if seconds > 0 else "ahead of"
    what = f"the robot's clock is {abs(seconds):.12g} s {side} the camera's: its times were shifted, the tool is {off}"
    remedy = f"--lag {seconds:.12g} confirms it, --lag 0 keeps its times"
    return Finding(what, cause="clocks of robot and camera that differ", remedy=remedy, grave=lag.off > MISMATCH)


def _leaning(sightings: Sightings, matched: Mapping[str, str]) -> list[Finding]:
    """Bodies that do not stand upright: another axis is up, or they fell."""
    lean = {name: sightings.tilt[sightings.node == sightings.names.index(name)] for name in matched}
    leaning = [name for name, tilt in lean.items() if np.isfinite(tilt).any() and np.nanmedian(tilt) > LEANING]
    if not leaning:
        return []
    what = f"{len(leaning)} of {len(lean)} nodes lean by {np.degrees(np.nanmedian(lean[leaning[0]])):.0f} degrees"
    cause = "another axis is up, or their frames are not aligned with the table"
    return [Finding(what, leaning[0], cause=cause, remedy="give --up y, or z", grave=len(leaning) > len(lean) / 2)]


def _unread(frames: Frames) -> list[Finding]:
    """Times of pushes without a reading of the force sensor for 0.05 s, if there is one."""
    measured = present(frames.wrench)
    last = np.maximum.accumulate(np.where(measured, frames.times, -np.inf))
    missing = frames.down & (frames.times - last > FRAME - ON_TIME)
    if not missing.any() or not measured.any():
        return []
    what = f"no reading of its force sensor in {missing.sum()} of {plural(int(frames.down.sum()), 'frame')}"
    return [Finding(what, ROBOT, *spans(frames.times, missing), "readings lost, or fewer than poses")]


def _track(scene: Scene, frames: Frames) -> Track:
    """The track of frames, of a scene whose pushes are those recorded: its own, or none if others were recorded."""
    scene = scene if frames.push.max() < max(len(scene.pushes), 1) else scene.replace(pushes=())
    poses = frames.poses.copy()
    blind = np.array([True, *(body.yaw_known for body in scene.bodies)])
    seen = frames.seen & (np.isfinite(poses[..., 2]) | ~blind)
    poses[:, 0, 2] = np.nan_to_num(poses[:, 0, 2])
    seen[:, 0] = True
    poses[~seen] = np.nan
    push = np.where(frames.push < 0, LIFTED, frames.push)
    wrench = frames.wrench if present(frames.wrench).any() else None
    return Track(scene, frames.times, poses, push, seen, wrench)
