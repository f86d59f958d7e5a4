"""The training loop: steps, validations and checkpoints, for any task."""

import math
import time
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from pushgraph.errors import TrainingError, TrainingInterrupted
from pushgraph.storage import replacing
from pushgraph.training.processes import Processes
from pushgraph.training.recorder import Recorder
from pushgraph.training.running import Progress, RunningCheckpoint
from pushgraph.training.stopping import Stopping

SAVE_EVERY = 60.0
"""Seconds between two checkpoints: what a kill may lose."""
WARM_UP = 0.02
"""Share of the steps in which the learning rate rises."""
CLIP = 1.0
"""Largest norm of a gradient."""
DECAY = 1e-4


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
        """Loss of this process's share of a batch; the mean over processes is that of the batch, however many share it.

        Depends on the weights and the step alone.
        """

    def validate(self, network: nn.Module) -> Float[Tensor, "2 numbers"]:
        """Sums over this process's share of the validation, and the weights to divide them by."""


@dataclass(frozen=True)
class Schedule:
    """How long and how fast: the learning rate rises, then falls to zero along a cosine.

    least_gain: what training starts from is kept unless something validates better by this share. keeps_last: the last
    weights are kept instead of those that validated best.
    """

    steps: int
    learning_rate: float
    validations: int = 20
    amsgrad: bool = False
    least_gain: float = 0.05
    keeps_last: bool = False

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
    recorder: Recorder | None,
) -> Progress:
    """Train a network and leave the best weights in it, or the last; goes on from the running checkpoint.

    recorder: of the leading process. Raises TrainingError if a loss is not finite; the state that caused it is saved
    then. Raises TrainingInterrupted after Ctrl-C, everything being saved.
    """
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=schedule.learning_rate, weight_decay=DECAY, amsgrad=schedule.amsgrad
    )
    now, best = running.load(network, optimizer)
    if recorder:
        recorder.begin(now)
    begun = saved = time.monotonic()
    spent = now.seconds
    learning: nn.Module = _Step(network, task)
    if processes.count > 1:
        learning = DistributedDataParallel(learning, find_unused_parameters=True)
    if not now.curve:
        with torch.no_grad():
            first_loss = float(processes.mean(task.loss(network, 0).double()))
        numbers = _validated(network, task, processes)
        if task.numbers[0] not in numbers:
            raise TrainingError(f"validation: holds nothing by which {task.numbers[0]} can be measured")
        now.curve.append({"step": 0, "seconds": 0.0, "loss": first_loss} | numbers)
        now.best = numbers[task.numbers[0]] * (1 - schedule.least_gain)
        best = _copied(network)
        if recorder:
            recorder.validated(now)
    with Stopping(twice=processes.count == 1) as stopping:
        for step in range(now.step, schedule.steps):
            for group in optimizer.param_groups:
                group["lr"] = schedule.rate(step)
            optimizer.zero_grad()
            loss = learning(step)
            loss.backward()
            norm = nn.utils.clip_grad_norm_(network.parameters(), CLIP)
            of_process = torch.stack([loss.detach().double(), loss.new_tensor(float(stopping.asked)).double()])
            mean_loss, stops = processes.mean(of_process).tolist()
            if not math.isfinite(mean_loss + float(norm)):
                raise TrainingError(_save_failure(network, running, processes, step, mean_loss, float(norm)))
            optimizer.step()
            now.losses += mean_loss
            now.step, now.seconds = step + 1, spent + time.monotonic() - begun
            if schedule.validates_after(step):
                numbers = _validated(network, task, processes)
                mean = now.losses / (now.step - int(now.curve[-1]["step"]))
                now.curve.append({"step": now.step, "seconds": now.seconds, "loss": mean} | numbers)
                now.losses = 0.0
                # Nothing is better than what cannot be measured.
                if (value := numbers.get(task.numbers[0], math.inf)) < now.best:
                    now.best, best = value, _copied(network)
                if recorder:
                    recorder.validated(now)
            if recorder and (stops or time.monotonic() - saved > SAVE_EVERY or now.step == schedule.steps):
                running.save(network, best, optimizer, now)
                saved = time.monotonic()
            if recorder:
                recorder.step(now, mean_loss)
            if stops and now.step < schedule.steps:
                raise TrainingInterrupted(f"stopped after step {now.step} of {schedule.steps}; everything is saved")
    if not schedule.keeps_last:
        network.load_state_dict(best)
    return now


class _Step(nn.Module):
    """The loss of a step as a module, so that gradients are averaged over processes while they are computed."""

    def __init__(self, network: nn.Module, task: Task) -> None:
        super().__init__()
        self.network, self._task = network, task

    def forward(self, step: int) -> Tensor:
        return self._task.loss(self.network, step)


def _copied(network: nn.Module) -> dict[str, Tensor]:
    return {name: values.detach().clone() for name, values in network.state_dict().items()}


@torch.no_grad()
def _validated(network: nn.Module, task: Task, processes: Processes) -> dict[str, float]:
    """The numbers by name; without those that nothing in the data could be measured by."""
    network.eval()
    sums, weights = processes.mean(task.validate(network).double())
    network.train()
    measured = zip(task.numbers, sums.tolist(), weights.tolist(), strict=True)
    return {name: total / weight for name, total, weight in measured if weight > 0}


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
