"""The suites of masses: figures worked by hand, laws between the models, and what is refused."""

import json
from typing import NamedTuple

import numpy as np
import pytest
import torch
from jaxtyping import Float
from scenes import body
from torch import Tensor
from typer.testing import CliRunner

from pushgraph import cli
from pushgraph.belief import BeliefModel, Watch
from pushgraph.errors import EvaluationError
from pushgraph.evaluation import controlled_masses
from pushgraph.evaluation.blocks import Block
from pushgraph.evaluation.controlled_masses import (
    ControlledScene,
    confusion,
    evaluate_controlled_masses,
    hardly_different,
    histogram,
    mix_ups,
    reference_histogram,
)
from pushgraph.evaluation.coupled import CoupledErrors, mean_and_standard_error
from pushgraph.evaluation.coupled_masses import evaluate_coupled_masses
from pushgraph.evaluation.exact_masses import ExactObserver
from pushgraph.evaluation.mass_answers import MassAnswer, prior_answer
from pushgraph.evaluation.mass_figures import save_alike
from pushgraph.evaluation.masses import evaluate_masses, ratio_observer_over_time
from pushgraph.evaluation.noise_floor import CAMERA
from pushgraph.evaluation.ratio_table import simulated_table
from pushgraph.evaluation.sensing import on_table
from pushgraph.graph.contact_graph import GRAVITY
from pushgraph.mass_prior import MASS_CLASSES
from pushgraph.scene import NOMINAL_TABLE_FRICTION, Scene
from pushgraph.simulation.masses import controlled_scene
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.setups import Trajectory
from pushgraph.tool import Push

SEED = 1_000_003
LIGHT, NORMAL, HEAVY = np.eye(3)


class Masses(NamedTuple):
    probabilities: Float[Tensor, "batch bodies classes"]
    median: Float[Tensor, "batch bodies"]
    low: Float[Tensor, "batch bodies"]
    high: Float[Tensor, "batch bodies"]
    slide_median: Float[Tensor, "batch bodies"]
    slide_low: Float[Tensor, "batch bodies"]
    slide_high: Float[Tensor, "batch bodies"]


class PriorBelief(BeliefModel):
    """Answers the prior before a sensor was read, then what an infinitely good sensor in every body would."""

    def __init__(self) -> None:
        self.sensed: Tensor | None = None

    def begin(self, scenes, poses, tool, down, seen) -> Watch:
        self.scenes, self.sensed, self.frames = scenes, None, 1
        return Watch(*[None] * len(Watch._fields))

    def observe(self, watch, poses, tool, down, seen, wrench=None) -> Watch:
        self.frames += 1
        self.sensed = wrench
        return watch

    def masses(self, watch) -> Masses:
        shape = self.scenes.mass.shape
        assert not self.scenes.mass_known.any()
        prior = prior_answer(MASS_CLASSES, shape[1])
        told = [torch.from_numpy(part).expand(shape[0], *part.shape) for part in prior]
        slide = [GRAVITY * NOMINAL_TABLE_FRICTION * values for values in told[:3]]
        if self.sensed is not None:
            slide = [torch.full(shape, value).double() for value in (10.0, 5.0, 20.0)]
        return Masses(told[3], *told[:3], *slide)


@pytest.fixture
def prior_belief(monkeypatch) -> None:
    monkeypatch.setattr(BeliefModel, "load", classmethod(lambda cls, path: PriorBelief()))


def row(results, **labels):
    (found,) = [r for r in results.rows if all(r[name] == value for name, value in labels.items())]
    return found["value"]


def three_in_a_row() -> Trajectory:
    """The tool pushes a light cylinder into a heavy one; a normal one stands beside."""
    scene = Scene(
        bodies=(
            body("a", 0.0, 0.0, mass=0.4),
            body("b", 0.15, 0.01, mass=9.0),
            body("c", 0.0, 0.5, mass=1.5),
        ),
        pushes=(
            Push(start=(-0.3, 0.0), end=(0.1, 0.0), speed=0.3),
            Push(start=(0.1, 0.3), end=(0.1, 0.35), speed=0.3),
        ),
    )
    return Trajectory(simulate(scene), "dense", "paper", {})


