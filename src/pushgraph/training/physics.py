"""Training of physics prediction."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, cast

import numpy as np
import torch
from torch import Tensor, nn

from pushgraph.dataset.windows import WindowSampler
from pushgraph.errors import TrainingError
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import start
from pushgraph.network.contract import PhysicsNetwork
from pushgraph.network.dynamics import DYNAMICS
from pushgraph.physics import rollout
from pushgraph.scene_range import range_of
from pushgraph.training.conduct import conduct, open_dataset
from pushgraph.training.examples import ExampleMaker
from pushgraph.training.losses import unrolled_loss
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import Training
from pushgraph.training.running import Progress

VALIDATION_FRAMES = 51
CHAOS = 1.0
"""Errors of about this much (cm) and more count little where weights are chosen: there pushing is chaotic."""
MOVED = 0.01
"""Objects that move farther than this (m) count in the validation of final errors."""


@dataclass(frozen=True)
class PhysicsTraining(Training):
    """What decides a training of physics prediction. A sample is one predicted frame of one window."""

    TASK: ClassVar[str] = "physics"
    MODELS: ClassVar[Mapping[str, type[PhysicsNetwork]]] = DYNAMICS

    samples: int = 20_000_000
    frames: int = 4
    batch: int = 256
    learning_rate: float = 2e-3
    hidden: int = 48
    propagation_steps: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.propagation_steps < 1:
            raise TrainingError(f"propagation_steps: must be at least 1, got {self.propagation_steps}")

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden, "steps": self.propagation_steps}


class PhysicsTask:
    """Unrolled prediction of windows; validation by rollouts from the start of every validation trajectory."""

    numbers: tuple[str, ...] = ("bounded_error_cm", "mean_error_cm", "final_error_moved_cm", "displacement_moved_cm")
    physics: str | None = None

    def __init__(self, training: PhysicsTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._rank, self._device = training, processes.rank, device
        data = open_dataset(training.data)
        self.data_recipe = dataclasses.asdict(data.recipe)
        self.range = range_of(data.scene(k) for k in range(len(data)))
        share = max(1, training.batch // processes.count)
        self._sampler = WindowSampler(data, training.frames + 2, share, training.seed * 1000 + processes.rank)
        self._examples = ExampleMaker(data, device)
        validation = open_dataset(training.validation)
        self.validation_recipe = dataclasses.asdict(validation.recipe)
        tracks = [validation[k] for k in range(processes.rank, len(validation), processes.count)]
        self._validation_scenes = batch_scenes([track.scene for track in tracks]).to(device)
        poses = np.stack([track.poses[:VALIDATION_FRAMES] for track in tracks])
        self._validation_poses = torch.tensor(poses, dtype=torch.float32, device=device)
        down = np.stack([track.down[:VALIDATION_FRAMES] for track in tracks])
        self._validation_down = torch.tensor(down, device=device)

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Unrolled loss of the step's batch."""
        generator = torch.Generator().manual_seed(hash((self._training.seed, self._rank, step, 1)) % 2**63)
        dynamics = cast(PhysicsNetwork, network)
        spans = dynamics.FRAMES_PER_STEP
        example = self._examples(self._sampler.batch(step), generator, spans[step % len(spans)])
        half = self._training.precision == "bfloat16"
        # Dropout draws from torch's own generator; nobody else's draws shall change with it.
        with torch.random.fork_rng(), torch.autocast(self._device.type, torch.bfloat16, enabled=half):
            torch.manual_seed(hash((self._training.seed, step, self._rank)) % 2**63)
            return unrolled_loss(dynamics, example)

    def validate(self, network: nn.Module) -> Tensor:
        """Sums over trajectories of `numbers` after a rollout of 50 frames, and their count."""
        true = self._validation_poses
        state = start(self._validation_scenes, true[:, 0, 1:])
        predicted = rollout(cast(PhysicsNetwork, network), state, true[:, :, 0], self._validation_down).poses[:, :-1]
        true = true[:, :-1, 1:]
        error = (predicted - true)[..., :2].norm(dim=-1) * 100
        displacement = (true[:, -1] - true[:, 0])[..., :2].norm(dim=-1)
        moved = (displacement > MOVED).float() * self._validation_scenes.present
        share = moved / moved.sum(1, keepdim=True).clamp(min=1)
        error = error.nan_to_num(1e6, 1e6)
        return torch.stack(
            (
                (error / (1 + error / CHAOS)).mean((1, 2)).sum(),
                error.mean((1, 2)).sum(),
                (error[:, -1] * share).sum(),
                (displacement * 100 * share).sum(),
                error.new_tensor(float(len(error))),
            )
        )


def train_physics(
    training: PhysicsTraining,
    cache: Path,
    out: Path,
    device: str = "cpu",
    tell: Callable[[Progress, float], None] = lambda now, loss: None,
) -> Progress | None:
    """Train a predictor; see `conduct`."""
    return conduct(training, PhysicsTask, cache, out, device, tell)
