"""Straight pushes that are drawn and improved, and what is made of how far off a prediction may be."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import flat_tool

import pushgraph as pg
from pushgraph.body import Body
from pushgraph.errors import PlanningError
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.admissible import CLEARANCE, refusals
from pushgraph.planning.aims import Aims, aimed_pushes, first_aims
from pushgraph.planning.costs import position_cost
from pushgraph.planning.dynamics import learned, simulated
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import Plan
from pushgraph.planning.risk import as_predicted, expected, percentile
from pushgraph.planning.sampling import Sampling, plan_continuously
from pushgraph.planning.tools import NamedTool
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cylinder
from pushgraph.simulation.planar import simulate
from pushgraph.spread import Spread
from pushgraph.tool import Push, Tool
from pushgraph.track import Track

FEW = Sampling(candidates=12, rounds=2, varied=8, elites=3, branches=2)


def disc(name: str, x: float, y: float, fixed: bool = False) -> Body:
    return Body(name=name, shape=Cylinder(diameter=0.1), pose_world_from_body=(x, y, 0.0), mass=0.5, fixed=fixed)


ALONE = Scene(bodies=(disc("cup", 0.0, 0.0),), tool=Tool.round(0.06))
CROWD = Scene(
    bodies=(disc("cup", 0.0, 0.0), disc("tin", 0.0, 0.13), disc("jar", -0.12, -0.02), disc("post", 0.4, 0.4, True)),
    tool=Tool.round(0.06),
    clearance=0.01,
)
GOAL = Goal(body="cup", position=(0.15, 0.05))


@pytest.fixture(scope="module")
def predictor() -> PhysicsPredictor:
    return PhysicsPredictor.load()


def drawn(predictor: PhysicsPredictor, scene: Scene = ALONE, goal: Goal = GOAL, seed: int = 0, **more) -> Plan:
    return plan_continuously(scene, goal, learned(predictor), np.random.default_rng(seed), FEW, **more)


def test_a_plan_brings_a_free_disc_to_its_goal_in_simulation(predictor):
    plan = drawn(predictor)
    assert plan.cost < 0.01
    end = simulate(plan.scene).poses[-1, 1]
    assert math.dist(end[:2], GOAL.position) < 0.01


def test_the_same_generator_gives_the_same_plan_and_another_one_another(predictor):
    turned = GOAL.replace(yaw=0.5)
    first, again, other = (drawn(predictor, CROWD, turned, seed) for seed in (1, 1, 2))
    assert first.pushes == again.pushes
    assert first.cost == again.cost
    assert first.pushes != other.pushes


def test_turning_the_scene_turns_the_plan(predictor):
    motion = np.array([0.1, -0.2, 0.7])
    turned = CROWD.moved(motion)
    cosine, sine = math.cos(0.7), math.sin(0.7)
    x, y = GOAL.position
    goal = GOAL.replace(position=(0.1 + cosine * x - sine * y, -0.2 + sine * x + cosine * y))
    one, other = drawn(predictor, CROWD), drawn(predictor, turned, goal)
    assert other.cost == pytest.approx(one.cost, abs=1e-4)
    np.testing.assert_allclose(other.pushes[0].start, one.pushes[0].moved(motion).start, atol=1e-3)


def test_the_plan_costs_what_its_end_costs(predictor):
    plan = drawn(predictor, CROWD)
    assert plan.cost == pytest.approx(math.dist(plan.end[0, :2], GOAL.position), abs=1e-6)
    assert plan.expected.scene.pushes == plan.pushes


def test_only_pushes_that_may_be_made_are_drawn():
    rng = np.random.default_rng(0)
    scene = CROWD.replace(table=Table(size=(1.0, 1.0)))
    aims = first_aims(rng, scene, scene.poses_world_from_body, 0, (0.2, 0.0), 100)
    pushes = aimed_pushes(scene, scene.poses_world_from_body, aims, 0, (0.2, 0.0), 0.2, 0.45)
    made = [push for push in pushes if push is not None]
    assert len(made) > 50
    assert refusals([scene.model_copy(update={"pushes": (push,)}) for push in made]) == [None] * len(made)
    assert all(push.distance <= 0.45 for push in made)
    assert 3 not in aims.body  # what is fixed is not pushed at


def test_the_first_push_drawn_goes_through_the_body_to_its_place():
    aims = first_aims(np.random.default_rng(0), ALONE, ALONE.poses_world_from_body, 0, (0.0, 0.2), 5)
    assert aims.body[0] == 0
    assert aims.offset[0] == 0
    push = aimed_pushes(ALONE, ALONE.poses_world_from_body, aims.take([0]), 0, (0.0, 0.2), 0.2, 0.45)[0]
    assert push is not None
    assert push.start[0] == pytest.approx(0.0, abs=1e-9)
    # Clear of the disc's 5 cm and the tool's 3 cm, to the next centimetre.
    assert push.start[1] == pytest.approx(-0.09)
    assert push.direction == pytest.approx(math.pi / 2)


def test_a_round_tool_is_not_turned_and_another_one_is():
    rng = np.random.default_rng(0)
    for tool, turned in ((Tool.round(0.06), False), (flat_tool(0.02, 0.2), True)):
        scene = ALONE.replace(tool=tool)
        aims = first_aims(rng, scene, scene.poses_world_from_body, 0, (0.2, 0.0), 20)
        assert (len(set(aims.yaw)) > 1) == turned
        assert (aims.varied(rng, 1, 0.1, scene).yaw[0] in aims.yaw) != turned


def test_a_push_begins_behind_what_stands_in_its_way():
    aim = Aims(np.array([0]), np.array([0.0]), np.array([0.0]), np.array([0.0]))
    push = aimed_pushes(CROWD, CROWD.poses_world_from_body, aim, 0, (0.2, 0.0), 0.2, 0.45)[0]
    assert push is not None
    gaps = CROWD.tool_gaps(np.array([[*push.start, 0.0]]), CROWD.poses_world_from_body)
    assert gaps.min() >= 0.01 > CLEARANCE
    assert push.start[0] < -0.12 - 0.05 - 0.03


def test_what_the_arm_cannot_do_is_not_planned(predictor):
    seen: list[Push] = []

    def reach(scene: Scene, push: Push) -> str | None:
        seen.append(push)
        return None if push.direction is not None and math.cos(push.direction) < 0.9 else "beyond the arm's reach"

    plan = drawn(predictor, reach=reach)
    assert math.cos(plan.pushes[0].direction) < 0.9
    assert seen
    with pytest.raises(PlanningError, match="'cup' may be tried; too far"):
        drawn(predictor, reach=lambda scene, push: "too far")


def test_two_pushes_are_no_worse_than_one(predictor):
    goal = GOAL.replace(yaw=1.0)
    once = Sampling(candidates=6, rounds=0, branches=2)
    one, two = (
        plan_continuously(ALONE, goal, learned(predictor), np.random.default_rng(0), replace(once, pushes=pushes))
        for pushes in (1, 2)
    )
    assert len(one.pushes) == 1
    assert 1 <= len(two.pushes) <= 2
    assert two.cost <= one.cost


def test_a_body_at_its_goal_is_left_alone(predictor):
    plan = drawn(predictor, ALONE, Goal(body="cup", position=(0.0, 0.0)))
    assert plan.pushes == ()
    assert plan.cost < 1e-6
    assert plan.end.tolist() == [[0.0, 0.0, 0.0]]


def test_no_more_is_tried_than_there_is_time_for():
    tried = []

    def dynamics(scenes):
        tried.extend(scenes)
        return simulated(scenes)

    plan_continuously(ALONE, GOAL, dynamics, np.random.default_rng(0), Sampling(seconds=1e-6, branches=3))
    assert len(tried) <= 2


def test_what_does_not_fit_is_refused(predictor):
    for goal, said in (
        (Goal(body="mug", position=(0, 0)), "no body 'mug'; valid: cup, tin, jar, post"),
        (Goal(body="post", position=(0, 0)), "'post' is fixed"),
        (Goal(body="cup", position=(1.5, 0)), "off the table of 2 x 2 m"),
    ):
        with pytest.raises(PlanningError, match=said):
            drawn(predictor, CROWD, goal)
        with pytest.raises(PlanningError, match=said):
            pg.plan(CROWD, goal, simulated)


def test_sampling_needs_something_to_try():
    with pytest.raises(PlanningError, match="elites must be at least 1, got 0"):
        Sampling(elites=0)


def test_plan_chooses_among_tools_and_says_how_far_it_is(predictor):
    told = []
    tools = [NamedTool("thin", Tool.round(0.02)), NamedTool("thick", Tool.round(0.08))]
    plan = pg.plan(ALONE, GOAL, learned(predictor), tools, sampling=FEW, progress=lambda *at: told.append(at))
    assert plan.tool in ("thin", "thick")
    assert plan.scene.tool == dict(tools)[plan.tool]
    assert told == [(k, 6) for k in range(1, 7)]
    given = pg.plan(ALONE, GOAL, learned(predictor), tools, [Push(start=(-0.1, 0), path=((0.1, 0.0),), times=(1.0,))])
    assert given.pushes[0].start == (-0.1, 0)
    with pytest.raises(PlanningError, match="need tools"):
        pg.plan(ALONE, GOAL, learned(predictor), pushes=given.pushes)


def off_by(scale: float) -> Track:
    """The cup half-way along x, its place unsure by so much either way."""
    poses = np.zeros((2, 2, 3))
    poses[1, 1, 0] = 0.1
    full = np.full((2, 1), scale)
    one = np.ones((2, 1))
    spread = Spread(0 * one, full, full, 100 * one, one, full, 100 * one)
    return Track(ALONE, np.array([0.0, 0.05]), poses, np.full(2, -1), np.ones((2, 2), dtype=bool), spread=spread)


def test_risk_counts_what_the_prediction_does_not_know():
    cost = position_cost(ALONE, "cup", 0.1, 0.0)
    sure, unsure = off_by(1e-6), off_by(0.05)
    for risk in (as_predicted, expected, percentile):
        assert risk(cost)([sure])[0, 1] == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(as_predicted(cost)([sure, unsure])[:, 1], 0.0, atol=1e-6)
    mean, high = expected(cost, 4000)([unsure])[0, 1], percentile(cost, 0.9, 4000)([unsure])[0, 1]
    # Of a normal error in the plane: mean s sqrt(pi / 2), and 90 % within s sqrt(2 ln 10).
    assert mean == pytest.approx(0.05 * math.sqrt(math.pi / 2), rel=0.05)
    assert high == pytest.approx(0.05 * math.sqrt(2 * math.log(10)), rel=0.05)


def test_risk_needs_a_spread_and_a_share(predictor):
    cost = position_cost(ALONE, "cup", 0.1, 0.0)
    with pytest.raises(PlanningError, match="no spread"):
        drawn(predictor, risk=expected)
    with pytest.raises(PlanningError, match="between 0 and 1, got 90"):
        percentile(cost, 90.0)
