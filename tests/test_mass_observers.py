"""What can be said of masses at best: against cases worked by hand, brute force, and the prior."""

import numpy as np
import pytest
import torch
from scenes import body

from pushgraph.evaluation.exact_masses import ExactObserver
from pushgraph.evaluation.mass_answers import MassAnswer, prior_answer, prior_mean, score, weighted_answer
from pushgraph.evaluation.mass_observers import ScalePosterior, mean_guess, ratio_observer
from pushgraph.evaluation.noise_floor import CAMERA
from pushgraph.evaluation.ratio_table import RatioTable, fill, simulated_table
from pushgraph.evaluation.recording import record
from pushgraph.evaluation.touching import find_touched, groups_of
from pushgraph.graph.scene_batch import batch_scenes, pairs_of
from pushgraph.mass_prior import MASS_CLASSES, MassClass, draw_masses
from pushgraph.scene import Scene
from pushgraph.simulation.masses import weighing
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push
from pushgraph.track import Track

ONE_TO_TWO = (MassClass(name="only", lowest=1.0, highest=2.0),)


# answers


def test_scores_are_those_worked_by_hand() -> None:
    answer = MassAnswer(
        np.array([1.5, 3.0]), np.array([1.0, 2.0]), np.array([2.0, 8.0]), np.array([[0.1, 0.7, 0.2], [0.5, 0.5, 0.0]])
    )
    scores = score(answer, np.array([1.2, 9.0]), MASS_CLASSES)
    np.testing.assert_allclose(scores.error, [0.3, 6.0])
    assert scores.right.tolist() == [True, False]
    assert scores.held.tolist() == [True, False]
    np.testing.assert_allclose(scores.log_score, [np.log(0.7), np.log(1e-4)])
    np.testing.assert_allclose(scores.top, [0.7, 0.5])


def test_weighted_samples_of_the_prior_answer_the_prior() -> None:
    samples = draw_masses(np.random.default_rng(0), MASS_CLASSES, 100_000)
    # Drawn evenly from everything between, and weighed by the prior.
    evenly = np.linspace(0.2, 10.0, 200_001)
    weights = sum(((evenly >= c.lowest) & (evenly <= c.highest)) / (c.highest - c.lowest) for c in MASS_CLASSES)
    told = prior_answer(MASS_CLASSES, 1)
    for some, shares in ((samples, np.ones(len(samples))), (evenly, weights)):
        answer = weighted_answer(some[:, None], shares, MASS_CLASSES)
        for values, expected in zip(answer, told, strict=True):
            np.testing.assert_allclose(values, expected, atol=0.02)


# ratios


def test_the_scale_of_one_class_is_as_worked_by_hand() -> None:
    # Two bodies of 1 to 2 kg, the second 1.6 times as heavy: the first weighs 1 to 1.25 kg, with density 2 s.
    posterior = ScalePosterior(np.array([[1.0, 1.6]]), ONE_TO_TWO)
    levels = np.array([0.0, 0.25, 0.5, 0.9])
    np.testing.assert_allclose(posterior.quantiles(levels)[0], np.sqrt(1 + levels * (1.25**2 - 1)))
    np.testing.assert_allclose(posterior.evidence, 1.6 * (1.25**2 - 1) / 2)
    # Whatever the unit of the ratios.
    other = ScalePosterior(np.array([[10.0, 16.0], [1.0, 3.0]]), ONE_TO_TWO)
    np.testing.assert_allclose(other.quantiles(levels)[0] * 10, posterior.quantiles(levels)[0])
    np.testing.assert_allclose(other.evidence, [posterior.evidence[0], 0.0])


def test_the_evidence_of_ratios_is_their_frequency() -> None:
    masses = draw_masses(np.random.default_rng(0), MASS_CLASSES, 400_000).reshape(-1, 2)
    edges = np.linspace(-4, 4, 81)
    counts, _ = np.histogram(np.log(masses[:, 1] / masses[:, 0]), edges)
    middles = (edges[:-1, None] + np.linspace(0.05, 0.95, 10) * np.diff(edges)[:, None]).ravel()
    evidence = ScalePosterior(np.exp(np.column_stack((np.zeros_like(middles), middles))), MASS_CLASSES).evidence
    expected = evidence.reshape(-1, 10).mean(1) * 0.1
    np.testing.assert_allclose(counts / counts.sum(), expected, atol=0.002)


