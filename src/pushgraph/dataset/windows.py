"""Training samples: windows of consecutive frames of one push, drawn at random from a dataset."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int

from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import DatasetError

SHARD = 64
"""Trajectories that are read from disk together."""


class WindowBatch(NamedTuple):
    """A batch of windows. Node 0 is the robot; rows beyond a window's own `nodes` are zero.

    trajectory: index in the dataset. start: the window's first frame in its trajectory. push_start: whether
    that is the first frame of a push. poses: x (m), y (m), yaw (rad) in the window's frames. initial_poses:
    those at the first frame of the trajectory, the reference of joint memory.
    """

    trajectory: Int[np.ndarray, " batch"]
    start: Int[np.ndarray, " batch"]
    push_start: Bool[np.ndarray, " batch"]
    nodes: Int[np.ndarray, " batch"]
    poses: Float32[np.ndarray, "batch frames nodes 3"]
    initial_poses: Float32[np.ndarray, "batch nodes 3"]


class WindowSampler:
    """Draws batches of windows; batch `step` depends on nothing but the dataset, the settings and the step.

    So training resumes where it stopped, and several processes draw different batches from different seeds.
    A dataset larger than `memory` (bytes) is read in pools of random shards; each pool serves about as many
    windows as it has frames, then makes room for the next.
    """

    def __init__(
        self, dataset: Dataset, frames: int = 6, batch: int = 512, seed: int = 0, memory: int = 4 * 2**30
    ) -> None:
        for name, value, least in (
            ("frames", frames, 1),
            ("batch", batch, 1),
            ("seed", seed, 0),
            ("memory", memory, 1),
        ):
            if value < least:
                raise DatasetError(f"{name}: must be at least {least}, got {value}")
        self.dataset, self.frames, self.batch_size, self.seed = dataset, frames, batch, seed
        shards = -(-len(dataset) // SHARD)
        # A frame costs its poses, and the index of its row and window.
        size = 12 * int(dataset.pose_offset[-1]) + 24 * int(dataset.frame_offset[-1])
        self.pools = min(shards, -(-size // memory))
        self.steps_per_pool = max(1, int(dataset.frame_offset[-1]) // self.pools // batch)
        self._shards = shards
        self._loaded: tuple[int, _Pool] | None = None

    def batch(self, step: int) -> WindowBatch:
        """Batch number `step` (from 0)."""
        number = 0 if self.pools == 1 else step // self.steps_per_pool
        if self._loaded is None or self._loaded[0] != number:
            self._loaded = None
            self._loaded = number, self._load(number)
        rng = np.random.default_rng([self.seed, 1, step])
        return self._loaded[1].draw(rng, self.batch_size)

    def _load(self, number: int) -> "_Pool":
        epoch, part = divmod(number, self.pools)
        order = np.random.default_rng([self.seed, 0, epoch]).permutation(self._shards)
        chosen = np.sort(np.array_split(order, self.pools)[part])
        first = chosen * SHARD
        last = np.minimum(first + SHARD, len(self.dataset))
        stretches = [self.dataset.columns(a, b) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
        trajectories = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
        return _Pool(stretches, trajectories, self.frames)


def first_frames(
    push: Int[np.ndarray, " all"], owner: Int[np.ndarray, " all"], frames: int
) -> tuple[Int[np.ndarray, " windows"], Bool[np.ndarray, " all"]]:
    """First frames of all windows of so many frames of one push, and whether each frame is the first of a push.

    push: which is under way in every frame of several trajectories. owner: the trajectory of each. Raises DatasetError
    if there is no such window.
    """
    before = np.concatenate(([-2], push[:-1]))
    push_start = (push != before) | (owner != np.concatenate(([-1], owner[:-1])))
    last = np.arange(len(push)) + frames - 1
    inside = last < len(push)
    last = np.where(inside, last, 0)
    windows = np.flatnonzero(inside & (push >= 0) & (push[last] == push) & (owner[last] == owner))
    if not len(windows):
        raise DatasetError(f"no push lasts {frames} frames; draw shorter windows")
    return windows, push_start


class _Pool:
    """Trajectories in memory, and every window in them."""

    def __init__(self, stretches: list[Columns], trajectories: np.ndarray, frames: int) -> None:
        self._poses = np.concatenate([stretch.poses for stretch in stretches])
        push = np.concatenate([stretch.push for stretch in stretches])
        frame_counts = np.concatenate([np.diff(stretch.frame_offset) for stretch in stretches])
        row_counts = np.concatenate([np.diff(stretch.pose_offset) for stretch in stretches])
        self._trajectories, self._frames = trajectories, frames
        self._nodes = row_counts // frame_counts
        self._first_frame = np.cumsum(frame_counts) - frame_counts
        self._first_row = np.cumsum(row_counts) - row_counts
        self._owner = np.repeat(np.arange(len(trajectories), dtype=np.int32), frame_counts)
        self._windows, self._push_start = first_frames(push, self._owner, frames)
        self._drawable, first, count = np.unique(self._owner[self._windows], return_index=True, return_counts=True)
        self._first_window, self._window_count = first, count

    def draw(self, rng: np.random.Generator, batch: int) -> WindowBatch:
        # Trajectories alike, however long: slow pushes have many more frames, but no more to teach.
        chosen = rng.integers(len(self._drawable), size=batch)
        frame = self._windows[self._first_window[chosen] + rng.integers(self._window_count[chosen])]
        owner = self._owner[frame]
        nodes, first_row = self._nodes[owner], self._first_row[owner]
        start = frame - self._first_frame[owner]
        row = first_row + start * nodes
        return WindowBatch(
            trajectory=self._trajectories[owner],
            start=start,
            push_start=self._push_start[frame],
            nodes=nodes,
            poses=self._gather(row, nodes, self._frames),
            initial_poses=self._gather(first_row, nodes, 1)[:, 0],
        )

    def _gather(self, row: np.ndarray, nodes: np.ndarray, frames: int) -> np.ndarray:
        widest = int(nodes.max())
        frame, node = np.divmod(np.arange(frames * widest), widest)
        if (nodes == widest).all():
            return self._poses.take(row[:, None] + np.arange(frames * widest), 0).reshape(len(row), frames, widest, 3)
        real = node < nodes[:, None]
        rows = np.where(real, row[:, None] + frame * nodes[:, None] + node, 0)
        poses = np.where(real[..., None], self._poses.take(rows, 0), np.float32(0))
        return poses.reshape(len(row), frames, widest, 3)
