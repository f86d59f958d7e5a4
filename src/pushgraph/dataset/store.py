"""Datasets on disk: one HDF5 file of ragged tracks, their scenes inside, laid out flat so that reads are fast.

/poses         [rows, 3]  float32  x (m), y (m), yaw (rad); for each frame one row a node, node 0 the robot
/push          [frames]   int16    push under way, -1 while the tool is lifted
/wrench        [frames, 3] float32 force (N, world frame) and moment (N m) of the bodies on the tool, NaN: not measured
/pose_offset   [count+1]  int64    first row of each trajectory in /poses
/frame_offset  [count+1]  int64    first frame of each trajectory in /push
/scenes        [count]    string   JSON scene with its pushes
/density       [count]    string   dense or sparse; own in datasets of one's own tracks
/kind          [count]    string   paper, one of the kinds of the training mixture, or own
/summary       [count]    compound what happened in each trajectory
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import h5py
import numpy as np

from pushgraph.dataset.ragged import Column, Layout, RaggedFile, flat
from pushgraph.dataset.summary import COLUMNS, summarize
from pushgraph.errors import DatasetError
from pushgraph.scene import Scene
from pushgraph.simulation.setups import Trajectory
from pushgraph.track import FRAME, Track
from pushgraph.wrench import present

LAYOUT = Layout(
    format="pushgraph.dataset",
    version=2,
    columns={
        "poses": Column(np.float32, "pose_offset", 3, "x (m), y (m), yaw (rad)"),
        "push": Column(np.int16, "frame_offset"),
        "wrench": Column(np.float32, "frame_offset", 3, "force (N), world; moment (N m)"),
        "scenes": Column(h5py.string_dtype()),
        "density": Column("S6"),
        "kind": Column("S12"),
        "summary": Column(COLUMNS),
    },
    measured_by={"pose_offset": "poses", "frame_offset": "push"},
)


@dataclass(frozen=True)
class Columns:
    """Consecutive trajectories as the flat arrays of the file; see the top of this module."""

    poses: np.ndarray
    push: np.ndarray
    wrench: np.ndarray
    pose_offset: np.ndarray
    frame_offset: np.ndarray
    scenes: np.ndarray
    density: np.ndarray
    kind: np.ndarray
    summary: np.ndarray

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory]) -> "Columns":
        """Lay trajectories out flat."""
        tracks = [trajectory.track for trajectory in trajectories]
        return cls(
            **flat(tracks),
            push=np.concatenate([track.push for track in tracks]).astype(np.int16),
            wrench=np.concatenate([_wrench(track) for track in tracks]).astype(np.float32),
            frame_offset=np.cumsum([0] + [len(track.push) for track in tracks]),
            density=np.array([trajectory.density.encode() for trajectory in trajectories], dtype="S6"),
            kind=np.array([trajectory.kind.encode() for trajectory in trajectories], dtype="S12"),
            summary=np.array([summarize(trajectory) for trajectory in trajectories], COLUMNS),
        )


class Dataset(RaggedFile):
    """A dataset open for reading; `len` and indexing by trajectory. Raises DatasetError if the file is not whole."""

    layout, stretch = LAYOUT, Columns

    def __init__(self, path: str | os.PathLike) -> None:
        super().__init__(path)
        self.pose_offset, self.frame_offset = self.offsets["pose_offset"], self.offsets["frame_offset"]
        with self._reading():
            self.density: np.ndarray = self.entries["density"].astype(str)
            self.kind: np.ndarray = self.entries["kind"].astype(str)
        if (np.diff(self.pose_offset) % np.diff(self.frame_offset)).any():
            raise DatasetError(f"{path}: pose_offset: must rise by a row a node and frame, see frame_offset")

    def __getitem__(self, index: int) -> Track:
        """The track of one trajectory, its scene checked when it was written."""
        index = self.place(index)
        stretch = self.columns(index, index + 1)
        scene = self.scene(index)
        poses = stretch.poses.astype(np.float64).reshape(len(stretch.push), -1, 3)
        with self.naming(index):
            return Track(
                scene=scene,
                times=np.arange(len(poses)) * FRAME,
                poses=poses,
                push=stretch.push.astype(np.int64),
                seen=np.ones(poses.shape[:2], dtype=bool),
                wrench=stretch.wrench.astype(np.float64) if present(stretch.wrench).any() else None,
            )

    def pose_rows(self, first: int, last: int) -> np.ndarray:
        """Rows first to last - 1 of /poses; see the top of this module."""
        with self._reading():
            return self._file["poses"][first:last]

    def scene(self, index: int) -> Scene:
        """The scene of one trajectory, with its pushes."""
        with self.naming(index):
            return Scene.from_json(self.scene_text(index), "scene", trusted=True)


def _wrench(track: Track) -> np.ndarray:
    return np.full((len(track.times), 3), np.nan) if track.wrench is None else track.wrench
