"""Training samples for belief: long stretches of trajectories, watched from their start or from that of a push."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from pushgraph.dataset.store import Dataset
from pushgraph.errors import DatasetError
from pushgraph.scene import Scene
from pushgraph.track import LIFTED

FROM_THE_START = 0.5
"""Share of the sequences that begin with their trajectory; the others begin with one of its pushes."""


class SequenceBatch(NamedTuple):
    """Sequences side by side. Node 0 is the robot; rows beyond a scene's own nodes are zero.

    A trajectory that ends before its sequence does stays as it is, the tool lifted; `lasts` is False there. wrench: of
    the bodies on the tool (N, N m).
    """

    scenes: list[Scene]
    poses: Float32[np.ndarray, "batch frames nodes 3"]
    down: Bool[np.ndarray, "batch frames"]
    lasts: Bool[np.ndarray, "batch frames"]
    wrench: Float32[np.ndarray, "batch frames 3"]


class SequenceSampler:
    """Draws batches of sequences; batch `step` depends on nothing but the dataset, the settings and the step."""

    def __init__(self, dataset: Dataset, frames: int, batch: int, seed: int = 0) -> None:
        for name, value, least in (("frames", frames, 2), ("batch", batch, 1), ("seed", seed, 0)):
            if value < least:
                raise DatasetError(f"{name}: must be at least {least}, got {value}")
        self.dataset, self.frames, self.batch_size, self.seed = dataset, frames, batch, seed

    def batch(self, step: int) -> SequenceBatch:
        """Batch number `step` (from 0)."""
        rng = np.random.default_rng([self.seed, 2, step])
        drawn = [self._draw(rng) for _ in range(self.batch_size)]
        widest = max(poses.shape[1] for _, poses, *_ in drawn)
        poses = np.zeros((self.batch_size, self.frames, widest, 3), np.float32)
        down = np.zeros((self.batch_size, self.frames), bool)
        lasts = np.zeros((self.batch_size, self.frames), bool)
        wrenches = np.zeros((self.batch_size, self.frames, 3), np.float32)
        for k, (_, some, push, wrench) in enumerate(drawn):
            poses[k, : len(some), : some.shape[1]] = some
            poses[k, len(some) :, : some.shape[1]] = some[-1]
            down[k, : len(some)] = push != LIFTED
            lasts[k, : len(some)] = True
            wrenches[k, : len(some)] = wrench
        return SequenceBatch([scene for scene, *_ in drawn], poses, down, lasts, wrenches)

    def _draw(self, rng: np.random.Generator) -> tuple[Scene, np.ndarray, np.ndarray, np.ndarray]:
        index = int(rng.integers(len(self.dataset)))
        stretch = self.dataset.columns(index, index + 1)
        starts = np.flatnonzero((stretch.push != LIFTED) & (np.diff(stretch.push, prepend=-2) != 0))
        first = 0 if rng.random() < FROM_THE_START else int(rng.choice(starts))
        poses = stretch.poses.reshape(len(stretch.push), -1, 3)
        last = first + self.frames
        return self.dataset.scene(index), poses[first:last], stretch.push[first:last], stretch.wrench[first:last]
