"""Training of belief regulation."""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple, cast

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from pushgraph.belief import load_physics, watch_windows
from pushgraph.dataset.sequences import SequenceSampler
from pushgraph.errors import TrainingError
from pushgraph.graph.joint_truth import adjacent_pairs, touched_pairs, true_joints, unaware
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.network.belief_network import BELIEFS, BeliefNetwork, BeliefRecipe, Rows
from pushgraph.network.contract import Foreseeing
from pushgraph.scene_range import range_of
from pushgraph.training.conduct import conduct, open_dataset
from pushgraph.training.masses import Weighed, mass_loss, weighed
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import Training
from pushgraph.training.running import Progress
from pushgraph.training.watching import NOISE, Watched, watched

LAST_WEIGHT = 2.0
"""The loss of a frame grows linearly from zero to this at the end of its window (paper, section on training)."""
SMOOTH = 1e-6
"""Weight of the squared change of memories from frame to frame (the same section)."""
VALIDATED = (20, 40, 100, 200)
"""Observed frames after which a validation looks at the answers."""
VALIDATION_SCENES, VALIDATION_FRAMES = 50, 200
MASS_FRAMES, MASS_VALIDATION = 140, 32
"""Frames of the sequences that masses are learnt from, and sequences of a validation."""
MASS_SHARE = 2
"""Sequences about joints for each one about masses."""


@dataclass(frozen=True)
class BeliefTraining(Training):
    """What decides a training of belief regulation. A sample is one observed frame of one sequence.

    physics: checkpoint of the physics network that it stands on; by default the shipped one. masses,
    masses_validation: data in which masses are to be learnt; without them what is known of that stays as it is.
    keep_joints: whether what is known of joints stays as it is.
    """

    TASK: ClassVar[str] = "belief"
    MODELS: ClassVar[Mapping[str, type[BeliefRecipe]]] = BELIEFS
    VALIDATIONS: ClassVar[int] = 12
    FILES: ClassVar[tuple[str, ...]] = (*Training.FILES, "physics", "masses", "masses_validation")

    samples: int = 10_000_000
    frames: int = 200
    batch: int = 16
    learning_rate: float = 2e-3
    hidden: int = 64
    physics: str | None = None
    masses: str | None = None
    masses_validation: str | None = None
    keep_joints: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.masses is None) != (self.masses_validation is None):
            raise TrainingError("masses and masses_validation: give both or neither")
        for name in ("masses", "masses_validation"):
            path = getattr(self, name)
            if path is not None and not Path(path).is_file():
                raise TrainingError(
                    f"{name}: no such dataset: {path}; make it with pushgraph generate different-masses"
                )
        if self.masses is not None and self.model != "belief":
            raise TrainingError(f"masses: {self.model} knows no masses; only belief learns them")
        if self.keep_joints and (self.masses is None or self.start_from is None):
            raise TrainingError("keep_joints: needs masses to learn, and start_from, whose joints are kept")


class Answers(NamedTuple):
    """Log-odds after every frame of windows, for the pairs that ever had memory, and from when on they had it.

    restless: mean squared change of the memory of pairs, summed over its numbers.
    """

    rows: Rows
    log_odds: Float[Tensor, "frames rows joints"]
    begun: Bool[Tensor, "frames rows"]
    restless: Float[Tensor, ""]


def answers(network: BeliefRecipe, dynamics: Foreseeing, seen: Watched) -> Answers:
    """Watch windows and answer after every frame."""
    rows, active, memories = watch_windows(network, dynamics, seen.scenes, seen.poses, seen.tool, seen.down, seen.seen)
    log_odds = torch.stack([network.answer(memory, rows) for memory in memories])
    relations = torch.stack([memory.relations for memory in memories])
    restless = relations.diff(dim=0).square().sum(-1).mean()
    return Answers(rows, log_odds, active.cumsum(0) > 0, restless)


def belief_loss(network: BeliefRecipe, dynamics: Foreseeing, seen: Watched) -> Float[Tensor, ""]:
    """Cross-entropy of the answers, growing in weight with time, and what keeps memories smooth."""
    told = answers(network, dynamics, seen)
    frames = len(told.log_odds)
    growing = torch.linspace(0, LAST_WEIGHT, frames, device=told.log_odds.device)
    weight = growing[:, None] * told.begun * seen.lasts[told.rows.scene].T
    joint = seen.joint[told.rows.scene, told.rows.pair].expand(frames, -1)
    surprise = functional.cross_entropy(told.log_odds.flatten(0, 1).float(), joint.flatten(), reduction="none")
    return (surprise * weight.flatten()).sum() / weight.sum().clamp(min=1e-9) + SMOOTH * told.restless


