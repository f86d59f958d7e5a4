"""What happened in a track: displacement, penetration, what each push moved; and the same of many, as a table."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from pushgraph.simulation.articulation import DYNAMICS
from pushgraph.simulation.setups import REJECTIONS, TOUCHED, Trajectory
from pushgraph.track import Track

OVERLAP_LIMIT = 1e-3
"""A frame whose deepest overlap exceeds this (m) counts as overlapping."""
COLUMNS = np.dtype(
    [
        ("frames", "i4"),
        ("overlapping_frames", "i4"),
        ("deepest_overlap_m", "f4"),
        ("moved_bodies", "i4"),
        ("displacement_m", "f4"),
        ("pushes", "i4"),
        ("effective_pushes", "i4"),
        *((f"joints_{kind}", "i4") for kind in DYNAMICS),
        *((f"rejected_{name}", "i4") for name in REJECTIONS),
    ]
)
"""One row a trajectory. Bodies have moved, and pushes were effective, from 5 mm on; displacement: of moved bodies."""


def summarize(trajectory: Trajectory) -> np.ndarray:
    """One row of COLUMNS."""
    track = trajectory.track
    overlap = penetration(track)
    travelled = _travelled(track.poses[0], track.poses[-1])
    moved = travelled > TOUCHED
    pushes = [np.flatnonzero(track.push == push) for push in np.unique(track.push[track.down])]
    joints = Counter(joint.kind for joint in track.scene.joints)
    row = np.zeros((), COLUMNS)
    row["frames"] = len(track.times)
    row["overlapping_frames"] = (overlap > OVERLAP_LIMIT).sum()
    row["deepest_overlap_m"] = overlap.max()
    row["moved_bodies"] = moved.sum()
    row["displacement_m"] = travelled[moved].mean() if moved.any() else 0.0
    row["pushes"] = len(pushes)
    row["effective_pushes"] = sum(
        _travelled(track.poses[frames[0]], track.poses[frames[-1]]).max() > TOUCHED for frames in pushes
    )
    for kind in DYNAMICS:
        row[f"joints_{kind}"] = joints[kind]
    for name, reason in REJECTIONS.items():
        row[f"rejected_{name}"] = trajectory.rejected[reason]
    return row


def table(rows: np.ndarray) -> Mapping[str, str]:
    """Closing table of a dataset: a line of text for each thing a user wants to know of it."""
    frames, bodies = rows["frames"].sum(), rows["moved_bodies"]
    clean = 1 - rows["overlapping_frames"].sum() / frames
    every_push = (rows["effective_pushes"] == rows["pushes"]).mean()
    rejected = {reason: int(rows[f"rejected_{name}"].sum()) for name, reason in REJECTIONS.items()}
    why = "; ".join(f"{reason}: {count}" for reason, count in rejected.items() if count)
    displacement = np.average(rows["displacement_m"], weights=bodies) if bodies.any() else 0.0
    return {
        "trajectories": f"{len(rows)}",
        "frames": f"{frames} ({frames / len(rows):.0f} a trajectory)",
        "joints": ", ".join(f"{rows[f'joints_{kind}'].sum()} {kind}" for kind in DYNAMICS),
        "moved bodies": f"{bodies.mean():.1f} a trajectory, by {displacement * 100:.1f} cm on average",
        "pushes": f"{every_push:.1%} of trajectories have every push move a body by {TOUCHED * 1e3:g} mm",
        "penetration": f"at most {OVERLAP_LIMIT * 1e3:g} mm in {clean:.3%} of frames, "
        f"deepest {rows['deepest_overlap_m'].max() * 1e3:.2f} mm",
        "rejected scenes": f"{sum(rejected.values())}" + (f" ({why})" if why else ""),
    }


def penetration(track: Track) -> Float[np.ndarray, " frames"]:
    """Deepest overlap (m) in each frame: of bodies that are not one piece, and of bodies with the tool."""
    scene = track.scene
    deepest = np.zeros(len(track.times))
    down = np.flatnonzero(track.down)
    deepest[down] = -scene.tool_gaps(track.poses[down, 0], track.poses[down, 1:]).min(-1)
    pairs = scene.pairs_that_collide
    if pairs:
        deepest = np.maximum(deepest, -scene.pair_gaps(pairs, track.poses[:, 1:]).min(-1))
    return np.maximum(deepest, 0.0)


def _travelled(before: np.ndarray, after: np.ndarray) -> Float[np.ndarray, " bodies"]:
    return np.hypot(*(after - before)[1:, :2].T)
