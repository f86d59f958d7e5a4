"""Sightings that are wrong by themselves: tags turned, exchanged or mistaken, and a frame of reference that moved.

What is wrong is left out, so that nothing learns from it, or set right where it can be and that is asked for.
"""

from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pushgraph import pose
from pushgraph.pose import wrap_angle
from pushgraph.recording.assembly import Frames
from pushgraph.recording.findings import Finding, plural, spans
from pushgraph.recording.layout import fit
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder

SLACK, SLACK_YAW = 0.03, 0.25
"""Noise and a body's own motion stay below this (m, rad) from one sighting to the next, beside what the tool does.

Of 1.4 million body-frames of simulated pushes of 300 scenes, 1 in 100,000 turned by 0.1 rad more than the tool's way
over the body's inradius, none by 0.3.
"""
MOST_TURN = 2.6
"""No body turns by more than this (rad) from one sighting to the next."""
QUARTER = np.pi / 2
NEAR_QUARTER = 0.35
"""A turn this near to quarters of a circle (rad) is a tag read another way up."""
FEW = 3
"""So many sightings away from all others are mistaken; more of them are a jump."""
RIGID, RIGID_YAW = 4e-3, 0.035
"""Bodies that keep their distances and angles within this (m, rad) moved as one."""
LEAST_SHIFT = 0.005
"""A frame of reference that moves less than this (m) is not noticed."""


class Checked(NamedTuple):
    """Frames without what was found wrong in them."""

    frames: Frames
    findings: list[Finding]


def without_tag_errors(scene: Scene, frames: Frames, mend: bool) -> Checked:
    """Find what no motion explains, one cause after the other, and leave it out, or mend it if `mend` asks for it."""
    findings: list[Finding] = []
    for check in (_moved_reference, _exchanged_tags, _turned_tags, _mistaken_tags):
        frames, found = check(scene, frames, mend)
        findings += found
        if any(finding.grave for finding in found):  # all else would follow from it
            break
    return Checked(frames, findings)


def tool_travel(frames: Frames) -> Float[np.ndarray, " frames"]:
    """Way of the tool along the table until each frame (m); lifted it goes nowhere."""
    down = frames.down[1:] & frames.down[:-1] & (frames.push[1:] == frames.push[:-1])
    steps = np.hypot(*np.diff(frames.poses[:, 0, :2], axis=0).T)
    return np.concatenate(([0.0], np.cumsum(np.where(down, steps, 0.0))))


def _moved_reference(scene: Scene, frames: Frames, mend: bool) -> Checked:
    """Moments at which all bodies that are seen leap as one."""
    findings, poses, wrench = [], frames.poses.copy(), frames.wrench.copy()
    travel = tool_travel(frames)
    seconds = np.diff(frames.times)  # where frames were dropped, the tool pushes everything farther
    speeds = (np.diff(travel) / seconds)[np.diff(travel) > 0]
    least = LEAST_SHIFT + 2 * seconds * (float(np.median(speeds)) if len(speeds) else 0.0)
    both = frames.seen[1:, 1:] & frames.seen[:-1, 1:]
    shift = np.where(both, np.hypot(*np.moveaxis(np.diff(frames.poses[:, 1:, :2], axis=0), -1, 0)), np.nan)
    turn = np.where(both, np.abs(wrap_angle(np.diff(frames.poses[:, 1:, 2], axis=0))), np.nan)
    count = both.sum(1)
    moving = (np.nan_to_num(shift) > LEAST_SHIFT) | (np.nan_to_num(turn) > 2 * RIGID_YAW)
    candidates = (count >= 2) & (moving.sum(1) >= count - (count > 3)) & (np.nan_to_num(shift).max(1) > least)
    for step in np.flatnonzero(candidates).tolist():
        bodies = 1 + np.flatnonzero(both[step])
        before, after = frames.poses[step, bodies], frames.poses[step + 1, bodies]
        motion = fit(before[:, :2], after[:, :2], False, 1.0)
        turns = np.abs(wrap_angle(after[:, 2] - before[:, 2] - motion.rotation))
        known = turns[np.isfinite(turns)]
        if motion.off > RIGID or (len(known) and np.median(known) > RIGID_YAW):
            continue
        middle = pose.rotate(before[:, :2].mean(0), motion.rotation)
        pose_new_from_old = np.array([*(after[:, :2].mean(0) - middle), motion.rotation])
        expected = pose.compose(pose_new_from_old, frames.poses[step, 0])[:2] - frames.poses[step + 1, 0, :2]
        stayed = np.hypot(*np.diff(frames.poses[step : step + 2, 0, :2], axis=0)[0])
        lifted = frames.push[step] != frames.push[step + 1] or not frames.down[step]
        with_robot = lifted or np.hypot(*expected) < stayed
        what = (
            f"all {len(bodies)} bodies leap as one, by {np.nanmax(shift[step]) * 100:.1f} cm and "
            f"{np.degrees(motion.rotation):.1f} degrees" + (", the robot with them" if with_robot else "")
        )
        time = float(frames.times[step + 1])
        remedy = "mended" if mend else "--mend takes it back"
        cause = "the frame of reference moved: camera or table was bumped, or the origin set anew"
        findings.append(Finding(what, "", time, time, cause, remedy, grave=not mend))
        nodes = slice(0 if with_robot else 1, None)
        undone = pose.compose(poses[step, bodies[0]], pose.inverse(frames.poses[step, bodies[0]]))
        undone = pose.compose(undone, pose.inverse(pose_new_from_old))
        poses[step + 1 :, nodes] = pose.compose(undone, frames.poses[step + 1 :, nodes])
        if with_robot:
            wrench[step + 1 :, :2] = pose.rotate(frames.wrench[step + 1 :, :2], undone[2])
    return Checked(frames._replace(poses=poses, wrench=wrench) if mend else frames, findings)


