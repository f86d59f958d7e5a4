"""Push, look, plan again."""

import itertools
import math

import numpy as np
import pytest

from pushgraph.belief import BeliefModel
from pushgraph.body import Body, Joint
from pushgraph.errors import EvaluationError, PlanningError
from pushgraph.evaluation import clutter
from pushgraph.evaluation.clutter import AWAY, MARGIN, draw_goal, evaluate_clutter
from pushgraph.joint_doubt import Beliefs
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.closed_loop import SimulatedEnvironment, how_likely, push_to_goal
from pushgraph.planning.dynamics import learned
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import Plan
from pushgraph.planning.sampling import Sampling, plan_continuously
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool


def box(name: str, x: float, y: float) -> Body:
    return Body(name=name, shape=Cuboid(size=(0.1, 0.1)), pose_world_from_body=(x, y, 0.0), mass=0.5)


PAIR = Scene(
    bodies=(box("cup", 0.0, 0.0), box("tin", 0.0, 0.11)),
    joints=(Joint(kind="fixed", parent="cup", child="tin"),),
    tool=Tool.round(0.06),
)
GOAL = Goal(body="cup", position=(0.15, 0.0))


@pytest.fixture(scope="module")
def predictor() -> PhysicsPredictor:
    return PhysicsPredictor.load()


@pytest.fixture(scope="module")
def belief() -> BeliefModel:
    return BeliefModel.load()


def planner(predictor: PhysicsPredictor):
    rng = np.random.default_rng(0)
    few = Sampling(candidates=12, rounds=1, varied=8, elites=3, branches=2)

    def plan(scene: Scene, goal: Goal, beliefs: Beliefs) -> Plan:
        return plan_continuously(scene, goal, learned(predictor, True, beliefs), rng, few)

    return plan


def test_a_loop_ends_at_the_goal_and_says_what_happened(predictor, belief):
    environment = SimulatedEnvironment(PAIR)
    steps = list(push_to_goal(BeliefRegulator(PAIR, belief), environment, GOAL, planner(predictor)))
    assert steps
    assert GOAL.reached(environment.simulation.poses[0])
    assert steps[0].before == (pytest.approx(0.15), 0.0)
    for step, after in itertools.pairwise(steps):
        assert step.after == pytest.approx(after.before, abs=1e-4)
    last = steps[-1]
    assert last.after[0] <= GOAL.tolerance
    np.testing.assert_allclose(last.observed, environment.simulation.poses[0], atol=1e-9)
    assert last.region is not None
    assert last.region.along > 0
    assert 0 <= last.likely <= 1
    assert environment.simulation.track().scene.pushes == tuple(step.push for step in steps)


def test_what_is_seen_is_what_a_simulation_in_one_go_records():
    pushes = (Push(start=(-0.1, 0.0), end=(0.0, 0.0)), Push(start=(0.1, -0.1), end=(0.1, 0.05)))
    environment = SimulatedEnvironment(PAIR)
    seen = [environment.execute(push) for push in pushes]
    whole = simulate(PAIR.replace(pushes=pushes))
    np.testing.assert_array_equal(np.concatenate([track.poses for track in seen]), whole.poses)
    np.testing.assert_array_equal(np.concatenate([track.push for track in seen]), whole.push)


def test_noise_is_seen_of_bodies_and_not_of_the_tool():
    push = Push(start=(-0.1, 0.0), end=(0.0, 0.0))
    clean = SimulatedEnvironment(PAIR).execute(push)
    noisy = SimulatedEnvironment(PAIR, (1e-3, 1e-2), np.random.default_rng(1)).execute(push)
    off = noisy.poses - clean.poses
    assert not off[:, 0].any()
    np.testing.assert_allclose(off[:, 1:].std((0, 1)), [1e-3, 1e-3, 1e-2], rtol=0.3)


def test_nothing_is_pushed_at_the_goal_or_for_no_goal(predictor, belief):
    here = Goal(body="cup", position=(0.0, 0.0))
    assert not list(push_to_goal(BeliefRegulator(PAIR, belief), SimulatedEnvironment(PAIR), here, planner(predictor)))
    nowhere = Goal(body="mug", position=(0.0, 0.0))
    with pytest.raises(PlanningError, match="no body 'mug'"):
        list(push_to_goal(BeliefRegulator(PAIR, belief), SimulatedEnvironment(PAIR), nowhere, planner(predictor)))


def test_no_more_pushes_are_made_than_allowed(predictor, belief):
    far = Goal(body="cup", position=(0.8, 0.0))
    loop = push_to_goal(BeliefRegulator(PAIR, belief), SimulatedEnvironment(PAIR), far, planner(predictor), pushes=1)
    assert len(list(loop)) == 1


def test_a_likely_end_is_one_whose_spread_lies_within_the_tolerance(predictor):
    track = learned(predictor, True)([PAIR.replace(pushes=(Push(start=(-0.1, 0.0), end=(0.0, 0.0)),))])[0]
    plan = Plan("own", track.scene, track, 0.0)
    there = tuple(plan.end[0, :2].tolist())
    assert how_likely(plan, Goal(body="cup", position=there, tolerance=1.0)) > 0.99
    assert how_likely(plan, Goal(body="cup", position=(there[0] + 0.5, there[1]))) < 0.01
    unsaid = learned(predictor)([track.scene])[0]
    assert how_likely(Plan("own", track.scene, unsaid, 0.0), GOAL) is None


def test_goals_of_the_suite_are_on_the_table_away_and_turned():
    for seed in range(20):
        goal = draw_goal(np.random.default_rng(seed), PAIR)
        body = PAIR.bodies[PAIR.names.index(goal.body)]
        assert math.dist(goal.position, body.pose_world_from_body[:2]) == pytest.approx(AWAY)
        assert max(map(abs, goal.position)) <= 1.0 - MARGIN
        assert goal.error(np.array(body.pose_world_from_body))[1] <= math.pi / 2


def test_the_suite_says_how_often_goals_are_reached(monkeypatch):
    few = Sampling(candidates=8, rounds=1, varied=4, elites=2, branches=1)
    monkeypatch.setattr(clutter, "Sampling", lambda seconds: few)
    models = {"contact": "contact", "belief": "belief"}
    results, scenes = evaluate_clutter((6,), 1, 1_000_000, models, contenders=("no_joint",))
    values = {(row["goal"], row["metric"]): row["value"] for row in results.rows}
    for goal in ("position", "pose"):
        run = scenes[0].runs["no_joint", goal]
        assert values[goal, "success_3cm"] == (run.error[0] <= 0.03)
        assert values[goal, "pushes"] == len(run.planning) == len(run.said)
        assert values[goal, "planning_s"] == pytest.approx(np.mean(run.planning))
    assert values["pose", "success_pose"] == scenes[0].runs["no_joint", "pose"].reached
    with pytest.raises(EvaluationError, match="seed 1: seeds below"):
        evaluate_clutter((6,), 1, 1, models)
