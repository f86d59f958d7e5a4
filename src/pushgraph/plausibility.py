"""What a run of a scene takes for granted, what it is refused for, and what makes its outcome doubtful.

One list for simulation and prediction alike: `assumptions` before it, `refusal` and `remarks` of its track.
"""

from collections.abc import Iterable
from itertools import product

import numpy as np
from jaxtyping import Float

from pushgraph.scene import NOMINAL_MASS, NOMINAL_SIDE_FRICTION, NOMINAL_TABLE_FRICTION, OVERLAP, Scene
from pushgraph.track import Track

PREDICTED_OVERLAP = 5e-3
"""A predicted body may lie this far (m) beneath the tool as it comes down: a prediction is no more exact."""
DEEP = 2e-3
"""Bodies and tool that overlap deeper than this (m) are remarked on."""
SPEED, SPIN = 1e-3, np.radians(1.0)
"""A body that is faster than this (m/s, rad/s) has not come to rest."""
MOST_NAMES = 8
"""A remark names so many bodies at most."""


def assumed_values(scene: Scene) -> list[str]:
    """Masses and frictions that a scene does not say, and what is taken instead."""
    unknown = [
        body.name for body, still in zip(scene.bodies, scene.immovable, strict=True) if body.mass is None and not still
    ]
    taken = [f"mass of {_listed(unknown)} is unknown: taken as {NOMINAL_MASS:g} kg, a nominal value"] * bool(unknown)
    if scene.table.friction is None:
        taken.append(f"table.friction is unknown: taken as {NOMINAL_TABLE_FRICTION:g}, a nominal value")
    if scene.side_friction is None:
        taken.append(f"side_friction is unknown: taken as {NOMINAL_SIDE_FRICTION:g}, a nominal value")
    return taken


def assumptions(scene: Scene) -> list[str]:
    """What a scene does not say, and what is taken instead."""
    taken = assumed_values(scene)
    if scene.unknown_pairs == "unlisted":
        taken.append("pairs that no joint or rigid group lists may be joined: taken as not joined")
    elif scene.unknown_pairs:
        taken.append(f"{_listed(map(' - '.join, scene.unknown_pairs))} may be joined: taken as not joined")
    if not scene.pushes:
        taken.append("the scene has no pushes: nothing moves")
    return taken


def simplifications(scene: Scene, solved: bool = True) -> list[str]:
    """What a scene says and a prediction does not know, and what it takes instead.

    solved: whether motions are solved from the laws of contact, as those of `contact`, or all learnt.
    """
    taken: list[str] = []
    if solved:
        return taken
    if supported := [body.name for body in scene.bodies if body.support is not None]:
        taken.append(f"support of {_listed(supported)} is ignored: predicted to press on all of the outline")
    if still := [name for name, immovable in zip(scene.names, scene.immovable, strict=True) if immovable]:
        taken.append(f"{_listed(still)} cannot move: predicted as bodies of great mass that are held in place")
    limited = [f"pushes[{index}]" for index, push in enumerate(scene.pushes) if push.force_limit is not None]
    if limited:
        taken.append(f"force_limit of {', '.join(limited[:MOST_NAMES])} is ignored: these pushers never stall")
    return taken


def start_fault(
    scene: Scene,
    push: int,
    pose_world_from_tool: Float[np.ndarray, "3"],
    poses_world_from_body: Float[np.ndarray, "bodies 3"],
    deepest: float = OVERLAP,
) -> str | None:
    """Say what the tool comes down on at the start of a push, if it is deeper in a body than `deepest` (m)."""
    gaps = scene.tool_gaps(pose_world_from_tool[None], poses_world_from_body)[0]
    if not gaps.min() < -deepest:
        return None
    return (
        f"pushes[{push}].start: the tool would come down on body {scene.names[int(gaps.argmin())]!r}, "
        f"{-gaps.min() * 1e3:.1f} mm deep, where it lies by then; start clear of the bodies"
    )


def refusal(track: Track, deepest: float = OVERLAP) -> str | None:
    """Say why a track cannot be: the first push whose tool comes down on a body deeper than `deepest` (m), if any."""
    for frame in np.flatnonzero(track.push_start).tolist():
        fault = start_fault(track.scene, int(track.push[frame]), track.poses[frame, 0], track.poses[frame, 1:], deepest)
        if fault:
            return fault
    return None


def remarks(track: Track) -> list[str]:
    """What makes a track doubtful, one sentence each: who fell, was crushed, or has not come to rest."""
    fallen = _leaving_times(track)
    said = [
        f"{name!r} leaves the table at {time:.2f} s: from then on its pose means nothing"
        for name, time in fallen.items()
    ]
    return said + _overlaps(track) + _stalls(track) + _unrest(track, fallen)