@pytest.mark.parametrize(
    ("bodies", "error", "right"), [(1, 2.97, 0.33), (2, 1.38, 0.735), (3, 0.55, 0.90), (4, 0.3, 0.95)]
)
def test_the_ratio_observer_errs_as_little_as_is_possible_and_knows_how_much(bodies, error, right) -> None:
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(500):
        masses = draw_masses(rng, MASS_CLASSES, bodies)
        answer = ratio_observer(masses, np.zeros(bodies, dtype=int), MASS_CLASSES)
        scores.append(score(answer, masses, MASS_CLASSES))
    assert np.mean([some.error for some in scores]) == pytest.approx(error, abs=0.2)
    assert np.mean([some.right for some in scores]) == pytest.approx(right, abs=0.04)
    assert np.mean([some.held for some in scores]) == pytest.approx(0.68, abs=0.05)


def test_bodies_in_no_group_answer_the_prior_and_groups_do_not_mix() -> None:
    masses = np.array([0.3, 9.0, 1.5, 0.4, 9.5])
    together = ratio_observer(masses, np.array([0, 0, 2, 3, 3]), MASS_CLASSES)
    for members in ([0, 1], [3, 4]):
        alone = ratio_observer(masses[members], np.array([0, 0]), MASS_CLASSES)
        for values, expected in zip(together.take(np.array(members)), alone, strict=True):
            np.testing.assert_array_equal(values, expected)
    for values, expected in zip(together.take(np.array([2])), prior_answer(MASS_CLASSES, 1), strict=True):
        np.testing.assert_array_equal(values, expected)
    # Light beside heavy is certain: no other pair of classes has such a ratio.
    np.testing.assert_allclose(together.probabilities[:2], [[1, 0, 0], [0, 0, 1]], atol=1e-12)


def test_the_mean_guess_is_the_mean() -> None:
    assert prior_mean(MASS_CLASSES) == pytest.approx((0.35 + 1.5 + 9.0) / 3)
    np.testing.assert_allclose(mean_guess(MASS_CLASSES, 2).median, prior_mean(MASS_CLASSES))


# exact


def toy(dimensions: int):
    """Three frames of bodies whose only motion depends smoothly on the log ratios."""

    def poses_of(log_ratios):
        poses = np.zeros((len(log_ratios), 3, 1 + dimensions, 3))
        poses[:, 1:, 1:, 0] = 0.004 * np.tanh(log_ratios / 2)[:, None]
        poses[:, 2, 0, 1] = 0.001 * np.square(log_ratios).sum(-1)
        return poses.reshape(len(log_ratios), -1)

    return poses_of


@pytest.mark.parametrize(("dimensions", "cells"), [(1, 128), (2, 64)])
def test_the_exact_posterior_is_that_of_brute_force(dimensions: int, cells: int) -> None:
    poses_of, bodies = toy(dimensions), 1 + dimensions
    observer = ExactObserver(fill(poses_of, MASS_CLASSES, dimensions, cells), CAMERA, MASS_CLASSES)
    rng = np.random.default_rng(0)
    samples = draw_masses(rng, MASS_CLASSES, 400_000 * bodies).reshape(-1, bodies)
    expected = poses_of(np.log(samples[:, 1:] / samples[:, :1]))
    precision = np.tile(1 / np.array([CAMERA.position, CAMERA.position, CAMERA.yaw]), 3 * bodies)
    for true in (2, 5, 7):
        seen = expected[true] + rng.normal(size=expected.shape[1]) / precision
        weights = np.exp(-0.5 * np.square((expected - seen) * precision).sum(-1))
        brute = weighted_answer(samples, weights, MASS_CLASSES)
        answer = observer.answer(seen.reshape(3, bodies, 3))
        np.testing.assert_allclose(answer.probabilities, brute.probabilities, atol=0.02)
        for values, others in zip(answer[:3], brute[:3], strict=True):
            np.testing.assert_allclose(values, others, rtol=0.03, atol=0.05)


