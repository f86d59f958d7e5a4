"""Training of spreads: how far off predictions are, learnt from rollouts of the shipped physics weights."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pushgraph.belief import BeliefModel
from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.errors import TrainingError
from pushgraph.graph.scene_batch import map_tensors
from pushgraph.graph.track_features import TrackFeatures, track_features
from pushgraph.network.contract import Dynamics
from pushgraph.network.spread_network import LEAST, LEAST_YAW, Scales, SpreadNetwork
from pushgraph.scene_range import range_of
from pushgraph.spread_model import spread_at_knots
from pushgraph.training.conduct import conduct, nothing, open_dataset
from pushgraph.training.processes import Processes
from pushgraph.training.recipe import SpreadTraining
from pushgraph.training.rollouts import Predicted, RolloutMaker, predicted_as_believed, predicted_as_known
from pushgraph.training.run import TrainingRun
from pushgraph.training.running import Progress
from pushgraph.training.seeds import seed_of
from pushgraph.training.validation import validation_tracks

MOVED, SELDOM = 1e-3, 0.03
"""Bodies that have moved less than this (m), truly and as predicted, weigh so much."""
MOVED_FAR = 0.01
"""Bodies that have moved more than this (m) count in the validation's coverage."""
VALIDATION_FRAMES = 51
VALIDATION_WATCHES = (0, 20, 40, 100)
"""Observed frames before the rollouts with believed joints that weights are chosen and calibrated by."""
CALIBRATED, MISSES = (0.68, 0.95), 6.0
"""Bounds that are fitted by themselves beside the density, and their weight."""
TINY = 1e-30
"""Keeps logarithms finite where there is no error at all; any larger one shall draw its scale."""


def features_of(example: Predicted) -> TrackFeatures:
    """Features of rollouts."""
    return track_features(
        example.scenes,
        example.relations,
        example.poses,
        example.tool,
        example.down,
        example.doubt,
        example.first_motion,
    )


class ScaledErrors(NamedTuple):
    """Errors in scales. square: of the position's. turn: the yaw's, without its sign."""

    square: Float[Tensor, "*batch bodies"]
    turn: Float[Tensor, "*batch bodies"]

    @classmethod
    def of(
        cls, scales: Scales, direction: Float[Tensor, "*batch bodies"], error: Float[Tensor, "*batch bodies 3"]
    ) -> "ScaledErrors":
        """Errors (m, m, rad; world axes) in the scales that are stated."""
        cos, sin = direction.cos(), direction.sin()
        x, y, yaw = error.unbind(-1)
        along, across = (cos * x + sin * y) / scales.along, (cos * y - sin * x) / scales.across
        return cls(along**2 + across**2, yaw.abs() / scales.yaw)


def surprise(scales: Scales, errors: ScaledErrors) -> Float[Tensor, "*batch bodies"]:
    """Negative logarithm of the density of errors (`pushgraph.spread`), beyond that of none in the least scales."""
    size = (scales.along / LEAST).log() + (scales.across / LEAST).log() + (scales.yaw / LEAST_YAW).log()
    position = (scales.degrees / 2 + 1) * (errors.square / scales.degrees).log1p()
    turn = (scales.yaw_degrees + 1) * (errors.turn / scales.yaw_degrees).log1p()
    return size + position + turn


def misses(scales: Scales, errors: ScaledErrors) -> Float[Tensor, "*batch bodies"]:
    """How far errors are beyond or within their bounds of 68 and 95 %, in logarithms.

    Least where just so many are within, whatever the true distribution: it may be one of two ways to go. This is the
    pinball loss of quantile regression (Koenker and Bassett 1978).
    """
    total = torch.zeros_like(errors.square)
    for probability in CALIBRATED:
        for size, bound in (
            (errors.square.clamp(min=TINY).log() / 2, _radius(scales.degrees, probability).log()),
            (errors.turn.clamp(min=TINY).log(), _turn(scales.yaw_degrees, probability).log()),
        ):
            beyond = size - bound
            total = total + torch.where(beyond > 0, probability, probability - 1) * beyond
    return total


def _radius(degrees: Tensor, probability: float) -> Tensor:
    return (degrees * ((1 - probability) ** (-2 / degrees) - 1)).sqrt()


def _turn(degrees: Tensor, probability: float) -> Tensor:
    return degrees * ((1 - probability) ** (-1 / degrees) - 1)