@pytest.fixture
def row_of_three(monkeypatch) -> Trajectory:
    drawn = three_in_a_row()
    monkeypatch.setattr(Block, "draw", lambda block: [drawn] * block.count)
    return drawn


# masses


def test_masses_are_scored_as_worked_by_hand(prior_belief, row_of_three) -> None:
    results, scenes = evaluate_masses([3], 2, SEED, {"belief": "belief"})
    end = {"objects": 3, "observed_frames": "end", "metric": "mean_abs_error_kg"}
    # The prior's median is 1.5 kg, its mean 3.617 kg.
    motion = {"input": "motion", "model": "belief"}
    assert row(results, subset="all", **motion, **end) == pytest.approx((1.1 + 7.5 + 0.0) / 3)
    assert row(results, subset="touched", **motion, **end) == pytest.approx((1.1 + 7.5) / 2)
    assert row(results, subset="pushed", **motion, **end) == pytest.approx((1.1 + 7.5) / 2)
    assert row(results, subset="touched", **motion, **end | {"observed_frames": 10}) is None
    mean = (0.35 + 1.5 + 9.0) / 3
    expected = np.abs(mean - np.array([0.4, 9.0, 1.5])).mean()
    assert row(results, subset="all", input="motion", model="mean_guess", **end) == pytest.approx(expected)
    # A ratio of 22.5 is that of light and heavy alone; what stands beside is not known better than before.
    right = end | {"metric": "interval_accuracy", "model": "ratio_observer", "input": "motion", "subset": "touched"}
    assert row(results, **right) == 1.0
    assert row(results, subset="touched", input="motion", model="ratio_observer", **end) < 0.5
    told = scenes[0].beliefs["motion"].answers["ratio_observer"]
    assert told.median[0].tolist() == [1.5, 1.5, 1.5]
    assert told.median[-1, 2] == 1.5
    # Only what a sensor changes is told once more, and only of the belief.
    assert {r["model"] for r in results.rows if r["input"] == "force"} == {"belief"}
    assert {r["input"] for r in results.rows if r["metric"] == "slide_error"} == {"force_friction_unknown"}


def test_newtons_to_slide_are_those_of_the_table_that_is_not_known(prior_belief, row_of_three) -> None:
    results, scenes = evaluate_masses([3], 1, SEED, {"belief": "belief"})
    slide = scenes[0].beliefs["force_friction_unknown"].slide
    friction = slide / (GRAVITY * np.array([0.4, 9.0, 1.5]))
    assert np.ptp(friction) < 1e-9
    assert 0.2 < friction[0] < 0.6
    np.testing.assert_allclose(scenes[0].beliefs["force"].slide, GRAVITY * 0.45 * np.array([0.4, 9.0, 1.5]))
    labels = {"objects": 3, "observed_frames": "end", "subset": "all", "input": "force_friction_unknown"}
    assert row(results, metric="slide_error", **labels) == pytest.approx(np.median(np.abs(10 / slide - 1)))
    held = ((slide >= 5) & (slide <= 20)).mean()
    assert row(results, metric="slide_coverage_68", **labels) == pytest.approx(held)


def test_pushes_on_another_table_are_the_same_as_far_as_they_can_be_made(row_of_three) -> None:
    track = row_of_three.track
    elsewhere = on_table(track, 0.2)
    assert elsewhere.scene.table.friction == 0.2
    assert elsewhere.scene.pushes == track.scene.pushes
    np.testing.assert_allclose(elsewhere.poses[: len(track.poses), 0], track.poses[:, 0])
    steady = slice(21, 26)
    less, usual = (np.linalg.norm(some.wrench[steady, :2], axis=1).mean() for some in (elsewhere, track))
    assert less / usual == pytest.approx(0.2 / 0.45, rel=0.05)


