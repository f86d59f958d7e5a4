"""Training of the prediction of boards that are levered up."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph import pose_3d
from pushgraph.dataset.lever_store import LeverDataset
from pushgraph.errors import TrainingError
from pushgraph.graph.lever_batch import LeverBatch, LeverState, batch_lever_scenes, displacement
from pushgraph.lever_physics import rollout_lever, tool_knots
from pushgraph.network.body_step import REST
from pushgraph.network.lever_dynamics import KNOTS, LeverDynamics
from pushgraph.scene_range import range_of
from pushgraph.track_frames import FRAME
from pushgraph.training.conduct import conduct, nothing, open_dataset
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import LeverTraining
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress
from pushgraph.training.validation import validation_indices

UNIT = 1e-3
"""Errors are counted in this (m)."""
ARM = 0.1
"""A turn counts as the way of a point so far off (m)."""
SMOOTH = 0.01
"""Errors below this many units count quadratically."""
CHAOS = 5.0
"""Errors of about this many units and more count little: there the board has slipped off, or has not."""


class Interactions(NamedTuple):
    """Levered boards as tensors. boards: pose_world_from_board in every frame. tool: see `tool_knots`."""

    scenes: LeverBatch
    boards: Float[Tensor, "batch frames 7"]
    tool: Float[Tensor, "batch knots 7"]

    @classmethod
    def of(cls, data: LeverDataset, indices: range, device: torch.device) -> "Interactions":
        """Read some of a dataset; shorter ones rest at the end."""
        tracks = [data[k] for k in indices]
        longest = max(len(track.poses) for track in tracks)
        boards = [np.pad(track.board, ((0, longest - len(track.poses)), (0, 0)), mode="edge") for track in tracks]
        tool = [tool_knots(track.scene, longest - 1) for track in tracks]
        scenes = batch_lever_scenes([track.scene for track in tracks])
        tensors = (torch.from_numpy(np.stack(values)).to(device) for values in (boards, tool))
        return cls(LeverBatch(*(values.to(device) for values in scenes)), *tensors)


class LeverTask:
    """Unrolled prediction of windows; validation by rollouts from the start of every validation interaction."""

    numbers: tuple[str, ...] = ("bounded_error_mm", "final_position_error_mm", "final_rotation_error_deg")
    physics: str | None = None

    def __init__(self, training: LeverTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._processes = training, processes
        data = open_dataset(training.data, LeverDataset)
        count = len(data) if training.interactions is None else min(training.interactions, len(data))
        self.data_recipe = dataclasses.asdict(data.recipe) | {"interactions": count}
        self._data = Interactions.of(data, range(count), device)
        self.range = range_of(data.scene(k) for k in range(count))
        validation = open_dataset(training.validation, LeverDataset)
        self.validation_recipe = dataclasses.asdict(validation.recipe)
        indices = validation_indices(len(validation), validation.path, processes)
        self._validation = Interactions.of(validation, indices, device)
        if self._data.boards.shape[1] <= training.frames:
            raise TrainingError(f"frames: at most {self._data.boards.shape[1] - 1} are in the data")

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Mean distance of predicted from true poses in windows that start anywhere."""
        rng = np.random.default_rng([self._training.seed, step])
        scenes, boards, tool = self._data
        frames, batch, device = self._training.frames, self._training.batch, boards.device
        share = self._processes.share(batch)
        drawn = [rng.integers(most, size=batch)[share] for most in (len(boards), boards.shape[1] - frames)]
        index, first = (torch.from_numpy(one).to(device)[:, None] for one in drawn)
        window = boards[index, first + torch.arange(frames + 1, device=device)]
        before = boards[index, (first - 1).clamp(min=0)][:, 0]
        state = LeverState(scenes.take(index[:, 0]), window[:, 0], velocity_between(before, window[:, 0]))
        ways = tool[index, first * KNOTS + torch.arange(frames * KNOTS + 1, device=device)]
        predicted = rollout_lever(cast(LeverDynamics, network), state, ways)
        error = _distance(predicted[:, 1:], window[:, 1:]) / UNIT
        smooth = (error.square() + SMOOTH**2).sqrt() - SMOOTH
        return (smooth / (1 + smooth / CHAOS)).mean() * (len(error) * self._processes.count / batch)

    def validate(self, network: nn.Module) -> Float[Tensor, "2 numbers"]:
        """Sums over interactions of `numbers` after a whole rollout, and how many interactions there are."""
        scenes, boards, tool = self._validation
        state = LeverState(scenes, boards[:, 0], torch.zeros_like(boards[:, 0, :6]))
        predicted = rollout_lever(cast(LeverDynamics, network), state, tool)
        error = _distance(predicted, boards).nan_to_num(1e3, 1e3) / UNIT
        position = (predicted[:, -1] - boards[:, -1])[:, :3].norm(dim=-1).nan_to_num(1e3, 1e3)
        turned = pose_3d.rotation_error(predicted[:, -1], boards[:, -1]).nan_to_num(np.pi).rad2deg()
        bounded = (error / (1 + error / CHAOS)).mean(1)
        sums = torch.stack((bounded.sum(), 1e3 * position.sum(), turned.sum()))
        return torch.stack((sums, torch.full_like(sums, len(error))))


def velocity_between(before: Float[Tensor, "batch 7"], after: Float[Tensor, "batch 7"]) -> Float[Tensor, "batch 6"]:
    """Velocities (m/s, rad/s, world axes) of boards from two frames; what creeps rests."""
    velocity = displacement(before, after) / FRAME
    rests = velocity[:, :3].norm(dim=-1) + velocity[:, 3:].norm(dim=-1) * ARM < REST
    return torch.where(rests[:, None], torch.zeros_like(velocity), velocity)


def _distance(predicted: Float[Tensor, "*batch 7"], true: Float[Tensor, "*batch 7"]) -> Float[Tensor, "*batch"]:
    """How far poses are apart (m), turns at ARM."""
    turn = pose_3d.rotation_vector(pose_3d.multiply(pose_3d.conjugate(true[..., 3:]), predicted[..., 3:]))
    square = (predicted - true)[..., :3].square().sum(-1) + (ARM * turn).square().sum(-1)
    return (square + 1e-18).sqrt()


def train_lever(
    training: LeverTraining,
    run: TrainingRun,
    tell: Callable[[Progress, float], None] = nothing,
    say: Callable[[str], None] = nothing,
) -> Progress | None:
    """Train a predictor of boards; see `conduct`."""
    return conduct(training, LeverTask, run, tell, say)
