"""Training of spreads: rollouts to learn from, the loss, and a tiny training that learns and resumes."""

import math

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from pushgraph.belief import BeliefModel
from pushgraph.checkpoint import load_checkpoint, shipped
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.errors import TrainingError
from pushgraph.network.spread_network import LEAST, LEAST_YAW, Scales
from pushgraph.simulation.setups import draw_trajectory
from pushgraph.spread import Spread
from pushgraph.training import loop, rollouts, spread
from pushgraph.training.processes import Processes
from pushgraph.training.rollouts import (
    RolloutMaker,
    Withheld,
    predicted_as_believed,
    predicted_as_known,
    withhold_values,
)
from pushgraph.training.run import TrainingRun
from pushgraph.training.spread import ScaledErrors, SpreadTraining, misses, surprise, train_spread

TINY = {"frames": 24, "batch": 2, "hidden": 8, "rollouts": 8, "learning_rate": 2e-2}


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> dict[str, str]:
    """Four trajectories of three bodies to learn from, two to choose by."""
    paths = {}
    for name, seed, count in (("data", 0, 4), ("validation", 1, 2)):
        path = tmp_path_factory.mktemp("training") / f"{name}.h5"
        columns = Columns.of([draw_trajectory("multiple-parts", 3, seed, k) for k in range(count)])
        recipe = Recipe(setup="multiple-parts", objects=3, seed=seed, first=0, count=count)
        Dataset.write(path, recipe, [columns])
        paths[name] = str(path)
    return paths


@pytest.fixture(scope="module")
def dynamics():
    return load_checkpoint(shipped("contact")).network.requires_grad_(False)


@pytest.fixture(autouse=True)
def short(monkeypatch) -> None:
    monkeypatch.setattr(rollouts, "LONGEST_WATCH", 10)
    monkeypatch.setattr(rollouts, "LONG_FRAMES", 40)
    monkeypatch.setattr(spread, "VALIDATION_FRAMES", 30)
    monkeypatch.setattr(spread, "VALIDATION_WATCHES", (0, 5))


def test_rollouts_start_from_the_truth_and_stand_beside_it(data, dynamics) -> None:
    tracks = [Dataset(data["data"])[k] for k in range(3)]
    example = predicted_as_known(tracks, [0, 10, 30], 20, dynamics)
    torch.testing.assert_close(example.poses[:, 0], example.true[:, 0])
    np.testing.assert_allclose(example.true[1].numpy(), tracks[1].poses[10:30, 1:], atol=1e-6)
    np.testing.assert_allclose(example.tool[2].numpy(), tracks[2].poses[30:50, 0], atol=1e-6)
    motion = tracks[2].poses[30, 1:] - tracks[2].poses[29, 1:]
    np.testing.assert_allclose(example.first_motion[2].numpy(), motion, atol=1e-6)
    assert not example.first_motion[0].any()
    assert not example.doubt.any()
    assert not example.counts[:, 0].any()
    assert example.counts[:, 1:].all()


def test_beyond_its_end_a_track_does_not_count(data, dynamics) -> None:
    track = Dataset(data["data"])[0]
    last = len(track.times) - 5
    example = predicted_as_known([track], [last], 12, dynamics)
    assert example.counts[0].tolist() == [False] + [True] * 4 + [False] * 7
    assert not example.down[0, 5:].any()


def test_believed_joints_are_those_that_were_watched_and_doubt_falls(data, dynamics) -> None:
    tracks = [Dataset(data["data"])[k] for k in range(4)]
    belief = BeliefModel.load()
    early, late = (predicted_as_believed(tracks, first, 10, dynamics, belief) for first in (0, 60))
    assert ((early.doubt >= 0) & (early.doubt <= 1)).all()
    assert float(late.doubt.mean()) < 0.7 * float(early.doubt.mean())
    np.testing.assert_allclose(late.true[0, 0].numpy(), tracks[0].poses[60, 1:], atol=1e-6)


def test_withheld_values_are_nominal_and_flagged(data) -> None:
    from pushgraph.graph.scene_batch import batch_scenes
    from pushgraph.scene import NOMINAL_MASS

    scenes = batch_scenes([Dataset(data["data"]).scene(k % 4) for k in range(400)])
    some = withhold_values(scenes, Withheld.drawn(np.random.default_rng(0), 400, scenes.mass.shape[1]))
    hidden = scenes.mass_known & ~some.mass_known
    assert 0.06 < float(hidden.float().mean()) < 0.16
    assert (some.mass[hidden] == NOMINAL_MASS).all()
    assert torch.equal(some.mass[~hidden], scenes.mass[~hidden])
    assert 0.1 < float((~some.table_friction_known).float().mean()) < 0.2


