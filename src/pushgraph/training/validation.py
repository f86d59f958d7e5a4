"""What validations start from: tracks of any numbers of bodies and frames, side by side."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pushgraph.dataset.store import Dataset
from pushgraph.errors import TrainingError
from pushgraph.graph.scene_batch import SceneBatch, batch_scenes, map_tensors
from pushgraph.track import Track
from pushgraph.training.processes import Processes


class Rollouts(NamedTuple):
    """The first frames of tracks. Node 0 is the robot; rows beyond a scene's own nodes are zero.

    A track that ends earlier stays as it is, the tool lifted; `lasts` is False there.
    """

    scenes: SceneBatch
    poses: Float[Tensor, "batch frames nodes 3"]
    down: Bool[Tensor, "batch frames"]
    lasts: Bool[Tensor, "batch frames"]

    @classmethod
    def of(cls, tracks: Sequence[Track], most: int) -> "Rollouts":
        """Up to so many frames of tracks."""
        frames = min(most, max(len(track.times) for track in tracks))
        scenes = batch_scenes([track.scene for track in tracks])
        poses = np.zeros((len(tracks), frames, 1 + scenes.mass.shape[1], 3), np.float32)
        down, lasts = np.zeros((2, len(tracks), frames), dtype=bool)
        for k, track in enumerate(tracks):
            last = min(frames, len(track.times))
            own = track.poses.shape[1]
            poses[k, :, :own] = track.poses[np.arange(frames).clip(max=last - 1)]
            down[k, :last], lasts[k, :last] = track.down[:last], True
        return cls(scenes, *(torch.from_numpy(values) for values in (poses, down, lasts)))

    def to(self, device: torch.device) -> "Rollouts":
        """The same on another device."""
        return map_tensors(lambda values: values.to(device), self)


def validation_tracks(data: Dataset, processes: Processes, most: int | None = None) -> list[Track]:
    """This process's share of the first `most` tracks; raises TrainingError if there are fewer than processes."""
    return [data[k] for k in validation_indices(len(data), data.path, processes, most)]


def validation_indices(count: int, path: object, processes: Processes, most: int | None = None) -> range:
    """This process's share of the first `most` of so many trajectories of a file."""
    if count < processes.count:
        raise TrainingError(
            f"validation: {path} holds {count} trajectories, which {processes.count} processes cannot share; "
            f"take at most {count}"
        )
    return range(processes.rank, min(count, most or count), processes.count)
