"""Training of physics prediction."""

import contextlib
import dataclasses
import hashlib
import json
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from pushgraph.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from pushgraph.dataset.store import Dataset
from pushgraph.dataset.windows import WindowSampler
from pushgraph.errors import TrainingError
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import start
from pushgraph.network.dynamics import KINDS
from pushgraph.physics import rollout
from pushgraph.simulation.setups import FIRST_TEST_SEED
from pushgraph.training.examples import ExampleMaker
from pushgraph.training.loop import Schedule, train
from pushgraph.training.losses import unrolled_loss
from pushgraph.training.processes import Processes
from pushgraph.training.running import Progress, RunningCheckpoint

VALIDATION_FRAMES = 51
MOVED = 0.01
"""Objects that move farther than this (m) count in the validation of final errors."""
NUMBERS = ("mean_error_cm", "final_error_moved_cm", "displacement_moved_cm")


@dataclass(frozen=True)
class PhysicsTraining:
    """What decides a training. A sample is one predicted frame of one window."""

    model: str
    data: str
    validation: str
    samples: int = 20_000_000
    frames: int = 10
    batch: int = 256
    learning_rate: float = 1.5e-3
    hidden: int = 96
    propagation_steps: int = 6
    precision: str = "float32"
    seed: int = 0
    start_from: str | None = None

    def __post_init__(self) -> None:
        if self.model not in KINDS:
            raise TrainingError(f"no predictor {self.model!r}; valid: {', '.join(KINDS)}")
        if self.precision not in ("float32", "bfloat16"):
            raise TrainingError(f"precision: must be float32 or bfloat16, got {self.precision!r}")
        for name in ("samples", "frames", "batch", "hidden", "propagation_steps"):
            if getattr(self, name) < 1:
                raise TrainingError(f"{name}: must be at least 1, got {getattr(self, name)}")
        if not self.learning_rate > 0:
            raise TrainingError(f"learning_rate: must be positive, got {self.learning_rate}")
        for name in ("data", "validation"):
            if not Path(getattr(self, name)).is_file():
                raise TrainingError(f"{name}: no such dataset: {getattr(self, name)}; make it with pushgraph generate")

    @property
    def steps(self) -> int:
        """Optimizer steps."""
        return max(1, self.samples // (self.batch * self.frames))

    @property
    def config(self) -> dict[str, int]:
        """Config of the network."""
        return {"hidden": self.hidden, "steps": self.propagation_steps}

    def folder(self, cache: Path) -> Path:
        """Where this training runs."""
        digest = hashlib.sha256(json.dumps(dataclasses.asdict(self), sort_keys=True).encode()).hexdigest()
        return cache / "training" / f"physics-{self.model}-{digest[:10]}"


class PhysicsTask:
    """Unrolled prediction of windows; validation by rollouts from the start of every validation trajectory."""

    def __init__(self, training: PhysicsTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._rank, self._device = training, processes.rank, device
        data = _open(training.data)
        self.data_recipe = dataclasses.asdict(data.recipe)
        share = max(1, training.batch // processes.count)
        self._sampler = WindowSampler(data, training.frames + 2, share, training.seed * 1000 + processes.rank)
        self._examples = ExampleMaker(data)
        validation = _open(training.validation)
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
        example = self._examples(self._sampler.batch(step), generator).to(self._device)
        half = self._training.precision == "bfloat16"
        # Dropout draws from torch's own generator; nobody else's draws shall change with it.
        with torch.random.fork_rng(), torch.autocast(self._device.type, torch.bfloat16, enabled=half):
            torch.manual_seed(hash((self._training.seed, step, self._rank)) % 2**63)
            return unrolled_loss(network, example)

    def validate(self, network: nn.Module) -> Tensor:
        """Sums over trajectories of NUMBERS after a rollout of 50 frames, and their count."""
        true = self._validation_poses
        state = start(self._validation_scenes, true[:, 0, 1:])
        predicted = rollout(network, state, true[:, :, 0], self._validation_down)[:, :-1]
        true = true[:, :-1, 1:]
        error = (predicted - true)[..., :2].norm(dim=-1) * 100
        displacement = (true[:, -1] - true[:, 0])[..., :2].norm(dim=-1)
        moved = (displacement > MOVED).float() * self._validation_scenes.present
        share = moved / moved.sum(1, keepdim=True).clamp(min=1)
        error = error.nan_to_num(1e6, 1e6)
        return torch.stack(
            (
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
    tell: Callable[[PhysicsTraining, Progress, float], None] = lambda training, now, loss: None,
) -> Progress | None:
    """Train a predictor and write its checkpoint to `out`; the same call goes on after a kill.

    Under torchrun every process calls this; all but the leading one return None.
    """
    place = torch.device(device)
    processes = Processes.join(place)
    running = RunningCheckpoint(training.folder(cache), dataclasses.asdict(training) | {"processes": processes.count})
    with running.locked() if processes.leads else contextlib.nullcontext():
        processes.wait()
        with torch.random.fork_rng():
            torch.manual_seed(training.seed)
            network = KINDS[training.model](**training.config).to(place)
        if training.start_from:
            network.load_state_dict(load_checkpoint(training.start_from).dynamics.state_dict())
        task = PhysicsTask(training, processes, place)
        schedule = Schedule(training.steps, training.learning_rate, amsgrad=training.model == "propnet")
        now = train(network, task, schedule, running, processes, NUMBERS, lambda p, loss: tell(training, p, loss))
        processes.leave()
        if not processes.leads:
            return None
        record = {
            "training": _without_folders(training) | {"processes": processes.count},
            "data": task.data_recipe,
            "validation": task.validation_recipe,
            "samples": now.step * training.batch * training.frames,
            "seconds": round(now.seconds, 1),
            "hardware": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {device}",
            "curve": now.curve,
        }
        save_checkpoint(Checkpoint(training.model, training.config, network, record), out)
    return now


def _without_folders(training: PhysicsTraining) -> dict[str, object]:
    """The settings; of files only their names, which mean something elsewhere."""
    settings = dataclasses.asdict(training)
    names = ("data", "validation", "start_from")
    return settings | {name: settings[name] and Path(settings[name]).name for name in names}


def _open(path: str) -> Dataset:
    data = Dataset(path)
    if data.recipe.seed >= FIRST_TEST_SEED:
        raise TrainingError(f"{path}: seeds from {FIRST_TEST_SEED:,} on are for tests; train on smaller ones")
    return data
