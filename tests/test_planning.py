"""Tools, goals, costs, and the exhaustive search over them."""

import json
import math

import numpy as np
import pytest
import torch

from pushgraph.body import Body
from pushgraph.errors import PlanningError
from pushgraph.physics import PhysicsPredictor
from pushgraph.planning.admissible import admitted, refusals
from pushgraph.planning.costs import apart_cost, cost_of, kept_cost, pose_cost, position_cost
from pushgraph.planning.dynamics import learned, simulated
from pushgraph.planning.exhaustive import plan_exhaustively
from pushgraph.planning.goal import Goal
from pushgraph.planning.plan import load_plan
from pushgraph.planning.sequences import sequences
from pushgraph.planning.tools import TOOLS, NamedTool, load_tool, load_tools
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.motion import plan_tool
from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME, Track


def disc(name: str, x: float, y: float) -> Body:
    return Body(name=name, shape=Cylinder(diameter=0.1), pose_world_from_body=(x, y, 0.0), mass=0.5)


SCENE = Scene(bodies=(disc("cup", 0.2, 0.0), disc("tin", 0.2, 0.3)))


@pytest.fixture(scope="module")
def predictor() -> PhysicsPredictor:
    return PhysicsPredictor.load()


def poses(*rows: tuple[float, float, float]) -> torch.Tensor:
    return torch.tensor(rows, dtype=torch.float64)[None]


def test_shipped_tools_are_those_of_the_paper():
    centres = {
        name: [tuple(round(v, 9) for v in part.pose_tool_from_part[:2]) for part in load_tool(name).tool.parts[1:]]
        for name in TOOLS
    }
    assert centres["stick"] == [(-0.12, 0), (-0.26, 0), (-0.4, 0), (-0.54, 0)]
    assert centres["l"][-1] == (-0.43, 0.12)
    assert centres["inverted-l"][-1] == (-0.43, -0.12)
    quarter = {"stick-left": "stick", "stick-right": "stick", "l-left": "l", "inverted-l-right": "inverted-l"}
    for turned, straight in quarter.items():
        sign = -1 if turned.endswith("right") else 1
        assert centres[turned] == [(-sign * y, sign * x) for x, y in centres[straight]]
    assert len(load_tools("all")) == 7


def test_a_user_adds_a_tool_in_a_file(tmp_path):
    path = tmp_path / "hook.json"
    path.write_text('{"parts": [{"shape": {"kind": "cuboid", "size": [0.3, 0.02]}}]}')
    assert load_tool(path) == NamedTool("hook", Tool(parts=load_tool(path).tool.parts))
    path.write_text('{"parts": [{"shape": {"kind": "cuboid", "size": [0.3, -0.02]}}]}')
    with pytest.raises(PlanningError, match=r"hook.json.*parts.*size"):
        load_tool(path)
    with pytest.raises(PlanningError, match="neither a file that can be read .* nor one of stick, stick-left"):
        load_tool("spoon")


def test_sequences_are_three_pushes_of_20_cm_each():
    found = sequences()
    assert len(set(found)) == 64
    for push in found:
        steps = np.diff(push.waypoints[:, :2], axis=0)
        assert np.allclose(np.abs(steps).sum(1), 0.2)
        assert len(plan_tool([push], Tool.round(0.1))[0]) == 121


def test_a_push_ends_early():
    push = sequences()[0].replace(path=((0.2, 0.0), (0.2, 0.2)), times=(2.0, 4.0))
    assert push.until(3.0).waypoints[-1].tolist() == pytest.approx([0.2, 0.1, 0.0])
    assert push.until(1.0).path == ((0.1, 0.0, 0.0),)
    assert push.until(9.0) is push
    with pytest.raises(ValueError, match="times"):
        Push(start=(0, 0), end=(0.1, 0)).until(1.0)