def _exchanged_tags(scene: Scene, frames: Frames, mend: bool) -> Checked:
    """Two bodies that leap to where the other was."""
    findings, poses, seen = [], frames.poses.copy(), frames.seen.copy()
    shift = np.hypot(*np.moveaxis(np.diff(frames.poses[:, 1:, :2], axis=0), -1, 0))
    leaps = np.nan_to_num(shift) > SLACK + np.diff(tool_travel(frames))[:, None]
    for a, b in combinations(np.flatnonzero(leaps.any(0)) + 1, 2):
        steps = np.flatnonzero(leaps[:, a - 1] & leaps[:, b - 1])
        crossed = frames.poses[steps + 1][:, [a, b], :2] - frames.poses[steps][:, [b, a], :2]
        steps = steps[(np.hypot(crossed[..., 0], crossed[..., 1]) < SLACK).all(-1)]
        if not len(steps):
            continue
        state = np.zeros(len(frames.times), dtype=int)
        state[steps + 1] = 1
        state = np.cumsum(state) % 2
        wrong = state != (state.mean() > 0.5)
        names = f"{scene.names[a - 1]} and {scene.names[b - 1]}"
        what = f"leap to each other's place and back, {plural(int(wrong.sum()), 'frame')} exchanged"
        remedy = "mended" if mend else "left out; --mend exchanges them back"
        findings.append(Finding(what, names, *spans(frames.times, wrong), "one tag taken for the other", remedy))
        if mend:
            poses[wrong, a], poses[wrong, b] = poses[wrong, b], poses[wrong, a].copy()
            seen[wrong, a], seen[wrong, b] = seen[wrong, b], seen[wrong, a].copy()
        else:
            poses[np.ix_(wrong, [a, b])], seen[np.ix_(wrong, [a, b])] = np.nan, False
    return Checked(frames._replace(poses=poses, seen=seen), findings)


def _turned_tags(scene: Scene, frames: Frames, mend: bool) -> Checked:
    """Tags read a half or a quarter turn off."""
    findings, poses, seen = [], frames.poses.copy(), frames.seen.copy()
    travel = tool_travel(frames)
    for node, name in enumerate(("robot", *scene.names)):
        if node == 0 and _round(scene):
            continue
        at = np.flatnonzero(seen[:, node] & np.isfinite(poses[:, node, 2]))
        if len(at) < 2:
            continue
        steps = wrap_angle(np.diff(poses[at, node, 2]))
        quarters = np.rint(steps / QUARTER)
        leap = (np.abs(steps - quarters * QUARTER) < NEAR_QUARTER) & (quarters != 0)
        leap &= np.abs(steps) > _most_turn(scene, node, np.diff(travel[at]))
        if node == 0:  # lifted, the tool may turn
            leap &= frames.down[at[1:]] & (frames.push[at[1:]] == frames.push[at[:-1]])
        state = np.concatenate(([0], np.cumsum(np.where(leap, quarters, 0)))).astype(int) % 4
        state = (state - np.bincount(state).argmax()) % 4
        wrong = state != 0
        if not wrong.any():
            continue
        turns = " or ".join(f"{90 * quarter}" for quarter in sorted({min(s, 4 - s) for s in state[wrong].tolist()}))
        what = f"turned by {turns} degrees in {wrong.sum()} of {len(at)} sightings"
        remedy = "mended" if mend else "left out; --mend turns them back"
        grave = node == 0 and not mend
        findings.append(
            Finding(what, name, *spans(frames.times[at], wrong), "a tag that was read turned", remedy, grave)
        )
        poses[at[wrong], node, 2] -= state[wrong] * QUARTER
        if not mend and node > 0:
            poses[at[wrong], node], seen[at[wrong], node] = np.nan, False
    return Checked(frames._replace(poses=poses, seen=seen), findings)


