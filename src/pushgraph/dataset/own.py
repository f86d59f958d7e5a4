"""Datasets of one's own tracks: simulated here or elsewhere, or recorded."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from pushgraph import pose
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import DatasetError, SceneError, TrackError
from pushgraph.parting import parted
from pushgraph.scene_at import scene_at
from pushgraph.scene_parts import in_parts
from pushgraph.simulation.setups import Trajectory
from pushgraph.track import LIFTED, Track

OWN = "own"
"""The setup of such datasets, and the density and kind of all in them."""
AS_WRITTEN = 1e-6
"""A track starts where its scene says if no number of a pose is off by more (m, rad)."""
MOST_PUSHES = np.iinfo(np.int16).max


def write_dataset(tracks: Iterable[Track], path: str | os.PathLike) -> Path:
    """Write tracks as a dataset to train on and to evaluate with; whole or not at all, the same tracks the same bytes.

    Tracks may differ in bodies, frames and rates. What is stored of each is what training needs: frames of 0.05 s
    (`Track.at_frames`) in which every body is seen, as float32. Where a body is not, the track is cut into several,
    and what is left without a push is left out. Polygons become the rigid group of their parts, as the networks know
    them; a yaw that cannot be known is 0. A scene whose bodies were not where it says is stored as of its first frame,
    without its pushes. Raises DatasetError, which names track, body and time, if nothing can be stored of a track.
    """
    stretches = []
    for number, track in enumerate(tracks):
        if not isinstance(track, Track):
            raise DatasetError(
                f"tracks[{number}]: must be a Track, got {type(track).__name__}; datasets of lever-ups are made by "
                "pushgraph generate lever-up"
            )
        try:
            stretches += [Columns.of([Trajectory(one, OWN, OWN, Counter())]) for one in storable(track)]
        except (SceneError, TrackError) as error:
            raise DatasetError(f"tracks[{number}]: {error}") from None
    if not stretches:
        raise DatasetError("tracks: at least one is needed")
    bodies = max(int(one.pose_offset[-1] // one.frame_offset[-1]) - 1 for one in stretches)
    Dataset.write(path, Recipe(setup=OWN, objects=bodies, seed=0, first=0, count=len(stretches)), stretches)
    return Path(path)


def storable(track: Track) -> list[Track]:
    """What a dataset stores of a track; raises TrackError if that is nothing, SceneError if bodies start off the table.

    See `write_dataset`.
    """
    if track.push.max() > MOST_PUSHES:
        raise TrackError(f"push {track.push.max()}: a dataset counts pushes up to {MOST_PUSHES:,}")
    framed = _in_parts(track.at_frames())
    found = [_stretch(framed, some) for some in _runs(np.all(framed.seen, axis=1)) if _pushes(framed, some)]
    if found:
        return found
    if not framed.down.any():
        raise TrackError(f"the tool is never down, so there is no push to learn from; valid pushes are not {LIFTED}")
    frame, node = np.argwhere(~framed.seen & framed.down[:, None])[0]
    raise TrackError(
        f"there is no push in which every body is seen in two frames in a row: {framed.nodes[node]!r} is not at "
        f"{framed.times[frame]:g} s"
    )


def _pushes(track: Track, some: slice) -> bool:
    """Whether there are two frames of one push."""
    push = track.push[some]
    return bool(((push[1:] == push[:-1]) & (push[1:] != LIFTED)).any())


def _runs(chosen: Bool[np.ndarray, " frames"]) -> Iterator[slice]:
    edges = np.flatnonzero(np.diff(chosen.astype(np.int8), prepend=0, append=0))
    yield from (slice(first, last) for first, last in edges.reshape(-1, 2).tolist())


def _stretch(track: Track, some: slice) -> Track:
    """Some frames as a track of its own, its scene as of the first of them."""
    poses = track.poses[some].copy()
    poses[..., 2] = np.nan_to_num(poses[..., 2])
    scene, start = track.scene, poses[0, 1:]
    if not np.allclose(start, scene.poses_world_from_body, rtol=0, atol=AS_WRITTEN) or len(poses) < len(track.times):
        scene = scene.replace(pushes=())
        scene = scene_at(scene, parted(scene, start))
    wrench = None if track.wrench is None else track.wrench[some]
    return Track(scene, track.times[some] - track.times[some.start], poses, track.push[some], track.seen[some], wrench)


def _in_parts(track: Track) -> Track:
    """The same track, each polygon replaced by its parts."""
    apart = in_parts(track.scene)
    if apart.scene is track.scene:
        return track
    for index, body in enumerate(track.scene.bodies):
        if int(apart.first[index]) in apart.patches:
            raise TrackError(
                f"body {body.name!r}: a polygon with a support cannot be stored: its parts would press elsewhere; "
                "leave out the support, or make the body of cuboids and cylinders in a rigid group"
            )
    owner = apart.owner
    start, of_parts = track.scene.poses_world_from_body, apart.scene.poses_world_from_body
    pose_body_from_part = pose.relative(start[owner], of_parts)
    poses = pose.compose(np.nan_to_num(track.poses[:, 1 + owner]), pose_body_from_part)
    nodes = np.concatenate(([0], 1 + owner))
    return Track(
        apart.scene,
        track.times,
        np.concatenate((track.poses[:, :1], poses), 1),
        track.push,
        track.seen[:, nodes],
        track.wrench,
    )