def test_the_ratio_observer_learns_when_bodies_touch() -> None:
    pairs = np.array([[False, False, False], [True, False, False], [True, False, True]])  # ab, then ab and bc
    told = ratio_observer_over_time(np.array([0.4, 9.0, 1.5]), pairs, MASS_CLASSES)
    np.testing.assert_allclose(told.probabilities[0], 1 / 3)
    np.testing.assert_allclose(told.probabilities[1], [LIGHT, HEAVY, [1 / 3] * 3], atol=1e-9)
    np.testing.assert_allclose(told.probabilities[2], [LIGHT, HEAVY, NORMAL], atol=1e-9)


# controlled-masses


def controlled(true: list[float], said: list[float], shift: float = 0.0) -> ControlledScene:
    probabilities = np.stack([(LIGHT, NORMAL, HEAVY)[int(mass > 0.5) + int(mass > 2)] for mass in said])
    answer = MassAnswer(*[np.array(said)] * 3, probabilities)
    poses = np.zeros((4, len(true), 3))
    poses[2:, :, 0] = shift
    return ControlledScene(len(true), np.array(true), poses, {("belief", "motion"): answer})


SCENES = [
    controlled([0.3, 1.5], [0.4, 1.1]),  # errs by 0.25 kg
    controlled([0.3, 1.5], [1.3, 2.0], 0.1),  # by 0.75
    controlled([1.5, 8.0], [0.3, 1.5], 0.001),  # by 3.85
    controlled([0.3, 9.0], [9.0, 9.0], 0.2),  # by 4.35
]


def test_histograms_and_confusion_are_as_counted_by_hand() -> None:
    assert histogram(SCENES, "belief", "motion").tolist() == [2, 0, 1, 1, 0]
    # Root mean squares over three nodes: 0.24, 0.65, 3.82, 5.02 kg.
    assert reference_histogram(SCENES, "belief", "motion").tolist() == [2, 0, 0, 2, 0]
    assert mix_ups(SCENES, "belief", "motion").tolist() == [1, 2, 1]
    assert confusion(SCENES, "belief", "motion").tolist() == [[1, 1, 1], [1, 2, 0], [0, 1, 1]]


def test_the_pair_that_looks_alike_weighs_differently(tmp_path) -> None:
    first, second, apart = hardly_different(SCENES)
    assert (first, second) == (0, 2)
    assert apart == pytest.approx(0.0005)
    assert save_alike(SCENES, tmp_path / "alike.png")
    assert hardly_different(SCENES[:2]) is None  # they weigh the same
    assert not save_alike(SCENES[:2], tmp_path / "none.png")


@pytest.mark.slow
def test_controlled_scenes_are_measured_beside_the_best_answer(prior_belief, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path))
    coarse = ExactObserver(simulated_table(controlled_scene(2), 64), CAMERA, MASS_CLASSES)
    monkeypatch.setattr(controlled_masses, "refined_observer", lambda *arguments: coarse)
    results, scenes = evaluate_controlled_masses([2], 12, SEED, {"belief": "belief"})
    labels = {"objects": 2, "input": "motion"}
    told = {
        model: {r["metric"]: r["value"] for r in results.rows if labels.items() <= r.items() and r["model"] == model}
        for model in ("belief", "exact", "median_guess")
    }
    assert told["belief"] == told["median_guess"]
    for metric in ("interval_accuracy", "log_score", "share_under_1_kg"):
        assert told["exact"][metric] > told["median_guess"][metric]
    assert told["exact"]["mean_abs_error_kg"] < told["median_guess"]["mean_abs_error_kg"]
    assert histogram(scenes, "exact", "motion")[0] / 12 == pytest.approx(told["exact"]["share_under_1_kg"])
    assert {r["model"] for r in results.rows if r["input"] == "force"} == {"belief"}