def _leaving_times(track: Track) -> dict[str, float]:
    """When the centre of each movable body that leaves the table is first seen off it (s)."""
    on_table = track.scene.on_table(np.nan_to_num(track.poses[:, 1:]))
    off = track.seen[:, 1:] & ~on_table & ~track.scene.immovable
    return {
        name: float(track.times[int(off[:, k].argmax())]) for k, name in enumerate(track.scene.names) if off[:, k].any()
    }


def _overlaps(track: Track) -> list[str]:
    """Say of each body how deep tool and fixed bodies are in it at the worst, deeper than DEEP."""
    scene = track.scene
    still = scene.immovable
    poses = np.nan_to_num(track.poses)
    seen = track.seen[:, 1:]
    in_tool = np.full(seen.shape, -np.inf)
    in_tool[track.down] = -scene.tool_gaps(poses[track.down, 0], poses[track.down, 1:])
    in_tool[~seen] = -np.inf
    in_fixed, which = _depths_in_fixed(track, poses[:, 1:])
    said = []
    for k, name in enumerate(scene.names):
        # Touching both: crushed. The tool's own depth is enough to say so where it is in the body alone.
        both = np.where((in_tool[:, k] > -OVERLAP) & (in_fixed[:, k] > -OVERLAP), in_tool[:, k] + in_fixed[:, k], 0.0)
        frame = int(both.argmax())
        if both[frame] > DEEP:
            said.append(
                f"{name!r} is crushed between the tool and {scene.names[which[frame, k]]!r}, "
                f"{_at(both, frame, track)}: a pusher with a force_limit would stall"
            )
            continue
        for depths, other in ((in_tool[:, k], "the tool"), (in_fixed[:, k], None)):
            frame = int(depths.argmax())
            if depths[frame] > DEEP:
                other = other or repr(scene.names[which[frame, k]])
                fixed = "fixed " * bool(still[k])
                said.append(f"{other} overlaps {fixed}{name!r}, {_at(depths, frame, track)}")
    return said


def _depths_in_fixed(track: Track, poses: Float[np.ndarray, "frames bodies 3"]) -> tuple[np.ndarray, np.ndarray]:
    """How deep each movable body is in what cannot move, in each frame (m; -inf: far from it), and in which body.

    Bodies that a joint joins may overlap.
    """
    scene = track.scene
    joined = {frozenset((joint.parent, joint.child)) for joint in scene.joints}
    movable, still = np.flatnonzero(~scene.immovable).tolist(), np.flatnonzero(scene.immovable).tolist()
    pairs = [(k, m) for k, m in product(movable, still) if {scene.names[k], scene.names[m]} not in joined]
    depth, which = np.full(poses.shape[:2], -np.inf), np.zeros(poses.shape[:2], dtype=int)
    if not pairs:
        return depth, which
    in_each = -scene.pair_gaps(pairs, poses)
    for (k, m), column in zip(pairs, in_each.T, strict=True):
        deeper = (column > depth[:, k]) & track.seen[:, 1 + k] & track.seen[:, 1 + m]
        depth[deeper, k], which[deeper, k] = column[deeper], m
    return depth, which


def _stalls(track: Track) -> list[str]:
    """Say of each push with a force limit how far from its end it ended."""
    said = []
    for index, push in enumerate(track.scene.pushes):
        frames = np.flatnonzero(track.push == index)
        if push.force_limit is None or not len(frames):
            continue
        short = float(np.hypot(*(push.waypoints[-1] - track.poses[frames[-1], 0])[:2]))
        if short > DEEP:
            said.append(
                f"pushes[{index}]: the tool ends {short * 1e3:.1f} mm from where it was to go: it stalls at its "
                f"force_limit of {push.force_limit:g} N"
            )
    return said


def _unrest(track: Track, fallen: Iterable[str]) -> list[str]:
    """Say of each body how fast it is when the track ends, unless it has come to rest."""
    if len(track.times) < 2:
        return []
    change = (track.poses[-1] - track.poses[-2]) / (track.times[-1] - track.times[-2])
    said = []
    seen_last = (track.seen[-2] & track.seen[-1])[1:]
    for name, (x, y, yaw), seen in zip(track.scene.names, change[1:], seen_last, strict=True):
        speed, spin = np.hypot(x, y), abs(yaw)
        if seen and name not in fallen and (speed > SPEED or spin > SPIN):
            said.append(
                f"{name!r} still moves when the track ends, at {speed * 1e3:.0f} mm/s and {np.degrees(spin):.0f} "
                "degrees/s: give the last push a longer rest"
            )
    return said


def _at(depths: Float[np.ndarray, " frames"], frame: int, track: Track) -> str:
    return f"{depths[frame] * 1e3:.1f} mm deep at {track.times[frame]:.2f} s"


def _listed(names: Iterable[str]) -> str:
    names = [repr(name) for name in names]
    more = [f"{len(names) - MOST_NAMES} more"] * (len(names) > MOST_NAMES)
    return ", ".join(names[:MOST_NAMES] + more)
