"""Tracks: poses over time of a scene's end-effector and bodies, simulated, predicted or measured."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from pushgraph.body import ROBOT
from pushgraph.errors import SceneError, TrackError
from pushgraph.notebook import png_of
from pushgraph.scene import Scene
from pushgraph.spread import UNITS, Spread
from pushgraph.track_csv import load_csv, save_csv
from pushgraph.track_frames import FRAME, LIFTED, ON_TIME, Frames
from pushgraph.track_hdf5 import StoredTrack, load_hdf5, save_hdf5
from pushgraph.track_resampling import in_frames, longest_bridge
from pushgraph.wrench import check_whole

__all__ = ["FRAME", "LIFTED", "ON_TIME", "Track"]

MOST_PUSHES = 1_000_000
"""Of a track whose scene does not say which pushes were made."""


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of node 0, the end-effector, and of the scene's bodies in order, in the world frame.

    times: seconds, rising. poses: x (m), y (m), yaw (rad, not wrapped). push: which of the scene's pushes is under way
    (any number from 0 on if it has none), LIFTED between them. seen: False where a camera lost the node; its pose is
    NaN there. The yaw alone may be NaN for bodies whose yaw is not known. wrench: what the bodies exert on the tool, on
    average since the frame before: force (N, world frame) and moment about the end-effector (N m), all NaN where there
    is no reading; None if it was not measured.
    spread: how far off predicted poses of the bodies may be, [frames bodies]; None if nothing is stated.
    Raises TrackError if anything does not fit.
    """

    scene: Scene
    times: Float[np.ndarray, " frames"]
    poses: Float[np.ndarray, "frames nodes 3"]
    push: Int[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames nodes"]
    wrench: Float[np.ndarray, "frames 3"] | None = None
    spread: Spread | None = None

    def __post_init__(self) -> None:
        frames, nodes = len(self.times), 1 + len(self.scene.bodies)
        if frames == 0:
            raise TrackError("a track needs at least one frame")
        for name, shape in (("poses", (frames, nodes, 3)), ("push", (frames,)), ("seen", (frames, nodes))):
            if getattr(self, name).shape != shape:
                raise TrackError(f"{name}: shape must be {shape}, got {getattr(self, name).shape}")
        if self.wrench is not None:
            check_whole(self.wrench, self.times)
        if self.spread is not None:
            for name, values in self.spread._asdict().items():
                if values.shape != (frames, nodes - 1):
                    raise TrackError(f"spread, {name}: shape must be {(frames, nodes - 1)}, got {values.shape}")
        self._check_times()
        self._check_poses()
        most = len(self.scene.pushes) or MOST_PUSHES
        valid = (self.push == LIFTED) | ((self.push >= 0) & (self.push < most))
        if not valid.all():
            frame = int(np.argmin(valid))
            raise TrackError(
                f"push {self.push[frame]} at frame {frame}: valid are {LIFTED} (lifted) and the scene's pushes, "
                f"0 to {most - 1}"
            )

    def _check_times(self) -> None:
        if not np.isfinite(self.times).all():
            raise TrackError(f"time at frame {int(np.argmin(np.isfinite(self.times)))} is not finite")
        steps = np.diff(self.times)
        if (steps <= 0).any():
            frame = int(np.argmax(steps <= 0)) + 1
            raise TrackError(
                f"times must rise: frame {frame} has {self.times[frame]:g} s after {self.times[frame - 1]:g} s"
            )

    def _check_poses(self) -> None:
        finite = np.isfinite(self.poses)
        yaw_optional = np.array([False, *(not body.yaw_known for body in self.scene.bodies)])
        finite[..., 2] |= yaw_optional & np.isnan(self.poses[..., 2])
        bad = self.seen & ~(finite[..., 0] & finite[..., 1] & finite[..., 2])  # `all` over so few is ten times slower
        if bad.any():
            frame, node = np.argwhere(bad)[0]
            raise TrackError(
                f"pose of {self.nodes[node]!r} at {self.times[frame]:g} s is {self.poses[frame, node].tolist()}; "
                "it must be finite, or the node marked as not seen (only a body with yaw_known false may lack yaw)"
            )
        if not self.seen[:, 0].all():
            raise TrackError(f"{ROBOT!r} is missing at {self.times[int(np.argmin(self.seen[:, 0]))]:g} s")

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return (ROBOT, *self.scene.names)

    @property
    def down(self) -> Bool[np.ndarray, " frames"]:
        """Whether the tool is down on the table."""
        return self.push != LIFTED

    @property
    def push_start(self) -> Bool[np.ndarray, " frames"]:
        """Whether a frame is the first of a push."""
        return self.down & (self.push != np.concatenate(([LIFTED], self.push[:-1])))

    @property
    def gaps(self) -> dict[str, list[tuple[float, float]]]:
        """For every node that was lost, the stretches (first and last time, s) in which it was not seen."""
        lost: dict[str, list[tuple[float, float]]] = {}
        for node, name in enumerate(self.nodes):
            missing = np.concatenate(([False], ~self.seen[:, node], [False]))
            edges = np.flatnonzero(missing[1:] != missing[:-1]).reshape(-1, 2)
            if len(edges):
                lost[name] = [(float(self.times[a]), float(self.times[b - 1])) for a, b in edges]
        return lost

    def at_frames(self) -> "Track":
        """The same track in frames of 0.05 s; itself if it is so already.

        Every push begins with a frame at its first sample. A pause, or another push without a lift between, is cut
        out: one lifted frame stands for it, in which bodies that moved meanwhile are not seen. Poses between two
        sightings are interpolated if these are no farther apart than `longest_bridge`; else the node was not seen.
        Yaws turn the shorter way. The wrench is the mean of the readings since the frame before, if there are any.
        """
        mine = self._frames
        framed = in_frames(mine)
        return self if framed is mine else Track(self.scene, *framed)

    def frames(self) -> Iterator[tuple[Float[np.ndarray, "nodes 3"], bool]]:
        """Poses of all nodes, NaN where not seen, and whether the tool is down, every 0.05 s; see `at_frames`."""
        track = self.at_frames()
        yield from zip(np.where(track.seen[..., None], track.poses, np.nan), track.down.tolist(), strict=True)

    @property
    def longest_bridge(self) -> float:
        """Seconds between two sightings across which poses are interpolated; a longer gap is a pause."""
        return longest_bridge(self.times)

    def save(self, path: str | os.PathLike) -> None:
        """Write HDF5, or CSV if the name ends in .csv; the CSV holds neither scene nor spread."""
        if Path(path).suffix.lower() == ".csv":
            save_csv(Path(path), self.nodes, self._frames)
        else:
            spread = None if self.spread is None else self.spread._asdict()
            save_hdf5(Path(path), StoredTrack(self.scene.to_json(), self.nodes, self._frames, spread), UNITS)

    @classmethod
    def load(cls, path: str | os.PathLike, scene: Scene | None = None) -> "Track":
        """Read HDF5, or CSV if the name ends in .csv; a CSV needs the scene."""
        try:
            if Path(path).suffix.lower() == ".csv":
                if scene is None:
                    raise TrackError("a CSV track does not hold its scene; pass one")
                return cls(scene, *load_csv(Path(path), (ROBOT, *scene.names)))
            stored = load_hdf5(Path(path), Spread._fields)
            scene = scene or Scene.from_json(stored.scene)
            if stored.nodes != (ROBOT, *scene.names):
                raise TrackError(f"its nodes {list(stored.nodes)} are not those of the scene, {[ROBOT, *scene.names]}")
            spread = None if stored.spread is None else Spread(**stored.spread)
            return cls(scene, *stored.frames, spread=spread)
        except (TrackError, SceneError) as error:
            raise TrackError(f"{path}: {error}") from None

    def _repr_png_(self) -> bytes | None:
        return png_of(self)

    @property
    def _frames(self) -> Frames:
        return Frames(self.times, self.poses, self.push, self.seen, self.wrench)