class BeliefTask:
    """Answers about sequences; validation on the first frames of its trajectories, once clean and once noisy."""

    numbers: tuple[str, ...] = (
        "surprise",
        "nll_masses",
        "nll_adjacent",
        "error_touched_40",
        "error_touched_200",
        "error_touched_40_noisy",
        "error_touched_200_noisy",
    )

    def __init__(self, training: BeliefTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._rank, self._device = training, processes.rank, device
        data, validation = open_dataset(training.data), open_dataset(training.validation)
        self.range = range_of(data.scene(k) for k in range(len(data)))
        self.data_recipe, self.validation_recipe = (dataclasses.asdict(some.recipe) for some in (data, validation))
        share = max(1, training.batch // processes.count)
        self._sampler = SequenceSampler(data, training.frames, share, training.seed * 1000 + processes.rank)
        below = load_physics(BELIEFS[training.model].PHYSICS, training.physics)
        self.physics = below.hash
        self._dynamics = cast(Foreseeing, below.network.to(device).requires_grad_(False))
        count = min(len(validation), VALIDATION_SCENES)
        tracks = [validation[k] for k in range(processes.rank, count, processes.count)]
        frames = min(VALIDATION_FRAMES, *(len(track.times) for track in tracks))
        scenes = batch_scenes([track.scene for track in tracks])
        poses = torch.tensor(np.stack([track.poses[:frames] for track in tracks]), dtype=torch.float32)
        down = torch.tensor(np.stack([track.down[:frames] for track in tracks]))
        tool, bodies = poses[:, :, 0], poses[:, :, 1:]
        noise = torch.randn(bodies.shape, generator=torch.Generator().manual_seed(processes.rank))
        everything = torch.ones(bodies.shape[:3], dtype=torch.bool)
        self._adjacent = adjacent_pairs(scenes, bodies[:, 0]).to(device)
        self._touched = touched_pairs(self._adjacent, bodies.to(device))
        self._masses, self._masses_validation = self._open_masses(share)
        self._validation = [
            Watched(
                unaware(scenes),
                bodies + size * noise * bodies.new_tensor([NOISE[0], NOISE[0], NOISE[1]]),
                tool,
                down,
                everything,
                torch.ones_like(down),
                true_joints(scenes),
            ).to(device)
            for size in (0.0, 1.0)
        ]

    def _open_masses(self, share: int) -> tuple[SequenceSampler | None, list[Weighed]]:
        """What masses are learnt from, and what that is validated on."""
        training = self._training
        if training.masses is None or training.masses_validation is None:
            return None, []
        batch = max(1, share // MASS_SHARE)
        data, validation = open_dataset(training.masses), open_dataset(training.masses_validation)
        sampler = SequenceSampler(data, MASS_FRAMES, batch, training.seed * 1000 + self._rank)
        fixed = SequenceSampler(validation, MASS_FRAMES, MASS_VALIDATION // 2, self._rank)
        generator = torch.Generator().manual_seed(self._rank)
        return sampler, [weighed(fixed.batch(k), generator) for k in range(2)]

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Loss of the step's sequences."""
        losses = [] if self._training.keep_joints else [self._loss_of_joints(network, step)]
        if self._masses is not None:
            generator = torch.Generator().manual_seed(hash((self._training.seed, self._rank, step, 3)) % 2**63)
            tracks = weighed(self._masses.batch(step), generator)
            losses.append(self._loss_of_masses(network, tracks))
        return torch.stack(losses).sum()

    def _loss_of_masses(self, network: nn.Module, tracks: Weighed) -> Tensor:
        noise = cast(BeliefNetwork, network).mass_noise
        assert noise is not None
        return mass_loss(noise, self._dynamics, tracks).float()

    def _loss_of_joints(self, network: nn.Module, step: int) -> Tensor:
        generator = torch.Generator().manual_seed(hash((self._training.seed, self._rank, step, 2)) % 2**63)
        seen = watched(self._sampler.batch(step), generator).to(self._device)
        half = self._training.precision == "bfloat16"
        with torch.autocast(self._device.type, torch.bfloat16, enabled=half):
            return belief_loss(cast(BeliefRecipe, network), self._dynamics, seen)

    def validate(self, network: nn.Module) -> Tensor:
        """Means over pairs of `numbers`, and a one to divide by."""
        surprise, wrong = [], []
        for seen in self._validation:
            told = answers(cast(BeliefRecipe, network), self._dynamics, seen)
            joint = seen.joint[told.rows.scene, told.rows.pair]
            adjacent = self._adjacent[told.rows.scene, told.rows.pair]
            for frame in (frame for frame in VALIDATED if frame <= len(told.log_odds)):
                log_odds = told.log_odds[frame - 1].float()
                surprise.append(functional.cross_entropy(log_odds[adjacent], joint[adjacent]))
                touched = self._touched[told.rows.scene, frame - 1, told.rows.pair]
                if frame in (40, 200):
                    wrong.append((log_odds.argmax(-1) != joint)[touched].float().mean())
        wrong += [torch.zeros((), device=self._device)] * (len(self.numbers) - 3 - len(wrong))
        nll = torch.stack(surprise).mean()
        masses = nll.new_zeros(())
        if self._masses_validation:
            losses = [self._loss_of_masses(network, tracks) for tracks in self._masses_validation]
            masses = torch.stack(losses).mean().to(nll.dtype)
        return torch.stack([nll + masses, masses, nll, *wrong, torch.ones((), device=self._device)])


def train_belief(
    training: BeliefTraining,
    cache: Path,
    out: Path,
    device: str = "cpu",
    tell: Callable[[Progress, float], None] = lambda now, loss: None,
) -> Progress | None:
    """Train a belief network; see `conduct`."""
    return conduct(training, BeliefTask, cache, out, device, tell)