def test_a_finer_table_takes_over_what_is_known() -> None:
    asked = []

    def poses_of(log_ratios):
        asked.append(len(log_ratios))
        return toy(1)(log_ratios)

    coarse = fill(poses_of, MASS_CLASSES, 1, 8)
    fine = fill(poses_of, MASS_CLASSES, 1, 16, coarse)
    assert asked == [9, 8]
    np.testing.assert_array_equal(fine.poses[::2], coarse.poses)


def pushed_pair() -> Scene:
    push = Push(start=(-0.15, 0.0), end=(0.02, 0.0), speed=0.3)
    return Scene(bodies=(body("a", 0.0, 0.02), body("b", 0.13, -0.03)), pushes=(push,))


def test_a_simulated_table_holds_what_simulation_does_and_is_kept(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PUSHGRAPH_CACHE", str(tmp_path))
    scene = pushed_pair().replace(mass_classes=ONE_TO_TWO)
    table = simulated_table(scene, 4)
    ratio = np.exp(table.lowest + table.spacing)
    again = simulate(weighing(scene, (1.0, ratio))).poses[:, 1:].ravel()
    np.testing.assert_allclose(table.at(np.log([[ratio]]))[0], again, atol=1e-6)
    monkeypatch.setattr("pushgraph.evaluation.ratio_table.simulate", None)
    kept = simulated_table(scene, 4)
    assert isinstance(kept, RatioTable)
    np.testing.assert_array_equal(kept.poses, table.poses)


def test_motion_shows_ratios_alone() -> None:
    light, heavy = (simulate(weighing(pushed_pair(), masses)).poses for masses in ((0.3, 0.4), (6.0, 8.0)))
    np.testing.assert_allclose(light, heavy, atol=1e-4)


# touching


def moving_track(scene: Scene, robot: list, bodies: dict[str, list]) -> Track:
    """Bodies that stand where these say, x (m) by frame, and else where the scene has them; the tool is down."""
    frames = len(robot)
    poses = np.tile(np.concatenate((np.zeros((1, 3)), scene.poses_world_from_body)), (frames, 1, 1))
    poses[:, 0, 0] = robot
    for name, places in bodies.items():
        poses[:, 1 + scene.names.index(name), 0] = places
    return Track(
        scene, np.arange(frames) * 0.05, poses, np.zeros(frames, dtype=int), np.ones(poses.shape[:2], dtype=bool)
    )


def test_touched_are_pairs_in_contact_while_one_moves_and_pushed_what_came_along() -> None:
    # The tool (0.10 wide) meets a (0.12), which meets b; c and d touch, but rest; e is far away.
    scene = Scene(
        bodies=(
            *(body(name, x, 0.0) for name, x in (("a", 0.11), ("b", 0.26), ("e", 0.6))),
            body("c", 0.8, 0.0),
            body("d", 0.92, 0.0),
        ),
        pushes=(Push(start=(0, 0), end=(0.1, 0)),),
    )
    robot = [0.0, 0.02, 0.03, 0.05]
    track = moving_track(scene, robot, {"a": [0.11, 0.13, 0.14, 0.16], "b": [0.26, 0.26, 0.26, 0.28]})
    touched = find_touched(batch_scenes([scene]), record([track], 4))
    pairs = pairs_of(5).T.tolist()
    met = [[pair for pair, yes in zip(pairs, row, strict=True) if yes] for row in touched.pairs[0].tolist()]
    assert met == [[], [], [[0, 1]], [[0, 1]]]
    assert touched.bodies[0, -1].tolist() == [True, True, False, False, False]
    assert touched.pushed[0].tolist() == [
        [False] * 5,
        [True, False, False, False, False],
        [True, False, False, False, False],  # b only touched
        [True, True, False, False, False],
    ]
    assert groups_of(touched.pairs[0, -1].numpy(), 5).tolist() == [0, 0, 2, 3, 4]


def test_groups_follow_chains() -> None:
    pairs = torch.zeros(10, dtype=torch.bool)
    pairs[[pairs_of(5).T.tolist().index(pair) for pair in ([0, 4], [1, 2], [3, 4])]] = True
    assert groups_of(pairs.numpy(), 5).tolist() == [0, 1, 1, 0, 0]
