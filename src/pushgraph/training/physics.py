"""Training of physics prediction."""

import dataclasses
from collections.abc import Callable
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph.dataset.windows import WindowBatch, WindowSampler
from pushgraph.graph.state import start
from pushgraph.network.contract import PhysicsNetwork
from pushgraph.rollout import rollout
from pushgraph.scene_range import range_of
from pushgraph.training.conduct import conduct, nothing, open_dataset
from pushgraph.training.examples import ExampleMaker
from pushgraph.training.losses import unrolled_loss
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import PhysicsTraining
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress
from pushgraph.training.seeds import seed_of
from pushgraph.training.share import Draws
from pushgraph.training.validation import Rollouts, validation_tracks

VALIDATION_FRAMES = 50
CHAOS = 1.0
"""Errors of about this much (cm) and more count little where weights are chosen: there pushing is chaotic."""
MOVED = 0.01
"""Objects that move farther than this (m) count in the validation of final errors."""


class PhysicsTask:
    """Unrolled prediction of windows; validation by rollouts from the start of every validation trajectory."""

    numbers: tuple[str, ...] = ("bounded_error_cm", "mean_error_cm", "final_error_moved_cm", "displacement_moved_cm")
    physics: str | None = None

    def __init__(self, training: PhysicsTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._processes, self._device = training, processes, device
        data = open_dataset(training.data)
        self.data_recipe = dataclasses.asdict(data.recipe)
        self.range = range_of(data.scene(k) for k in range(len(data)))
        seed = seed_of("windows", seed=training.seed)
        self._sampler = WindowSampler(data, training.frames + 2, training.batch, seed)
        self._examples = ExampleMaker(data, device)
        validation = open_dataset(training.validation)
        self.validation_recipe = dataclasses.asdict(validation.recipe)
        self._validation = Rollouts.of(validation_tracks(validation, processes), VALIDATION_FRAMES).to(device)

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Unrolled loss of the step's batch."""
        training, share = self._training, self._processes.share(self._training.batch)
        windows = WindowBatch(*(values[share] for values in self._sampler.batch(step)))
        draws = Draws.of(seed_of("examples", seed=training.seed, step=step), training.batch, share)
        dynamics = cast(PhysicsNetwork, network)
        spans = dynamics.FRAMES_PER_STEP
        example = self._examples(windows, draws, spans[step % len(spans)])
        half = training.precision == "bfloat16"
        # Dropout draws from torch's own generator; nobody else's draws shall change with it.
        with torch.random.fork_rng(), torch.autocast(self._device.type, torch.bfloat16, enabled=half):
            torch.manual_seed(seed_of("dropout", seed=training.seed, step=step, rank=self._processes.rank))
            return unrolled_loss(dynamics, example, self._processes.mean, training.velocity_noise)

    def validate(self, network: nn.Module) -> Float[Tensor, "2 numbers"]:
        """Sums over trajectories of `numbers` after a rollout of 50 frames, and how many trajectories there are."""
        scenes, poses, down, lasts = self._validation
        state = start(scenes, poses[:, 0, 1:])
        predicted = rollout(cast(PhysicsNetwork, network), state, poses[:, :, 0], down).poses
        true = poses[:, :, 1:]
        error = ((predicted - true)[..., :2].norm(dim=-1) * 100).nan_to_num(1e6, 1e6)
        displacement = (true[:, -1] - true[:, 0])[..., :2].norm(dim=-1)
        moved = (displacement > MOVED).float() * scenes.present
        share = moved / moved.sum(1, keepdim=True).clamp(min=1)
        counts = lasts[..., None] * scenes.present[:, None]
        counts = counts / counts.sum((1, 2), keepdim=True)
        sums = torch.stack(
            (
                (error / (1 + error / CHAOS) * counts).sum(),
                (error * counts).sum(),
                (error[:, -1] * share).sum(),
                (displacement * 100 * share).sum(),
            )
        )
        return torch.stack((sums, torch.full_like(sums, len(poses))))


def train_physics(
    training: PhysicsTraining,
    run: TrainingRun,
    tell: Callable[[Progress, float], None] = nothing,
    say: Callable[[str], None] = nothing,
) -> Progress | None:
    """Train a predictor; see `conduct`."""
    return conduct(training, PhysicsTask, run, tell, say)