def test_surprise_is_the_logarithm_of_a_density() -> None:
    # Its integral over a grid, yaw included, is one but for what is left out: 2 pi, 2, and the least scales.
    one = torch.ones(1, dtype=torch.float64)
    scales = Scales(along=2 * one, across=one, degrees=8 * one, yaw=0.5 * one, yaw_degrees=9 * one)
    place, turn = torch.linspace(-20, 20, 201, dtype=torch.float64), torch.linspace(-8, 8, 161, dtype=torch.float64)
    grid = torch.stack(torch.meshgrid(place, place, turn, indexing="ij"), -1)
    direction = torch.full((grid[..., 0].numel(), 1), 0.7, dtype=torch.float64)
    errors = ScaledErrors.of(scales, direction, grid.flatten(0, 2)[:, None])
    density = (-surprise(scales, errors)).exp() / (LEAST**2 * LEAST_YAW)
    total = float(density.sum()) * 0.2 * 0.2 * 0.1 / (2 * math.pi * 2)
    assert total == pytest.approx(1, abs=0.02)


def test_bounds_are_missed_least_where_so_many_errors_are_within() -> None:
    # Positions are a little or far off, as if a joint were there or not: no Student t fits, but its bounds shall.
    torch.manual_seed(0)
    size = torch.where(torch.rand(4000) < 0.5, 0.01, 1.0) * (0.3 + 1.7 * torch.rand(4000))
    turn = 0.02 * torch.rand(4000).log().square()  # so small that no turn is wrapped
    error = torch.stack((size, torch.zeros_like(size), turn), -1)[:, None]
    logs = torch.zeros(4, requires_grad=True)
    optimizer = torch.optim.Adam([logs], lr=0.05)
    slower = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.01, total_iters=600)
    for _ in range(600):
        scale, degrees, yaw, yaw_degrees = logs.exp().unsqueeze(-1)
        scales = Scales(along=scale, across=scale, degrees=1 + degrees, yaw=yaw, yaw_degrees=1 + yaw_degrees)
        optimizer.zero_grad()
        misses(scales, ScaledErrors.of(scales, torch.zeros(len(error), 1), error)).mean().backward()
        optimizer.step()
        slower.step()
    stated = Spread(direction=torch.zeros(1), farthest=torch.full((1,), 1e3), **scales._asdict())
    for level in (stated.position_level(error[..., :2]), stated.yaw_level(error[..., 2])):
        assert abs(float((level < 0.68).float().mean()) - 0.68) < 0.06
        assert abs(float((level < 0.95).float().mean()) - 0.95) < 0.06


def test_the_same_batches_come_again(data, dynamics) -> None:
    dataset, belief = Dataset(data["data"]), BeliefModel.load()
    makers = [RolloutMaker(dataset, dynamics, belief, 8, 2, seed=3) for _ in range(2)]
    assert len(makers[0]) == 4
    for number in range(4):
        first, again = (maker(number, 16, Processes()) for maker in makers)
        assert torch.equal(first.poses, again.poses)
        assert torch.equal(first.doubt, again.doubt)
        # Two processes make the same batch together.
        halves = [makers[0](number, 16, Processes(rank, 2)) for rank in range(2)]
        joined = torch.cat([F.pad(half.true, (0, 0, 0, first.true.shape[2] - half.true.shape[2])) for half in halves])
        assert torch.equal(joined[:, : first.true.shape[1]], first.true)


def test_training_learns_and_goes_on_where_it_stopped(data, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(loop, "SAVE_EVERY", 0.0)
    monkeypatch.setattr(SpreadTraining, "VALIDATIONS", 4)
    # Validated on what it learns from: of eight rollouts nothing can be learnt that holds elsewhere.
    seen = data | {"validation": data["data"]}
    training = SpreadTraining(**seen, samples=24 * 2 * 48, **TINY)
    run, other = (TrainingRun(out=str(tmp_path / f"{name}.safetensors")) for name in ("whole", "pieces"))
    train_spread(training, run)
    whole = load_checkpoint(tmp_path / "whole.safetensors")
    curve = whole.record["curve"]
    assert curve[-1]["loss_of_bodies"] < curve[0]["loss_of_bodies"]
    assert whole.physics == load_checkpoint(shipped("contact")).hash

    def stop(now, loss) -> None:
        if now.step == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_spread(training, other, tell=stop)
    train_spread(training, other)
    pieces = load_checkpoint(tmp_path / "pieces.safetensors")
    for name, values in whole.network.state_dict().items():
        assert torch.equal(pieces.network.state_dict()[name], values)


def test_bad_trainings_are_refused(data) -> None:
    with pytest.raises(TrainingError, match="no network 'magic' to train; valid: spread"):
        SpreadTraining(model="magic", **data, samples=10, **TINY)
    with pytest.raises(TrainingError, match="rollouts: must be a batch at least, 2; got 1"):
        SpreadTraining(**data, samples=10, **TINY | {"rollouts": 1})
    assert SpreadTraining(**data).hidden == 32