def test_plans_that_begin_alike_are_predicted_the_same_together_as_alone(predictor):
    plans = [SCENE.replace(tool=load_tool("l").tool, pushes=(push,)) for push in sequences(start=(0.05, 0.0))[:5]]
    plans.append(plans[0].replace(bodies=(disc("cup", 0.21, 0.0), disc("tin", 0.2, 0.3))))
    together = predictor.predict_many(plans, share=True)
    for alone, shared in zip(predictor.predict_many(plans), together, strict=True):
        assert np.array_equal(alone.poses, shared.poses)
    assert not np.array_equal(together[0].poses[-1], together[1].poses[-1])


def test_costs_by_hand():
    at = poses((0.3, 0.4, math.pi / 3), (0.6, 0.0, 0.0))
    assert position_cost(SCENE, "cup", 0.0, 0.0)(at).item() == pytest.approx(0.5)
    assert pose_cost(SCENE, "cup", 0.3, 0.4, math.pi / 3 + 2 * math.pi)(at).item() == pytest.approx(0, abs=1e-7)
    # A chord of 60 degrees on a circle of 10 cm is 10 cm.
    assert pose_cost(SCENE, "cup", 0.3, 0.4, 0.0)(at).item() == pytest.approx(0.1)
    # Centres are 50 cm apart, and each disc has a radius of 5 cm.
    assert apart_cost(SCENE, ["cup", "tin"], 0.45)(at).item() == pytest.approx(0.05)
    assert apart_cost(SCENE, ["cup", "tin"], 0.4)(at).item() == pytest.approx(0.0)
    assert kept_cost(SCENE, ["tin"])(at).item() == pytest.approx(0.5)
    assert cost_of(SCENE, Goal(body="cup", position=(0.0, 0.0), keep=("tin",)))(at).item() == pytest.approx(1.0)


def test_apart_counts_every_pair_and_bodies_of_several_parts():
    plank = Body(name="plank", shape=Cuboid(size=(0.2, 0.1)), pose_world_from_body=(-0.3, 0.0, 0.0), mass=0.5)
    scene = SCENE.replace(bodies=(*SCENE.bodies, plank))
    at = poses((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (-0.3, 0.0, 0.0))
    # Gaps: cup - tin 10 cm, cup - plank 15 cm, tin - plank 35 cm.
    assert apart_cost(scene, ["cup", "tin", "plank"], 0.2)(at).item() == pytest.approx(0.1 + 0.05)


@pytest.mark.parametrize(
    "cost",
    [
        position_cost(SCENE, "cup", 0.0, 0.1),
        pose_cost(SCENE, "cup", 0.0, 0.1, 0.5),
        apart_cost(SCENE, ["cup", "tin"], 0.4),
        kept_cost(SCENE, ["tin"]),
    ],
)
def test_gradients_of_costs_are_those_of_finite_differences(cost):
    at = poses((0.25, 0.1, 0.3), (0.3, 0.3, 0.1)).requires_grad_()
    assert torch.autograd.gradcheck(cost, at, eps=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        (Goal(body="lid", position=(0, 0)), "no body 'lid'; valid: cup, tin"),
        (Goal(body="cup", position=(3.0, 0)), r"\(3, 0\) is off the table of 2 x 2 m"),
        (Goal(body="cup", position=(0, 0), keep=("cup",)), "both move and stay"),
        (Goal(body="tin", position=(0, 0)), "'tin' is fixed"),
    ],
)
def test_goals_that_cannot_be(goal, said):
    scene = SCENE.replace(bodies=(SCENE.bodies[0], SCENE.bodies[1].replace(fixed=True)))
    with pytest.raises(PlanningError, match=said):
        cost_of(scene, goal)