class SpreadTask:
    """Surprise at the errors of rollouts, and how bounds are missed; validation with joints given and believed."""

    numbers: tuple[str, ...] = ("loss_of_bodies", "coverage_68", "coverage_95", "yaw_coverage_68", "yaw_coverage_95")

    def __init__(self, training: SpreadTraining, processes: Processes, device: torch.device) -> None:
        self._training, self._processes, self._device = training, processes, device
        data, validation = open_dataset(training.data), open_dataset(training.validation)
        self.range = range_of(data.scene(k) for k in range(len(data)))
        self.data_recipe, self.validation_recipe = (dataclasses.asdict(some.recipe) for some in (data, validation))
        below = load_checkpoint(shipped(SpreadNetwork.PHYSICS))
        self.physics = below.hash
        dynamics = cast(Dynamics, below.network.requires_grad_(False))
        belief = BeliefModel.load()
        seed = seed_of("rollouts", seed=training.seed)
        maker = RolloutMaker(data, dynamics, belief, training.rollouts, training.batch, seed)
        self._batches = len(maker)
        # Made once, on the processor, and kept there.
        self._batch = functools.cache(lambda number: maker(number, training.frames, processes))
        tracks = validation_tracks(validation, processes)
        known = predicted_as_known(tracks, [0] * len(tracks), VALIDATION_FRAMES, dynamics)
        believed = [predicted_as_believed(tracks, k, VALIDATION_FRAMES, dynamics, belief) for k in VALIDATION_WATCHES]
        self.validation = [map_tensors(lambda values: values.to(device), some) for some in (known, *believed)]
        if not any(_moved_far(example, features_of(example)).any() for example in self.validation):
            raise TrainingError(f"validation: {training.validation}: no body moves {100 * MOVED_FAR:g} cm")

    def loss(self, network: nn.Module, step: int) -> Tensor:
        """Mean loss of the bodies in the step's batch."""
        epoch, place = divmod(step, self._batches)
        generator = torch.Generator().manual_seed(seed_of("order", seed=self._training.seed, epoch=epoch))
        number = int(torch.randperm(self._batches, generator=generator)[place])
        example = map_tensors(lambda values: values.to(self._device), self._batch(number))
        weight, value = _weighed(network, example, features_of(example))
        return (weight * value).sum() / self._processes.mean(weight.sum()).clamp(min=1 / self._processes.count)

    def validate(self, network: nn.Module) -> Float[Tensor, "2 numbers"]:
        """Sums over bodies in frames of `numbers`, and how many there are."""
        found = []
        for example in self.validation:
            features = features_of(example)
            weight, value = _weighed(network, example, features)
            spread, knots = spread_at_knots(network(features), features), features.knots
            error = (example.true - example.poses)[:, knots]
            moved = _moved_far(example, features)
            levels = spread.position_level(error[..., :2]), spread.yaw_level(error[..., 2])
            covered = [(level[moved] < p).to(value.dtype).sum() for level in levels for p in CALIBRATED]
            sums = torch.stack(((weight * value).sum(), *covered))
            weights = torch.stack((weight.sum(), *[moved.sum().to(value.dtype)] * len(covered)))
            found.append(torch.stack((sums, weights)))
        return torch.stack(found).sum(0)


def _weighed(network: nn.Module, example: Predicted, features: TrackFeatures) -> tuple[Tensor, Tensor]:
    """Weights of bodies in frames, and the loss of each."""
    knots = features.knots
    error = (example.true - example.poses)[:, knots]
    scales = network(features)
    errors = ScaledErrors.of(scales, features.direction, error)
    value = surprise(scales, errors) + MISSES * misses(scales, errors)
    there = example.counts[:, knots, None] & example.scenes.present[:, None] & ~example.scenes.immovable[:, None]
    moved = _moved(example, features, MOVED)
    return there * torch.where(moved, 1.0, SELDOM), value


def _moved(example: Predicted, features: TrackFeatures, distance: float) -> Tensor:
    """Bodies that are so far from where they started, truly or as predicted."""
    gone = [(poses[:, features.knots] - poses[:, :1])[..., :2].norm(dim=-1) for poses in (example.poses, example.true)]
    return (gone[0] > distance) | (gone[1] > distance)


def _moved_far(example: Predicted, features: TrackFeatures) -> Tensor:
    """Bodies, in the frames that count, whose errors tell how wide spreads have to be."""
    return _moved(example, features, MOVED_FAR) & example.counts[:, features.knots, None]


@torch.no_grad()
def calibrate(network: SpreadNetwork, task: SpreadTask) -> None:
    """Widen the scales of positions, and those of yaws, so that 68 % of the validation's errors are within 68 %."""
    needed: list[tuple[Tensor, Tensor]] = []
    for example in task.validation:
        features = features_of(example)
        scales = network(features)
        errors = ScaledErrors.of(scales, features.direction, (example.true - example.poses)[:, features.knots])
        moved = _moved_far(example, features)
        position = errors.square.sqrt() / _radius(scales.degrees, CALIBRATED[0])
        turn = errors.turn / _turn(scales.yaw_degrees, CALIBRATED[0])
        needed.append((position[moved], turn[moved]))
    network.widening.copy_(
        torch.stack([torch.cat(some).quantile(CALIBRATED[0]) for some in zip(*needed, strict=True)])
    )


def train_spread(
    training: SpreadTraining,
    run: TrainingRun,
    tell: Callable[[Progress, float], None] = nothing,
    say: Callable[[str], None] = nothing,
) -> Progress | None:
    """Train a network that states spreads; see `conduct`."""
    return conduct(training, SpreadTask, run, tell, say, calibrate)
