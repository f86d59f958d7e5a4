"""Prediction of scenes in space: roll out what the tool does to the board."""

import contextlib
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.device import device_of, place_of
from pushgraph.errors import CheckpointError, PredictionError
from pushgraph.graph.lever_batch import LeverState, start_lever
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.lever_scene import LeverScene
from pushgraph.lever_track import LeverTrack, frame_times
from pushgraph.network.lever_dynamics import KNOTS, LEVERS, LeverDynamics
from pushgraph.network.registry import NETWORKS
from pushgraph.scene_range import warn_of_range
from pushgraph.track_frames import FRAME


def tool_knots(scene: LeverScene, frames: int) -> Float[np.ndarray, "knots 7"]:
    """pose_world_from_tool over so many frames, KNOTS times in each, and at the end."""
    return scene.tool_poses(np.arange(frames * KNOTS + 1) * (FRAME / KNOTS))


def rollout_lever(
    dynamics: Callable[[LeverState, Tensor], LeverState], state: LeverState, tool: Float[Tensor, "batch knots 7"]
) -> Float[Tensor, "batch frames 7"]:
    """pose_world_from_board in all frames, the first being the state's. tool: see `tool_knots`."""
    poses = [state.pose]
    with contextlib.nullcontext() if torch.is_grad_enabled() else torch.inference_mode():
        for first in range(0, tool.shape[1] - 1, KNOTS):
            state = dynamics(state, tool[:, first : first + KNOTS + 1])
            poses.append(state.pose)
    return torch.stack(poses, 1)


class LeverPredictor:
    """A predictor of boards. record: how it was trained. hash: of its checkpoint."""

    def __init__(
        self, dynamics: LeverDynamics, record: Mapping[str, Any] | None = None, hash: str | None = None
    ) -> None:
        self.dynamics, self.record, self.hash = dynamics, dict(record or {}), hash
        self._warned = False

    @classmethod
    def load(cls, model: str | os.PathLike = "lever_up", device: str = "cpu") -> "LeverPredictor":
        """Load the shipped predictor, or the checkpoint in a file.

        Raises CheckpointError if there is no such file, or any part of it is not what it should be.
        """
        place = device_of(device)
        path = shipped(str(model)) if str(model) in NETWORKS and not Path(model).is_file() else Path(model)
        checkpoint = load_checkpoint(path)
        if checkpoint.kind not in LEVERS:
            raise CheckpointError(f"{path}: holds {checkpoint.kind!r}; for scenes in space valid: {', '.join(LEVERS)}")
        network = checkpoint.network.to(place).requires_grad_(False)
        return cls(cast(LeverDynamics, network), checkpoint.record, checkpoint.hash)

    @property
    def device(self) -> torch.device:
        """What is computed on; inputs may be anywhere."""
        return place_of(self.dynamics)

    def predict(self, scene: LeverScene) -> LeverTrack:
        """Predict the board frame by frame, as `simulate_lever` would record it."""
        return self.predict_many([scene])[0]

    def predict_many(self, scenes: Sequence[LeverScene]) -> list[LeverTrack]:
        """Predict many scenes side by side.

        Warns, once, of what is unlike the scenes that the predictor was checked on. Raises PredictionError if a pose is
        not finite.
        """
        self._warned = self._warned or warn_of_range(scenes, self.record.get("range", {}))
        frames = [len(frame_times(scene)) for scene in scenes]
        tool = torch.from_numpy(np.stack([tool_knots(scene, max(frames) - 1) for scene in scenes]))
        with torch.no_grad():
            states = map_tensors(lambda values: values.to(self.device), start_lever(scenes))
            boards = rollout_lever(self.dynamics, states, tool.to(self.device)).cpu().numpy()
        tracks = []
        for index, (scene, count) in enumerate(zip(scenes, frames, strict=True)):
            if not np.isfinite(boards[index, :count]).all():
                bad = int((~np.isfinite(boards[index])).any(-1).argmax())
                raise PredictionError(f"scene {index}: the board's predicted pose is not finite at frame {bad}")
            poses = np.tile(np.concatenate((np.zeros((1, 7)), scene.poses_world_from_body)), (count, 1, 1))
            poses[:, 0] = tool[index, : (count - 1) * KNOTS + 1 : KNOTS]
            poses[:, 1 + scene.board] = boards[index, :count]
            tracks.append(LeverTrack(scene, poses))
        return tracks