def test_what_cannot_be_tried_is_told_by_name():
    over_cup = SCENE.replace(pushes=(Push(start=(0.0, 0.0), end=(0.1, 0.0)),))
    over_cup = over_cup.model_copy(update={"pushes": (Push(start=(0.15, 0.0), end=(0.3, 0.0)),)})
    off_table = SCENE.replace(pushes=(Push(start=(0.0, 0.0), end=(-1.2, 0.0)),))
    fine = SCENE.replace(pushes=(Push(start=(0.0, 0.0), end=(0.1, 0.0)),))
    why = refusals([over_cup, off_table, fine])
    assert "-50 mm from body 'cup'" in str(why[0])
    assert "leave the table at (-1.2, 0)" in str(why[1])
    assert why[2] is None
    assert refusals([fine], reach=lambda scene, push: "too far")[0] == "too far"
    assert admitted([over_cup, fine]) == [1]
    with pytest.raises(PlanningError, match=r"none of 2 plans can be tried.*'cup'"):
        admitted([over_cup, over_cup])
    # The clearance is the scene's.
    near = fine.model_copy(update={"pushes": (Push(start=(0.08, 0.0), end=(0.1, 0.0)),)})
    assert refusals([near])[0] is None
    assert "clearance of 50 mm" in str(refusals([near.replace(clearance=0.05)])[0])


def follows_the_tool(scenes: list[Scene]) -> list[Track]:
    """Dynamics for tests: the first body is where the tool is, the second stays."""
    tracks = []
    for scene in scenes:
        tool, push = plan_tool(scene.pushes, scene.tool)
        other = np.repeat(scene.poses_world_from_body[None, 1:], len(tool), 0)
        all_poses = np.concatenate((tool[:, None], tool[:, None], other), 1)
        seen = np.ones(all_poses.shape[:2], dtype=bool)
        tracks.append(Track(scene, np.arange(len(tool)) * FRAME, all_poses, push, seen))
    return tracks


def test_the_best_tool_and_push_win_and_end_in_the_best_frame():
    goal = Goal(body="cup", position=(-0.2, -0.1))
    tools = [NamedTool("wide", Tool.round(0.2)), NamedTool("thin", Tool.round(0.02))]
    plan = plan_exhaustively(SCENE, cost_of(SCENE, goal), follows_the_tool, tools, sequences())
    assert plan.cost == pytest.approx(0, abs=1e-7)
    assert plan.end[0, :2] == pytest.approx(goal.position)
    (push,) = plan.pushes
    assert push.times is not None
    assert push.times[-1] == pytest.approx(3.0)
    assert plan.expected.times[-1] == pytest.approx(3.0)
    # One that does best by not moving says so.
    stay = plan_exhaustively(SCENE, kept_cost(SCENE, ["tin"]), follows_the_tool, tools, sequences())
    assert (stay.pushes, len(stay.expected.times)) == ((), 1)


def test_plans_off_the_table_are_never_chosen():
    goal = Goal(body="cup", position=(0.35, 0.0))
    scene = SCENE.replace(table=SCENE.table.replace(size=(0.62, 2.0)))
    off_table = cost_of(SCENE, goal)
    plan = plan_exhaustively(scene, off_table, follows_the_tool, [NamedTool("thin", Tool.round(0.02))], sequences())
    assert plan.end[0, 0] <= 0.31


def test_learned_plan_is_executed_as_expected(predictor):
    goal = Goal(body="cup", position=(0.35, 0.15))
    plan = plan_exhaustively(
        SCENE, cost_of(SCENE, goal), learned(predictor, spread=True), load_tools(["stick"]), sequences()
    )
    (track,) = simulated([plan.scene])
    assert np.hypot(*(track.poses[-1, 1:, :2] - plan.end[:, :2]).T).max() < 0.01
    assert plan.end_region("cup").along > 0


def test_a_saved_plan_is_read_back(tmp_path):
    goal = cost_of(SCENE, Goal(body="cup", position=(-0.2, -0.1)))
    plan = plan_exhaustively(SCENE, goal, follows_the_tool, [NamedTool("thin", Tool.round(0.02))], sequences())
    path = tmp_path / "plan.json"
    plan.save(path)
    assert load_plan(path) == ("thin", plan.scene)
    assert json.loads(path.read_text())["expected_end"]["cup"][:2] == pytest.approx([-0.2, -0.1])
    path.write_text(path.read_text()[:-40])
    with pytest.raises(PlanningError, match="truncated"):
        load_plan(path)
    path.write_text('{"format": "pushgraph.track", "version": 1}')
    with pytest.raises(PlanningError, match="not a plan"):
        load_plan(path)
