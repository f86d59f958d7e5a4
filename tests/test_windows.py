"""Windows: frames of one push, reproducible, from memory or from disk, ragged or not."""

from pathlib import Path

import numpy as np
import pytest

from pushgraph.dataset import windows
from pushgraph.dataset.ragged import Recipe
from pushgraph.dataset.store import Columns, Dataset
from pushgraph.dataset.windows import WindowSampler
from pushgraph.errors import DatasetError
from pushgraph.simulation.setups import draw_trajectory


@pytest.fixture(scope="module")
def ragged(tmp_path_factory) -> Dataset:
    """Twelve trajectories with one, two or three bodies."""
    columns = Columns.of([draw_trajectory("multiple-parts", 1 + k % 3, 0, k) for k in range(12)])
    path = tmp_path_factory.mktemp("windows") / "data.h5"
    recipe = Recipe(setup="multiple-parts", objects=3, seed=0, first=0, count=12)
    Dataset.write(path, recipe, [columns])
    return Dataset(path)


def test_a_window_is_what_the_track_holds_and_stays_in_one_push(ragged: Dataset) -> None:
    sampler = WindowSampler(ragged, frames=6, batch=64, seed=3)
    tracks = [ragged[k] for k in range(12)]
    for step in range(20):
        batch = sampler.batch(step)
        assert batch.poses.shape == (64, 6, 4, 3)
        for k in range(64):
            track, nodes = tracks[batch.trajectory[k]], batch.nodes[k]
            frames = slice(batch.start[k], batch.start[k] + 6)
            assert nodes == track.poses.shape[1]
            np.testing.assert_array_equal(batch.poses[k, :, :nodes], track.poses[frames].astype(np.float32))
            np.testing.assert_array_equal(batch.initial_poses[k, :nodes], track.poses[0].astype(np.float32))
            assert not batch.poses[k, :, nodes:].any()
            assert len(set(track.push[frames])) == 1
            assert track.push[frames][0] >= 0
            assert batch.push_start[k] == track.push_start[batch.start[k]]


def test_every_trajectory_and_every_window_in_it_is_drawn_equally_often(ragged: Dataset) -> None:
    sampler = WindowSampler(ragged, frames=20, batch=4096, seed=0)
    expected = set()
    for k in range(12):
        push = ragged[k].push
        expected |= {(k, s) for s in range(len(push) - 19) if push[s] >= 0 and push[s] == push[s + 19]}
    counts: dict[tuple[int, int], int] = {}
    for step in range(40):
        batch = sampler.batch(step)
        for key in zip(batch.trajectory.tolist(), batch.start.tolist(), strict=True):
            counts[key] = counts.get(key, 0) + 1
    assert set(counts) == expected
    for trajectory in range(12):
        inside = [count for (owner, _), count in counts.items() if owner == trajectory]
        assert sum(inside) == pytest.approx(40 * 4096 / 12, rel=0.05)
        mean = sum(inside) / len(inside)
        assert max(inside) < mean + 6 * np.sqrt(mean)


def same(one, other) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("memory", [4 * 2**30, 1])
def test_a_batch_depends_on_seed_and_step_alone(ragged: Dataset, monkeypatch, memory: int) -> None:
    monkeypatch.setattr(windows, "SHARD", 2)
    steps = [0, 57, 3, 200]
    first = WindowSampler(ragged, batch=32, seed=1, memory=memory)
    second = WindowSampler(ragged, batch=32, seed=1, memory=memory)
    backwards = {step: second.batch(step) for step in reversed(steps)}
    assert all(same(first.batch(step), backwards[step]) for step in steps)
    assert not same(first.batch(0), first.batch(1))
    assert not same(first.batch(0), WindowSampler(ragged, batch=32, seed=2, memory=memory).batch(0))


def test_from_disk_every_trajectory_is_seen_once_an_epoch(ragged: Dataset, monkeypatch) -> None:
    monkeypatch.setattr(windows, "SHARD", 2)
    sampler = WindowSampler(ragged, batch=32, seed=1, memory=1)
    assert sampler.pools == 6
    for epoch in range(2):
        seen = []
        for pool in range(6):
            step = (6 * epoch + pool) * sampler.steps_per_pool
            members = {m for s in range(step, step + sampler.steps_per_pool) for m in sampler.batch(s).trajectory}
            assert len(members) == 2
            seen += sorted(members)
        assert sorted(seen) == list(range(12))


def test_windows_longer_than_any_push_and_bad_settings_are_refused(ragged: Dataset) -> None:
    with pytest.raises(DatasetError, match="no push lasts 5000 frames"):
        WindowSampler(ragged, frames=5000).batch(0)
    with pytest.raises(DatasetError, match="batch: must be at least 1, got 0"):
        WindowSampler(ragged, batch=0)
    with pytest.raises(DatasetError, match="memory: must be at least 1, got 0"):
        WindowSampler(ragged, memory=0)


def test_an_open_dataset_can_be_sampled_by_name(ragged: Dataset) -> None:
    with Dataset(Path(ragged.path)) as again:
        assert same(WindowSampler(again, seed=4).batch(9), WindowSampler(ragged, seed=4).batch(9))
