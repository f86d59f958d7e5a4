"""Training of belief regulation."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple, cast

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from pushgraph.belief import load_physics, watch_windows
from pushgraph.dataset.sequences import SequenceSampler
from pushgraph.graph.joint_truth import adjacent_pairs, touched_pairs, true_joints, unaware
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.network.belief_network import BELIEFS, BeliefNetwork, BeliefRecipe, Rows
from pushgraph.network.contract import Foreseeing
from pushgraph.scene_range import range_of
from pushgraph.training.conduct import conduct, nothing, open_dataset
from pushgraph.training.masses import Weighed, mass_loss, weighed
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import BeliefTraining
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress
from pushgraph.training.seeds import seed_of
from pushgraph.training.validation import Rollouts, validation_tracks
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


class Answers(NamedTuple):
    """Log-odds after every frame of windows, for the pairs that ever had memory, and from when on they had it.

    restless: squared change of the memory of pairs, summed over its numbers, in every frame after the first.
    """

    rows: Rows
    log_odds: Float[Tensor, "frames rows joints"]
    begun: Bool[Tensor, "frames rows"]
    restless: Float[Tensor, "frames_after_first rows 2"]


def answers(network: BeliefRecipe, dynamics: Foreseeing, seen: Watched) -> Answers:
    """Watch windows and answer after every frame."""
    rows, active, memories = watch_windows(network, dynamics, seen.scenes, seen.poses, seen.tool, seen.down, seen.seen)
    log_odds = torch.stack([network.answer(memory, rows) for memory in memories])
    relations = torch.stack([memory.relations for memory in memories])
    restless = relations.diff(dim=0).square().sum(-1)
    return Answers(rows, log_odds, active.cumsum(0) > 0, restless)


def belief_loss(
    network: BeliefRecipe,
    dynamics: Foreseeing,
    seen: Watched,
    mean: Callable[[Tensor], Tensor] = lambda weight: weight,
) -> Float[Tensor, ""]:
    """Cross-entropy of the answers, growing in weight with time, and what keeps memories smooth.

    mean: over the processes that share the batch, of what is divided by.
    """
    answered = answers(network, dynamics, seen)
    frames = len(answered.log_odds)
    growing = torch.linspace(0, LAST_WEIGHT, frames, device=answered.log_odds.device)
    weight = growing[:, None] * answered.begun * seen.lasts[answered.rows.scene].T
    joint = seen.joint[answered.rows.scene, answered.rows.pair].expand(frames, -1)
    surprise = functional.cross_entropy(answered.log_odds.flatten(0, 1).float(), joint.flatten(), reduction="none")
    counts = torch.stack((weight.sum(), weight.new_tensor(float(answered.restless.numel()))))
    total_weight, changes = mean(counts).clamp(min=1e-9)
    return (surprise * weight.flatten()).sum() / total_weight + SMOOTH * answered.restless.sum() / changes


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
        self._training, self._processes, self._device = training, processes, device
        data, validation = open_dataset(training.data), open_dataset(training.validation)
        self.range = range_of(data.scene(k) for k in range(len(data)))
        self.data_recipe, self.validation_recipe = (dataclasses.asdict(some.recipe) for some in (data, validation))
        seed = seed_of("sequences", seed=training.seed)
        self._sampler = SequenceSampler(data, training.frames, training.batch, seed)
        below = load_physics(BELIEFS[training.model].PHYSICS, training.physics)
        self.physics = below.hash
        self._dynamics = cast(Foreseeing, below.network.to(device).requires_grad_(False))
        tracks = validation_tracks(validation, processes, VALIDATION_SCENES)
        scenes, poses, down, lasts = Rollouts.of(tracks, VALIDATION_FRAMES)
        tool, bodies = poses[:, :, 0], poses[:, :, 1:]
        generator = torch.Generator().manual_seed(seed_of("validation noise", rank=processes.rank))
        noise = torch.randn(bodies.shape, generator=generator)
        everything = torch.ones(bodies.shape[:3], dtype=torch.bool)
        self._adjacent = adjacent_pairs(scenes, bodies[:, 0]).to(device)
        self._touched = touched_pairs(self._adjacent, bodies.to(device))
        self._masses, self._masses_validation = self._open_masses()
        self._validation = [
            Watched(
                unaware(scenes),
                bodies + size * noise * bodies.new_tensor([NOISE[0], NOISE[0], NOISE[1]]),
                tool,
                down,
                everything,
                lasts,
                true_joints(scenes),
            ).to(device)
            for size in (0.0, 1.0)
        ]

    def _open_masses(self) -> tuple[SequenceSampler | None, list[Weighed]]:
        """What masses are learnt from, and what that is validated on."""
        training, rank = self._training, self._processes.rank
        if training.masses is None or training.masses_validation is None:
            return None, []
        batch = max(self._processes.count, training.batch // MASS_SHARE)
        data, validation = open_dataset(training.masses), open_dataset(training.masses_validation)
        sampler = SequenceSampler(data, MASS_FRAMES, batch, seed_of("masses", seed=training.seed))
        fixed = SequenceSampler(validation, MASS_FRAMES, MASS_VALIDATION // 2, seed_of("mass validation", rank=rank))
        generator = torch.Generator().manual_seed(seed_of("mass validation noise", rank=rank))
        return sampler, [weighed(fixed.batch(k), generator) for k in range(2)]

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Loss of the step's sequences."""
        losses = [] if self._training.keep_joints else [self._loss_of_joints(network, step)]
        if self._masses is not None:
            whole = weighed(self._masses.batch(step), self._generator("weighed", step))
            share = self._processes.share(len(whole.true))
            tracks = map_tensors(lambda values: values[share], whole)
            of_batch = len(tracks.true) * self._processes.count / len(whole.true)
            losses.append(self._loss_of_masses(network, tracks) * of_batch)
        return torch.stack(losses).sum()

    def _generator(self, purpose: str, step: int) -> torch.Generator:
        return torch.Generator().manual_seed(seed_of(purpose, seed=self._training.seed, step=step))

    def _loss_of_masses(self, network: nn.Module, tracks: Weighed) -> Tensor:
        noise = cast(BeliefNetwork, network).mass_noise
        assert noise is not None
        here = map_tensors(lambda values: values.to(self._device), tracks)
        return mass_loss(noise, self._dynamics, here).float()

    def _loss_of_joints(self, network: nn.Module, step: int) -> Tensor:
        whole = watched(self._sampler.batch(step), self._generator("watched", step))
        share = self._processes.share(self._training.batch)
        seen = map_tensors(lambda values: values[share], whole).to(self._device)
        half = self._training.precision == "bfloat16"
        with torch.autocast(self._device.type, torch.bfloat16, enabled=half):
            return belief_loss(cast(BeliefRecipe, network), self._dynamics, seen, self._processes.mean)

    def validate(self, network: nn.Module) -> Float[Tensor, "2 numbers"]:
        """Sums over pairs of `numbers`, and how many pairs there are; of the first all, after the last frame seen."""
        surprise, wrong = [], []
        for seen in self._validation:
            answered = answers(cast(BeliefRecipe, network), self._dynamics, seen)
            joint = seen.joint[answered.rows.scene, answered.rows.pair]
            adjacent = self._adjacent[answered.rows.scene, answered.rows.pair]
            for frame in VALIDATED:
                # Where trajectories are shorter, their last frame stands for it.
                frame = min(frame, len(answered.log_odds))
                log_odds = answered.log_odds[frame - 1].float()
                losses = functional.cross_entropy(log_odds[adjacent], joint[adjacent], reduction="sum")
                surprise.append(torch.stack((losses, adjacent.sum().to(losses.dtype))))
                touched = self._touched[answered.rows.scene, frame - 1, answered.rows.pair]
                failed = (log_odds.argmax(-1) != joint)[touched].to(losses.dtype)
                wrong.append(torch.stack((failed.sum(), failed.new_tensor(float(len(failed))))))
        of_touched = [wrong[VALIDATED.index(frame) + offset] for offset in (0, len(VALIDATED)) for frame in (40, 200)]
        nll, masses = torch.stack(surprise).sum(0), surprise[0].new_zeros(2)
        if self._masses_validation:
            each = torch.stack([self._loss_of_masses(network, tracks) for tracks in self._masses_validation])
            masses = torch.stack((each.mean().to(nll.dtype), nll.new_ones(())))
        total = torch.stack((nll[0] + masses[0] * nll[1], nll[1]))  # of means
        return torch.stack([total, masses, nll, *of_touched], 1)


def train_belief(
    training: BeliefTraining,
    run: TrainingRun,
    tell: Callable[[Progress, float], None] = nothing,
    say: Callable[[str], None] = nothing,
) -> Progress | None:
    """Train a belief network; see `conduct`."""
    return conduct(training, BeliefTask, run, tell, say)
