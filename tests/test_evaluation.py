"""The suite physics: its figures against hand-computed ones. README's command is run by the tests of the manual."""

import numpy as np
import pytest
import torch

from pushgraph.checkpoint import Checkpoint, save_checkpoint
from pushgraph.errors import EvaluationError
from pushgraph.evaluation.physics import HORIZONS, evaluate_physics, histogram
from pushgraph.evaluation.results import Results
from pushgraph.network.dynamics import DYNAMICS
from pushgraph.physics import PhysicsPredictor
from pushgraph.simulation.setups import draw_trajectory

COUNT, SEED = 2, 1_000_007


@pytest.fixture(scope="module")
def models(tmp_path_factory) -> dict[str, str]:
    """Untrained networks."""
    folder, paths = tmp_path_factory.mktemp("models"), {}
    for kind in ("propnet", "contact"):
        torch.manual_seed(0)
        config = {"hidden": 8, "steps": 2}
        paths[kind] = str(folder / f"{kind}.safetensors")
        save_checkpoint(Checkpoint(kind, config, DYNAMICS[kind](**config), {}), paths[kind])
    return paths


@pytest.fixture(scope="module")
def evaluated(models):
    return evaluate_physics([3], COUNT, SEED, models)


def row(results: Results, **labels):
    (found,) = [r for r in results.rows if all(r[name] == value for name, value in labels.items())]
    return found


def test_the_figures_are_those_of_the_protocol(evaluated, models) -> None:
    results, scenes = evaluated
    tracks = [draw_trajectory("multiple-parts", 3, SEED, k).track for k in range(COUNT)]
    predicted = PhysicsPredictor.load(models["contact"]).predict_many([track.scene for track in tracks], max(HORIZONS))
    for frames in HORIZONS:
        means, finals, lengths = [], [], []
        for track, guess in zip(tracks, predicted, strict=True):
            upto = min(frames, len(track.times))
            off = guess.poses[:upto, 1:, :2] - track.poses[:upto, 1:, :2]
            distance = 100 * np.sqrt((off**2).sum(-1))
            means.append(distance.mean())
            shift = track.poses[upto - 1, 1:, :2] - track.poses[0, 1:, :2]
            moved = np.sqrt((shift**2).sum(-1)) > 0.01
            finals += distance[-1][moved].tolist()
            lengths += (100 * np.sqrt((shift**2).sum(-1)))[moved].tolist()
        for metric, expected in (
            ("mean_error_cm", np.mean(means)),
            ("worst_error_cm", np.max(means)),
            ("final_error_moved_cm", np.mean(finals)),
            ("median_final_error_moved_cm", np.median(finals)),
            ("displacement_moved_cm", np.mean(lengths)),
            ("share_under_0.4_cm", np.mean(np.array(means) < 0.4)),
        ):
            found = row(results, model="contact", metric=metric, frames=frames, density="all")
            assert found["value"] == pytest.approx(expected, rel=1e-3), metric
            assert found["low"] <= found["value"] <= found["high"]
    assert histogram(scenes, "contact", 30).sum() == COUNT


def test_standing_still_and_the_simulator_are_there_to_compare_with(evaluated) -> None:
    results, _ = evaluated
    still = row(results, model="still", metric="final_error_moved_cm", frames=30, density="all")
    assert still["value"] == pytest.approx(
        row(results, model="still", metric="displacement_moved_cm", frames=30, density="all")["value"]
    )
    floor = row(results, model="noise_floor", metric="mean_error_cm", frames=30, density="all")
    assert 0.01 < floor["value"] < still["value"]
    for r in results.rows:
        assert set(r) == {"model", "metric", "value", "low", "high", "unit", "objects", "frames", "density"}


def test_two_workers_measure_the_same(evaluated, models) -> None:
    again, _ = evaluate_physics([3], COUNT, SEED, models, workers=2)
    assert again.rows == evaluated[0].rows


def test_training_seeds_are_refused(models) -> None:
    with pytest.raises(EvaluationError, match="seed 999999: seeds below 1,000,000 are for training"):
        evaluate_physics([3], 1, 999_999, models)


def test_statistics_and_their_intervals_by_hand() -> None:
    results = Results("physics", {}, ("frames",))
    values, scene = np.array([5.0, 1.0, 2.0, 2.0]), np.array([7, 7, 9, 9])
    for statistic, expected, bounds in (
        ("mean", 2.5, (2.0, 3.0)),
        ("median", 2.0, (2.0, 3.0)),
        ("max", 5.0, (2.0, 5.0)),
    ):
        results.add("still", statistic, "cm", values, scene, statistic, frames=30)
        found = results.rows[-1]
        assert found["value"] == expected
        assert (found["low"], found["high"]) == bounds
    results.add("still", "nothing", "cm", np.zeros(0), np.zeros(0, dtype=int), frames=30)
    assert results.rows[-1]["value"] is None
    with pytest.raises(ValueError, match="labels must be"):
        results.add("still", "mean", "cm", values, scene, horizon=30)
