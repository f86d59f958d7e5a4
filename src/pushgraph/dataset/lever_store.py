"""Datasets of lever-ups on disk, laid out flat: see `pushgraph.dataset.ragged`.

/poses         [rows, 7]  float32  x, y, z (m), quaternion w, x, y, z; for each frame one row a node, node 0 the tool
/pose_offset   [count+1]  int64    first row of each interaction in /poses
/scenes        [count]    string   JSON scene with the path of its tool
/side          [count]    string   from which side the board is levered
/summary       [count]    compound what happened in each interaction
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import h5py
import numpy as np

from pushgraph import pose_3d
from pushgraph.dataset.ragged import Column, Layout, RaggedFile, flat
from pushgraph.errors import TrackError
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import RAISED, LeverTrack
from pushgraph.simulation.lever_setup import SIDES, Interaction

COLUMNS = np.dtype(
    [
        ("frames", "i4"),
        ("ledge", "?"),
        ("raised", "?"),
        ("rise_m", "f4"),
        ("highest_rise_m", "f4"),
        ("displacement_m", "f4"),
        ("rotation_rad", "f4"),
        ("deepest_overlap_m", "f4"),
        ("rejected", "i4"),
    ]
)
"""One row an interaction. ledge: whether one stands at the side that is levered; the rest at the end, or the most."""
LAYOUT = Layout(
    format="pushgraph.lever-dataset",
    version=1,
    columns={
        "poses": Column(np.float32, "pose_offset", 7, "x, y, z (m), quaternion w, x, y, z"),
        "scenes": Column(h5py.string_dtype()),
        "side": Column("S5"),
        "summary": Column(COLUMNS),
    },
    measured_by={"pose_offset": "poses"},
)


@dataclass(frozen=True)
class LeverColumns:
    """Consecutive interactions as the flat arrays of the file."""

    poses: np.ndarray
    scenes: np.ndarray
    side: np.ndarray
    summary: np.ndarray
    pose_offset: np.ndarray

    @classmethod
    def of(cls, interactions: Sequence[Interaction]) -> "LeverColumns":
        """Lay interactions out flat."""
        return cls(
            **flat([interaction.track for interaction in interactions]),
            side=np.array([interaction.side.encode() for interaction in interactions], dtype="S5"),
            summary=np.array([summarize(interaction) for interaction in interactions], COLUMNS),
        )


class LeverDataset(RaggedFile):
    """A dataset of lever-ups open for reading; `len` and indexing by interaction."""

    layout, stretch = LAYOUT, LeverColumns

    def __getitem__(self, index: int) -> LeverTrack:
        """The track of one interaction, its scene checked when it was written."""
        index = self.place(index)
        poses = self.columns(index, index + 1).poses.astype(np.float64)
        with self.naming(index):
            scene = LeverScene.from_json(self.scene_text(index), "scene", trusted=True)
            nodes = 1 + len(scene.bodies)
            if len(poses) % nodes:
                raise TrackError(f"{len(poses)} rows of poses are no frames of {nodes} nodes")
            return LeverTrack(scene, pose_3d.normalized(poses).reshape(-1, nodes, 7))

    def scene(self, index: int) -> LeverScene:
        """The scene of one interaction, with the path of its tool."""
        return LeverScene.from_json(self.scene_text(index), f"{self.path}: scene {index}", trusted=True)

    @property
    def side(self) -> np.ndarray:
        """From which side each board is levered."""
        with self._reading():
            return self.entries["side"].astype(str)


def summarize(interaction: Interaction) -> np.ndarray:
    """One row of COLUMNS."""
    track = interaction.track
    row = np.zeros((), COLUMNS)
    row["frames"] = len(track.poses)
    row["ledge"], row["raised"] = interaction.ledge, track.raised
    row["rise_m"], row["highest_rise_m"] = track.rise[-1], track.rise.max()
    row["displacement_m"] = np.linalg.norm(track.board[-1, :3] - track.board[0, :3])
    row["rotation_rad"] = pose_3d.rotation_error(track.board[-1], track.board[0])
    row["deepest_overlap_m"], row["rejected"] = track.penetration.max(), interaction.rejected
    return row


def table(rows: np.ndarray) -> Mapping[str, str]:
    """Closing table of a dataset: a line of text for each thing a user wants to know of it."""
    moved, turned = 1e3 * rows["displacement_m"], np.degrees(rows["rotation_rad"])
    was_raised = (rows["highest_rise_m"] >= RAISED).mean()
    return {
        "interactions": f"{len(rows)} ({len(rows) / len(SIDES):g} drives)",
        "frames": f"{rows['frames'].sum()}",
        "with a ledge at the side": f"{rows['ledge'].mean():.1%}",
        "raised": f"{rows['raised'].mean():.1%} at the end, {was_raised:.1%} on the way, by {RAISED * 1e3:g} mm",
        "board": f"moves by {np.median(moved):.1f} mm and turns by {np.median(turned):.1f} degrees in the median",
        "penetration": f"at most {rows['deepest_overlap_m'].max() * 1e3:.3f} mm",
        "rejected": f"{rows['rejected'].sum()} (the board was crushed)",
    }
