"""Tracks side by side as tensors, and beliefs that watch them."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pushgraph.belief import BeliefModel, Watch
from pushgraph.graph.scene_batch import Batch, SceneBatch, map_tensors
from pushgraph.track import Track


class Recording(NamedTuple):
    """The first frames of tracks with equally many bodies; shorter tracks go on as they ended, the tool lifted.

    tool: pose_world_from_tool. down: whether it is down on the table. lengths: frames that each track truly has.
    wrench: what a sensor says of the force (N) and moment (N m) of the bodies on the tool; None if there is no sensor.
    """

    tool: Float[Tensor, "batch frames 3"]
    bodies: Float[Tensor, "batch frames bodies 3"]
    down: Bool[Tensor, "batch frames"]
    lengths: Int[Tensor, " batch"]
    wrench: Float[Tensor, "batch frames 3"] | None = None


def record(tracks: Sequence[Track], frames: int) -> Recording:
    """Stack the first frames of tracks."""
    lengths = [min(frames, len(track.times)) for track in tracks]
    beyond = [(0, frames - length) for length in lengths]
    poses = [np.pad(t.poses[:frames], (rest, (0, 0), (0, 0)), "edge") for t, rest in zip(tracks, beyond, strict=True)]
    down = [np.pad(track.down[:frames], rest) for track, rest in zip(tracks, beyond, strict=True)]
    nodes = torch.from_numpy(np.stack(poses))
    return Recording(nodes[:, :, 0], nodes[:, :, 1:], torch.from_numpy(np.stack(down)), torch.tensor(lengths))


def watch(model: BeliefModel, scenes: SceneBatch, recording: Recording) -> Iterator[Watch]:
    """Observe one frame after the other."""
    everything = torch.ones_like(recording.bodies[:, 0, :, 0], dtype=torch.bool)
    watched = None
    frames = zip(recording.bodies.unbind(1), recording.tool.unbind(1), recording.down.unbind(1), strict=True)
    for frame, seen in enumerate(frames):
        if watched is None:
            watched = model.begin(scenes, *seen, everything)
        elif recording.wrench is None:
            watched = model.observe(watched, *seen, everything)
        else:
            watched = model.observe(watched, *seen, everything, wrench=recording.wrench[:, frame])
        yield watched


def ask(
    question: Callable[[Watch], Batch],
    model: BeliefModel,
    scenes: SceneBatch,
    seen: Recording,
    times: Int[Tensor, "batch times"],
) -> tuple[Batch, Watch]:
    """Answers about each scene after its frames `times`, [batch times ...], and what was watched in the end."""
    wanted = set(times.flatten().tolist())
    answers_at = {}
    for frame, watched in enumerate(watch(model, scenes, seen)):
        if frame in wanted:
            answers_at[frame] = question(watched)
    place = {frame: k for k, frame in enumerate(answers_at)}
    at_times = torch.tensor([[place[time] for time in row] for row in times.tolist()])
    batch = torch.arange(len(times))[:, None]
    return map_tensors(lambda *answers: torch.stack(answers)[at_times, batch], *answers_at.values()), watched