def _mistaken_tags(scene: Scene, frames: Frames, mend: bool) -> Checked:
    """Sightings away from where the node was before and after; and nodes that leap and stay there."""
    findings, poses, seen = [], frames.poses.copy(), frames.seen.copy()
    travel = tool_travel(frames)
    for node, name in enumerate(scene.names, start=1):
        at = np.flatnonzero(seen[:, node])
        if len(at) < 2:
            continue
        wrong, leaps = _strays(scene, node, poses[at, node], travel[at])
        if wrong.any():
            what = f"{plural(int(wrong.sum()), 'sighting')} away from those before and after"
            cause = "another tag or a reflection taken for it"
            findings.append(Finding(what, name, *spans(frames.times[at], wrong), cause, "left out"))
            poses[at[wrong], node], seen[at[wrong], node] = np.nan, False
        kept = at[~wrong]
        for index in leaps:
            before, after = poses[kept[index - 1], node], poses[kept[index], node]
            turn = np.degrees(abs(float(wrap_angle(after[2:] - before[2:])[0])))
            what = f"jumps by {np.hypot(*(after - before)[:2]) * 100:.1f} cm and {turn:.0f} degrees, and stays there"
            time = float(frames.times[kept[index]])
            cause = "moved by hand, its tag moved on it, or another tag taken for it"
            findings.append(Finding(what, name, time, time, cause, "leave out what comes before or after", True))
    return Checked(frames._replace(poses=poses, seen=seen), findings)


def _strays(
    scene: Scene, node: int, poses: Float[np.ndarray, "sightings 3"], travel: Float[np.ndarray, " sightings"]
) -> tuple[Bool[np.ndarray, " sightings"], list[int]]:
    """Sightings that are mistaken; and where among the others the node leaps."""

    def follows(before: int, after: int) -> bool:
        way = travel[after] - travel[before]
        change = poses[after] - poses[before]
        turn = abs(float(wrap_angle(change[2:])[0]))
        near = np.hypot(*change[:2]) < SLACK + 2 * way
        return bool(near and not turn > _most_turn(scene, node, np.array([way]))[0])

    steps = np.diff(poses, axis=0)
    ways = np.diff(travel)
    turns = np.nan_to_num(np.abs(wrap_angle(steps[:, 2])))
    broken = (np.hypot(steps[:, 0], steps[:, 1]) > SLACK + 2 * ways) | (turns > _most_turn(scene, node, ways))
    bounds = [0, *(np.flatnonzero(broken) + 1).tolist(), len(poses)]
    chunks = list(pairwise(bounds))
    wrong = np.zeros(len(poses), dtype=bool)
    kept: list[tuple[int, int]] = []
    index = 0
    while index < len(chunks):
        first, last = chunks[index]
        if kept and not follows(kept[-1][1] - 1, first):
            returns = next((k for k in range(index + 1, len(chunks)) if follows(kept[-1][1] - 1, chunks[k][0])), None)
            if returns is not None and last - first <= kept[-1][1] - kept[0][0]:
                wrong[first : chunks[returns][0]] = True
                index = returns
                continue
        if last - first <= FEW and len(chunks) > 1 and (not kept or index == len(chunks) - 1):
            wrong[first:last] = True
        else:
            kept.append((first, last))
        index += 1
    shown = np.cumsum(~wrong) - 1
    leaps = [int(shown[b[0]]) for a, b in pairwise(kept) if not follows(a[1] - 1, b[0])]
    return wrong, leaps


def _most_turn(scene: Scene, node: int, way: Float[np.ndarray, " steps"]) -> Float[np.ndarray, " steps"]:
    """How far a node may turn while the tool goes some way (rad)."""
    parts = scene.tool.parts if node == 0 else scene.bodies[node - 1].shape.parts
    inradius = min(min(part.shape.core[:2]) + part.shape.core[2] for part in parts)
    return np.minimum(SLACK_YAW + way / inradius, MOST_TURN)


def _round(scene: Scene) -> bool:
    """Whether the tool's yaw means nothing."""
    parts = scene.tool.parts
    return len(parts) == 1 and isinstance(parts[0].shape, Cylinder) and parts[0].pose_tool_from_part[:2] == (0.0, 0.0)
