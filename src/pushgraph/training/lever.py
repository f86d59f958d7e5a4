"""Training of the prediction of boards that are levered up."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple, cast

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
from pushgraph.network.lever_dynamics import KNOTS, LEVERS, LeverDynamics
from pushgraph.scene_range import range_of
from pushgraph.track_frames import FRAME
from pushgraph.training.conduct import conduct, open_dataset
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import Training
from pushgraph.training.running import Progress

UNIT = 1e-3
"""Errors are counted in this (m)."""
ARM = 0.1
"""A turn counts as the way of a point so far off (m)."""
SMOOTH = 0.01
"""Errors below this many units count quadratically."""
CHAOS = 5.0
"""Errors of about this many units and more count little: there the board has slipped off, or has not."""


@dataclass(frozen=True)
class LeverTraining(Training):
    """What decides a training of boards. A sample is one predicted frame of one window."""

    TASK: ClassVar[str] = "lever-up"
    MODELS: ClassVar[Mapping[str, type[LeverDynamics]]] = LEVERS
    VALIDATIONS: ClassVar[int] = 10

    samples: int = 200_000
    frames: int = 4
    batch: int = 64
    learning_rate: float = 1e-3
    hidden: int = 64
    propagation_steps: int = 2
    interactions: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in (("propagation_steps", self.propagation_steps), ("interactions", self.interactions)):
            if value is not None and value < 1:
                raise TrainingError(f"{name}: must be at least 1, got {value}")

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden, "steps": self.propagation_steps}


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
        self._training, self._rank = training, processes.rank
        self.range: dict[str, list[float]] = {}
        data = open_dataset(training.data, LeverDataset)
        count = len(data) if training.interactions is None else min(training.interactions, len(data))
        self.data_recipe = dataclasses.asdict(data.recipe) | {"interactions": count}
        self._data = Interactions.of(data, range(count), device)
        self.range = range_of(data.scene(k) for k in range(count))
        validation = open_dataset(training.validation, LeverDataset)
        self.validation_recipe = dataclasses.asdict(validation.recipe)
        self._validation = Interactions.of(validation, range(processes.rank, len(validation), processes.count), device)
        self._share = max(1, training.batch // processes.count)
        if self._data.boards.shape[1] <= training.frames:
            raise TrainingError(f"frames: at most {self._data.boards.shape[1] - 1} are in the data")

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Mean distance of predicted from true poses in windows that start anywhere."""
        rng = np.random.default_rng([self._training.seed, self._rank, step])
        scenes, boards, tool = self._data
        frames, device = self._training.frames, boards.device
        index = torch.from_numpy(rng.integers(len(boards), size=self._share)).to(device)[:, None]
        first = torch.from_numpy(rng.integers(boards.shape[1] - frames, size=self._share)).to(device)[:, None]
        window = boards[index, first + torch.arange(frames + 1, device=device)]
        before = boards[index, (first - 1).clamp(min=0)][:, 0]
        state = LeverState(scenes.take(index[:, 0]), window[:, 0], velocity_between(before, window[:, 0]))
        ways = tool[index, first * KNOTS + torch.arange(frames * KNOTS + 1, device=device)]
        predicted = rollout_lever(cast(LeverDynamics, network), state, ways)
        error = _distance(predicted[:, 1:], window[:, 1:]) / UNIT
        smooth = (error.square() + SMOOTH**2).sqrt() - SMOOTH
        return (smooth / (1 + smooth / CHAOS)).mean()

    def validate(self, network: nn.Module) -> Tensor:
        """Sums over interactions of `numbers` after a whole rollout, and their count."""
        scenes, boards, tool = self._validation
        state = LeverState(scenes, boards[:, 0], torch.zeros_like(boards[:, 0, :6]))
        predicted = rollout_lever(cast(LeverDynamics, network), state, tool)
        error = _distance(predicted, boards).nan_to_num(1e3, 1e3) / UNIT
        position = (predicted[:, -1] - boards[:, -1])[:, :3].norm(dim=-1).nan_to_num(1e3, 1e3)
        turned = pose_3d.rotation_error(predicted[:, -1], boards[:, -1]).nan_to_num(np.pi).rad2deg()
        bounded = (error / (1 + error / CHAOS)).mean(1)
        return torch.stack((bounded.sum(), 1e3 * position.sum(), turned.sum(), error.new_tensor(float(len(error)))))


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
    cache: Path,
    out: Path,
    device: str = "cpu",
    tell: Callable[[Progress, float], None] = lambda now, loss: None,
) -> Progress | None:
    """Train a predictor of boards; see `conduct`."""
    return conduct(training, LeverTask, cache, out, device, tell)
