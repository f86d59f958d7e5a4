"""Tracks in space: poses over time of a scene's tool and boxes, simulated or predicted."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float

from pushgraph import pose_3d
from pushgraph.checksum import is_intact
from pushgraph.errors import SceneError, TrackError
from pushgraph.isolation import read_isolated
from pushgraph.lever_scene import TOOL, LeverScene, corners, depth
from pushgraph.storage import replacing_hdf5
from pushgraph.stored_array import stored, stored_names
from pushgraph.track_frames import FRAME

FORMAT = "pushgraph.lever-track"
VERSION = 1
RAISED = 0.010
"""A board is raised whose highest point is higher than at the start by this (m)."""
UNIT = 1e-5


def frame_times(scene: LeverScene) -> Float[np.ndarray, " frames"]:
    """Times of the frames (s), every 0.05 s until the path is over."""
    return np.arange(int(np.ceil(scene.duration / FRAME - 1e-9)) + 1) * FRAME


@dataclass(frozen=True, eq=False)
class LeverTrack:
    """Poses of node 0, the tool, and of the scene's boxes in order, in the world frame, every 0.05 s from 0 s on.

    poses: position (m) and unit quaternion (w, x, y, z). Raises TrackError if anything does not fit.
    """

    scene: LeverScene
    poses: Float[np.ndarray, "frames nodes 7"]

    def __post_init__(self) -> None:
        nodes = 1 + len(self.scene.bodies)
        if self.poses.ndim != 3 or len(self.poses) == 0 or self.poses.shape[1:] != (nodes, 7):
            raise TrackError(f"poses: shape must be (frames, {nodes}, 7), got {self.poses.shape}")
        faults = ~np.isfinite(self.poses).all(-1)
        with np.errstate(over="ignore"):  # what is too large to be squared is no unit quaternion either
            faults |= ~(np.abs(np.linalg.norm(self.poses[..., 3:], axis=-1) - 1) <= UNIT)
        if faults.any():
            frame, node = np.argwhere(faults)[0]
            raise TrackError(
                f"pose of {self.nodes[node]!r} at frame {frame} is {self.poses[frame, node].tolist()}; it must be "
                "finite, its quaternion of length 1"
            )

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return (TOOL, *self.scene.names)

    @property
    def times(self) -> Float[np.ndarray, " frames"]:
        """Seconds."""
        return np.arange(len(self.poses)) * FRAME

    @property
    def board(self) -> Float[np.ndarray, "frames 7"]:
        """Poses of the board."""
        return self.poses[:, 1 + self.scene.board]

    @property
    def rise(self) -> Float[np.ndarray, " frames"]:
        """How much higher the board's highest point is than at the start (m), against gravity."""
        up = -np.asarray(self.scene.gravity) / max(np.linalg.norm(self.scene.gravity), 1e-12)
        heights = (corners(self.scene.bodies[self.scene.board].size, self.board) @ up).max(-1)
        return heights - heights[0]

    @property
    def raised(self) -> bool:
        """Whether the board's highest point is higher by 10 mm at the end."""
        return bool(self.rise[-1] >= RAISED)

    @property
    def penetration(self) -> Float[np.ndarray, " frames"]:
        """How deep the board overlaps the tool or another box (m), at least 0."""
        scene, size = self.scene, self.scene.bodies[self.scene.board].size
        others = [(body.size, self.poses[:, node]) for node, body in enumerate(scene.bodies, 1) if body.fixed]
        others += [(box.size, pose_3d.compose(self.poses[:, 0], box.pose)) for box in scene.tool.boxes]
        return np.maximum(np.max([depth(size, self.board, *other) for other in others], axis=0), 0.0)

    def save(self, path: str | os.PathLike) -> None:
        """Write HDF5; the same track makes the same bytes."""
        with replacing_hdf5(path, checksum=True) as file:
            file.attrs.update(format=FORMAT, version=VERSION, frame_s=FRAME, scene=self.scene.to_json())
            file["nodes"] = list(self.nodes)
            file.create_dataset("poses", data=self.poses).attrs["unit"] = "x, y, z (m), quaternion w, x, y, z"

    @classmethod
    def load(cls, path: str | os.PathLike) -> "LeverTrack":
        """Read HDF5; raises TrackError if the file holds no such track, or is damaged."""
        path = Path(path)
        try:
            if not path.is_file():
                raise TrackError("cannot read this track: there is no such file")
            intact = is_intact(path)
            if intact is False:
                raise TrackError("cannot read this track: the file is damaged, its bytes are not those saved")
            found = contents(path) if intact else read_isolated(contents, path)
            track = cls(LeverScene.from_json(found["scene"]), found["poses"])
            if tuple(found["nodes"]) != track.nodes:
                raise TrackError(f"its nodes {found['nodes']} are not those of the scene, {list(track.nodes)}")
            return track
        except (TrackError, SceneError) as error:
            raise TrackError(f"{path}: {error}") from None
        except OSError as error:
            raise TrackError(f"{path}: cannot read this track: {error.strerror or error}") from None


def contents(path: Path) -> dict[str, Any]:
    """Scene and poses of a file."""
    with h5py.File(path, "r") as file:
        if str(file.attrs.get("format")) != FORMAT:
            raise TrackError(f"not such a track: attribute 'format' must be {FORMAT!r}")
        if str(file.attrs.get("version")) != str(VERSION):
            raise TrackError(f"track version {file.attrs.get('version')}, this pushgraph reads {VERSION}")
        if str(file.attrs.get("frame_s")) != str(FRAME):
            raise TrackError(f"attribute 'frame_s': must be {FRAME}, got {file.attrs.get('frame_s')!r}")
        scene, poses = file.attrs.get("scene"), stored(file, "poses")
        if not isinstance(scene, str) or poses.dtype.kind != "f":
            raise TrackError("its scene must be text, its poses numbers")
        return {"scene": scene, "poses": poses.astype(float), "nodes": stored_names(file, "nodes")}