def test_scenes_of_other_numbers_and_training_seeds_are_refused() -> None:
    with pytest.raises(EvaluationError, match="no controlled scene of 6 objects; valid: 2, 3"):
        evaluate_controlled_masses([6], 1, SEED, {})
    for suite in (evaluate_masses, evaluate_coupled_masses):
        with pytest.raises(EvaluationError, match="seed 999999: seeds below 1,000,000 are for training"):
            suite([6], 1, 999_999, {})


# coupled-masses


def test_true_masses_predict_best_and_every_start_is_counted(prior_belief, row_of_three) -> None:
    models = {"contact": "contact", "belief": "belief"}
    results, scenes = evaluate_coupled_masses([3], 2, SEED, models)
    errors = scenes[0].errors
    # The prior's median is as uniform as its mean, and only ratios matter.
    np.testing.assert_allclose(errors["belief"], errors["mean_guess"], rtol=0.02, atol=1e-5)
    assert errors["oracle"][0] < 0.5 * errors["mean_guess"][0]
    # Before anything has touched nobody knows a ratio; after 20 frames all three have, and only ratios matter.
    np.testing.assert_allclose(errors["ratio_observer"][0], errors["mean_guess"][0], rtol=0.02, atol=1e-5)
    np.testing.assert_allclose(errors["ratio_observer"][2], errors["oracle"][2], rtol=0.02, atol=1e-5)
    assert errors["oracle"][2] < 0.5 * errors["mean_guess"][2]
    labels = {"objects": 3, "model": "oracle"}
    assert row(results, observed_frames=0, **labels) == pytest.approx(100 * errors["oracle"][0])
    ended = len(row_of_three.track.times) <= 100
    assert ended
    assert np.isnan(errors["oracle"][-2])
    assert row(results, observed_frames=100, **labels) is None
    assert row(results, observed_frames="first_push", **labels) == pytest.approx(100 * errors["oracle"][-1])


def test_scenes_that_have_ended_do_not_count_in_means() -> None:
    nothing = np.full(12, np.nan)
    some = np.arange(12) / 100
    scenes = [CoupledErrors(6, {"oracle": values}) for values in (some, some + 0.02, nothing)]
    mean, error = mean_and_standard_error(scenes, 6, "oracle")
    np.testing.assert_allclose(mean, np.arange(12) + 1)
    np.testing.assert_allclose(error, 1.0)


# the commands


def test_the_commands_write_results_and_figures_and_print_the_numbers(prior_belief, tmp_path, monkeypatch) -> None:
    drawn = three_in_a_row()
    monkeypatch.setattr(Block, "draw", lambda block: [drawn] * block.count)
    for suite, figure in (("masses", "curves.png"), ("coupled-masses", "coupled.png")):
        out = tmp_path / suite
        told = CliRunner().invoke(
            cli.app, ["evaluate", suite, "--count", "1", "--objects", "9", "--workers", "1", "--out", str(out)]
        )
        assert told.exit_code == 0, told.output
        content = json.loads((out / "results.json").read_text())
        assert content["suite"] == suite
        assert "9 objects" in told.output
        assert (out / figure).stat().st_size > 0


def test_the_controlled_command_writes_its_figures(prior_belief, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path))
    coarse = ExactObserver(simulated_table(controlled_scene(2), 16), CAMERA, MASS_CLASSES)
    monkeypatch.setattr(controlled_masses, "refined_observer", lambda *arguments: coarse)
    out = tmp_path / "out"
    arguments = ["--count", "2", "--objects", "2", "--workers", "1", "--out", str(out)]
    told = CliRunner().invoke(cli.app, ["evaluate", "controlled-masses", *arguments])
    assert told.exit_code == 0, told.output
    assert "Controlled scenes of 2 objects" in told.output
    for name in ("results.json", "histograms.png", "confusion.png"):
        assert (out / name).stat().st_size > 0
    refused = CliRunner().invoke(cli.app, ["evaluate", "controlled-masses", "--objects", "9"])
    assert refused.exit_code == 1
    assert "valid: 2, 3" in str(refused.exception)
