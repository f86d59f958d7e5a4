"""Training windows for a `torch.utils.data.DataLoader`."""

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int
from torch import Tensor

from pushgraph.dataset.store import Dataset
from pushgraph.dataset.windows import first_frames
from pushgraph.errors import DatasetError
from pushgraph.scene import Scene

IN_MEMORY = 2**30
"""Poses of no more bytes than this are kept in memory, by every process its own; of larger files they are read again
and again."""


class Window(NamedTuple):
    """A window, or a batch of them once torch's own collate has stacked the fields: no `collate_fn` is needed.

    trajectory: index in the dataset. start: the window's first frame in its trajectory. push_start: whether that is the
    first of a push. nodes: how many there are, the robot first. poses: x (m), y (m), yaw (rad) in the window's frames;
    initial_poses: at the first frame of the trajectory. Their rows beyond `nodes` are zero, as many as the largest
    scene of the dataset needs.
    """

    trajectory: Int[Tensor, "*batch"]
    start: Int[Tensor, "*batch"]
    push_start: Bool[Tensor, "*batch"]
    nodes: Int[Tensor, "*batch"]
    poses: Float32[Tensor, "*batch frames most 3"]
    initial_poses: Float32[Tensor, "*batch most 3"]


class WindowDataset(torch.utils.data.Dataset[Window]):
    """Windows of consecutive frames of one push, by index.

    An item depends on file, settings and index alone, whatever process reads it: any number of workers give the same
    batches. The file is opened when a process first reads an item; what is handed to workers is small.
    """

    def __init__(self, path: str | os.PathLike, frames: int = 6, count: int | None = None, seed: int = 0) -> None:
        """Look through a dataset; it is closed again.

        count: draw so many windows at random, by seed and index, from all trajectories alike; by default every window
        is there once, in the order of the file. Raises DatasetError if the file is no dataset, a number is not valid,
        or no push lasts so long.
        """
        for name, value, least in (
            ("frames", frames, 1),
            ("count", count, 1),
            ("seed", seed, 0),
        ):
            if value is not None and value < least:
                raise DatasetError(f"{name}: must be at least {least}, got {value}")
        self.path, self.frames, self.seed = Path(path), frames, seed
        with Dataset(path) as dataset:
            push = dataset.columns(0, len(dataset)).push
            self._frame_offset, self._row_offset = dataset.frame_offset, dataset.pose_offset
        lengths = np.diff(self._frame_offset)
        owner = np.repeat(np.arange(len(lengths), dtype=np.int32), lengths)
        self._first, push_start = first_frames(push, owner, frames)
        self._push_start = push_start[self._first]
        self._nodes = np.diff(self._row_offset) // lengths
        self._drawable, begins, self._many = np.unique(owner[self._first], return_index=True, return_counts=True)
        self._begins, self._count = begins, len(self._first) if count is None else count
        self._drawn = count is not None
        self._opened: tuple[int, Dataset, Any] | None = None

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Window:
        """One window; IndexError beyond the last."""
        if not -len(self) <= index < len(self):
            raise IndexError(f"window {index} of {len(self)}")
        window = self._window(index % len(self))
        frame = int(self._first[window])
        trajectory = int(np.searchsorted(self._frame_offset, frame, "right")) - 1
        start, nodes = frame - int(self._frame_offset[trajectory]), int(self._nodes[trajectory])
        row = int(self._row_offset[trajectory])
        return Window(
            torch.tensor(trajectory),
            torch.tensor(start),
            torch.tensor(bool(self._push_start[window])),
            torch.tensor(nodes),
            self._poses(row + start * nodes, self.frames, nodes),
            self._poses(row, 1, nodes)[0],
        )

    def scene(self, trajectory: int) -> Scene:
        """The scene of a trajectory: shapes, masses, joints, tool."""
        return self._dataset[0].scene(trajectory)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_opened": None}

    def _window(self, index: int) -> int:
        if not self._drawn:
            return index
        rng = np.random.default_rng([self.seed, 3, index])
        chosen = int(rng.integers(len(self._drawable)))
        return int(self._begins[chosen] + rng.integers(self._many[chosen]))

    @property
    def _dataset(self) -> tuple[Dataset, Any]:
        """The file as this process has it open, and its poses: HDF5 files do not survive a fork."""
        if self._opened is None or self._opened[0] != os.getpid():
            dataset = Dataset(self.path)
            rows = int(dataset.pose_offset[-1])
            small = 12 * rows <= IN_MEMORY
            self._opened = os.getpid(), dataset, dataset.pose_rows(0, rows) if small else None
        return self._opened[1:]

    def _poses(self, row: int, frames: int, nodes: int) -> Float32[Tensor, "frames most 3"]:
        dataset, kept = self._dataset
        last = row + frames * nodes
        rows = dataset.pose_rows(row, last) if kept is None else kept[row:last]
        poses = np.zeros((frames, int(self._nodes.max()), 3), np.float32)
        poses[:, :nodes] = rows.reshape(frames, nodes, 3)
        return torch.from_numpy(poses)
