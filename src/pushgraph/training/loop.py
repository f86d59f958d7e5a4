"""The training loop: steps, validations and checkpoints, for any task."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from safetensors.torch import save
from torch import Tensor, nn

from pushgraph.errors import TrainingError
from pushgraph.storage import replacing
from pushgraph.training.processes import Processes
from pushgraph.training.running import Progress, RunningCheckpoint

SAVE_EVERY = 60.0
"""Seconds between two checkpoints: what a kill may lose."""
WARM_UP = 0.02
"""Share of the steps in which the learning rate rises."""
CLIP = 1.0
"""Largest norm of a gradient."""
DECAY = 1e-4
CLEARLY = 0.05
"""What training starts from is kept unless something validates better by this share: validations are noisy."""


@runtime_checkable
class Task(Protocol):
    """What is trained: a loss for every step, and a validation whose first number shall be small.

    numbers: names of the validation's. data_recipe, validation_recipe: of the datasets. range: of every quantity in
    the data, see `pushgraph.scene_range`. physics: hash of the
    checkpoint that the network stands on, if it does.
    """

    numbers: tuple[str, ...]
    data_recipe: dict[str, Any]
    validation_recipe: dict[str, Any]
    range: dict[str, list[float]]
    physics: str | None

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Loss of one batch; depends on the weights, the step and this process's rank alone."""

    def validate(self, network: nn.Module) -> Tensor:
        """Numbers that add up over processes, to be divided by their last one, a weight."""


@dataclass(frozen=True)
class Schedule:
    """How long and how fast: the learning rate rises, then falls to zero along a cosine."""

    steps: int
    learning_rate: float
    validations: int = 20
    amsgrad: bool = False

    def rate(self, step: int) -> float:
        """Learning rate of a step."""
        rise = min(1.0, (step + 1) / max(1.0, WARM_UP * self.steps))
        return self.learning_rate * rise * 0.5 * (1 + math.cos(math.pi * step / self.steps))

    def validates_after(self, step: int) -> bool:
        """Whether a validation follows a step."""
        every = max(1, self.steps // self.validations)
        return (step + 1) % every == 0 or step + 1 == self.steps


def train(
    network: nn.Module,
    task: Task,
    schedule: Schedule,
    running: RunningCheckpoint,
    processes: Processes,
    tell: Callable[[Progress, float], None],
) -> Progress:
    """Train a network and leave the weights that validated best in it; goes on from the running checkpoint.

    `tell` is called after every step with the progress and the loss.
    Raises TrainingError if a loss is not finite; the state that caused it is saved then.
    """
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=schedule.learning_rate, weight_decay=DECAY, amsgrad=schedule.amsgrad
    )
    now, best = running.load(network, optimizer)
    begun = saved = time.monotonic()
    spent = now.seconds
    losses: list[float] = []
    if not now.curve:
        with torch.no_grad():
            first_loss = float(processes.mean(task.loss(network, 0).detach().clone().double()))
        numbers = _validated(network, task, processes)
        now.curve.append({"step": 0, "seconds": 0.0, "loss": first_loss})
        now.curve[-1] |= dict(zip(task.numbers, numbers, strict=True))
        now.best = numbers[0] * (1 - CLEARLY)
        best = {name: values.detach().clone() for name, values in network.state_dict().items()}
    for step in range(now.step, schedule.steps):
        processes.check_parent()
        for group in optimizer.param_groups:
            group["lr"] = schedule.rate(step)
        loss = task.loss(network, step)
        optimizer.zero_grad()
        loss.backward()
        processes.average_gradients(network)
        norm = nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        mean_loss = float(processes.mean(loss.detach().clone().double()))
        if not math.isfinite(mean_loss + float(norm)):
            raise TrainingError(_save_failure(network, running, processes, step, mean_loss, float(norm)))
        optimizer.step()
        losses.append(mean_loss)
        now.step, now.seconds = step + 1, spent + time.monotonic() - begun
        if schedule.validates_after(step):
            numbers = _validated(network, task, processes)
            now.curve.append({"step": step + 1, "seconds": now.seconds, "loss": sum(losses) / len(losses)})
            now.curve[-1] |= dict(zip(task.numbers, numbers, strict=True))
            losses = []
            if numbers[0] < now.best:
                now.best = numbers[0]
                best = {name: values.detach().clone() for name, values in network.state_dict().items()}
        if processes.leads and (time.monotonic() - saved > SAVE_EVERY or step + 1 == schedule.steps):
            running.save(network, best, optimizer, now)
            saved = time.monotonic()
        tell(now, mean_loss)
    network.load_state_dict(best)
    return now


@torch.no_grad()
def _validated(network: nn.Module, task: Task, processes: Processes) -> list[float]:
    network.eval()
    sums = processes.mean(task.validate(network))
    network.train()
    return (sums[:-1] / sums[-1]).tolist()


def _save_failure(
    network: nn.Module, running: RunningCheckpoint, processes: Processes, step: int, loss: float, norm: float
) -> str:
    path = running.folder / f"failure-step-{step}-process-{processes.rank}.safetensors"
    with replacing(path) as temporary:
        temporary.write_bytes(save({name: values.cpu().contiguous() for name, values in network.state_dict().items()}))
    return (
        f"step {step}: loss {loss}, gradient {norm}: not finite. The weights before that step are in {path}; the batch "
        "follows from the step. Nothing was overwritten: lower the learning rate, or look at that batch"
    )
