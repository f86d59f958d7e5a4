"""Laws of boards in space: by hand, and whatever the weights."""

import math

import numpy as np
import pytest
import torch

from pushgraph import pose_3d
from pushgraph.graph.lever_batch import LeverState, start_lever
from pushgraph.lever_physics import LeverPredictor, rollout_lever, tool_knots
from pushgraph.lever_scene import Box, LeverScene, LeverTool, ToolBox, WayPoint
from pushgraph.network.lever_dynamics import LEVERS, LeverContact, LeverDynamics
from pushgraph.track_frames import FRAME

FLOOR = Box(name="floor", size=(1.0, 1.0, 0.1), position=(0.0, 0.0, -0.05), fixed=True)
FAR = (0.0, 0.0, 5.0)


def scene(
    board: Box, *fixed: Box, path: tuple[WayPoint, ...] = (WayPoint(time=0, position=FAR),), friction: float = 0.3
) -> LeverScene:
    tool = LeverTool(boxes=(ToolBox(size=(0.1, 0.02, 0.004), position=(0.05, 0.0, 0.002)),), friction=friction)
    return LeverScene(bodies=(*fixed, board), tool=tool, path=path)


def board(z: float, friction: float = 0.3, quaternion: tuple[float, ...] = (1, 0, 0, 0)) -> Box:
    return Box(name="board", size=(0.1, 0.15, 0.01), position=(0, 0, z), friction=friction, quaternion=quaternion)


def levered() -> LeverScene:
    """A board across a plate's edge, and a tool that goes under its overhang and turns."""
    plate = Box(name="plate", size=(0.1, 0.2, 0.004), position=(-0.03, 0.0, 0.002), fixed=True)
    level = (0.0, 0.0, 0.0, 1.0)
    lifted = pose_3d.multiply(np.array(level), np.array([math.cos(0.15), 0.0, -math.sin(0.15), 0.0]))
    path = (
        WayPoint(time=0, position=(0.16, 0.01, 0.0), quaternion=level),
        WayPoint(time=0.4, position=(0.13, 0.01, 0.0), quaternion=level),
        WayPoint(time=1.2, position=(0.13, 0.01, 0.0), quaternion=tuple(lifted.tolist())),
    )
    return scene(board(0.009), plate, FLOOR, path=path)


def dynamics(kind: str, answers: float = 0.0) -> LeverDynamics:
    """With random answers of about this size."""
    torch.manual_seed(0)
    found = LEVERS[kind](hidden=16).double().eval()
    with torch.no_grad():
        found.network.head[-1].weight.normal_(std=answers)
    return found


def rolled(found: LeverDynamics, what: LeverScene, frames: int, state: LeverState | None = None) -> torch.Tensor:
    with torch.no_grad():
        tool = torch.from_numpy(tool_knots(what, frames))[None]
        return rollout_lever(found, state or start_lever([what]), tool)[0]


def test_free_fall_and_landing():
    poses = rolled(LeverContact().eval(), scene(board(0.305), FLOOR), 20)
    times = torch.arange(21) * FRAME
    fallen = 0.3 - 9.81 / 2 * times[:4] ** 2
    # The steps are implicit: too far by half of the last one's gain.
    torch.testing.assert_close(poses[:4, 2] - 0.005, fallen.double(), atol=2e-2, rtol=0)
    assert float(poses[-1, 2]) == pytest.approx(0.005, abs=5e-5)


@pytest.mark.parametrize(("degrees", "slides"), [(10, False), (25, True)])
def test_a_board_on_a_slope_slides_as_coulomb_says(degrees, slides):
    angle = math.radians(degrees)
    turn = (math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0)
    slope = Box(name="slope", size=(2, 2, 0.1), position=(0, 0, 0), quaternion=turn, fixed=True)
    up = np.array([math.sin(angle), 0, math.cos(angle)]) * 0.055
    on_slope = board(0, quaternion=turn).replace(position=tuple(up.tolist()))
    poses = rolled(LeverContact().eval(), scene(on_slope, slope), 8)
    way = float((poses[-1, :3] - poses[0, :3]).norm())
    if slides:
        acceleration = 9.81 * (math.sin(angle) - 0.3 * math.cos(angle))
        # Implicit steps go farther by half a step's gain a step.
        assert way == pytest.approx(acceleration / 2 * 0.4 * (0.4 + FRAME / 2), rel=0.01)
        torch.testing.assert_close(poses[-1, 3:], poses[0, 3:], atol=1e-5, rtol=0)
    else:
        assert torch.equal(poses[-1], poses[0])


def test_a_board_over_the_edge_tips():
    table = Box(name="table", size=(0.2, 0.4, 0.1), position=(-0.11, 0, -0.05), fixed=True)
    balanced = Box(name="table", size=(0.2, 0.4, 0.1), position=(-0.09, 0, -0.05), fixed=True)
    assert float(rolled(LeverContact().eval(), scene(board(0.005), table), 8)[-1, 2]) < -0.05
    poses = rolled(LeverContact().eval(), scene(board(0.005), balanced), 8)
    assert torch.equal(poses[-1], poses[0])


def test_a_levered_board_rises_and_is_not_penetrated():
    track = LeverPredictor(LeverContact().eval()).predict(levered())
    assert track.rise[-1] > 0.02
    assert track.penetration.max() < 5e-4


@pytest.mark.parametrize("kind", LEVERS)
def test_turning_the_scene_about_the_vertical_turns_the_motion(kind):
    found, what = dynamics(kind, 0.1), levered()
    state, tool = start_lever([what]), torch.from_numpy(tool_knots(what, 14))[None]
    turn = torch.tensor([0.3, -2.0, 0.0, math.cos(0.7), 0.0, 0.0, math.sin(0.7)], dtype=torch.float64)
    place = torch.where(state.scenes.of_tool[..., None], state.scenes.pose, pose_3d.compose(turn, state.scenes.pose))
    turned = LeverState(state.scenes._replace(pose=place), pose_3d.compose(turn, state.pose), state.velocity)
    with torch.no_grad():
        poses = rollout_lever(found, state, tool)
        other = rollout_lever(found, turned, pose_3d.compose(turn, tool))
    expected = pose_3d.compose(turn, poses)
    assert float((poses[0, -1] - poses[0, 0]).norm()) > 1e-3
    assert float((other - expected)[..., :3].norm(dim=-1).amax()) < 1e-5
    assert float(pose_3d.rotation_error(other, expected).amax()) < 1e-4


@pytest.mark.parametrize("kind", LEVERS)
def test_both_signs_of_quaternions_are_one(kind):
    found, what = dynamics(kind, 0.1), levered()
    state, tool = start_lever([what]), torch.from_numpy(tool_knots(what, 14))[None]
    sign = torch.tensor([1, 1, 1, -1, -1, -1, -1.0], dtype=torch.float64)
    other = LeverState(state.scenes._replace(pose=state.scenes.pose * sign), state.pose * sign, state.velocity)
    with torch.no_grad():
        poses = rollout_lever(found, state, tool)
        assert torch.equal(rollout_lever(found, other, tool * sign), poses * sign)


@pytest.mark.parametrize("kind", LEVERS)
def test_what_nothing_touches_stays(kind):
    found = dynamics(kind, 0.1)
    still = rolled(found, scene(board(0.005), FLOOR), 5)
    assert torch.equal(still[-1], still[0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", LEVERS)
def test_quaternions_stay_unit(kind):
    poses = rolled(dynamics(kind, 0.1), levered(), 300)
    assert poses.isfinite().all()
    assert float((poses[:, 3:].norm(dim=-1) - 1).abs().amax()) < 1e-6


@pytest.mark.parametrize("kind", LEVERS)
def test_scenes_side_by_side_are_as_alone(kind):
    found, scenes = dynamics(kind, 0.1), [levered(), scene(board(0.02), FLOOR)]
    tool = torch.from_numpy(np.stack([tool_knots(what, 12) for what in scenes]))
    with torch.no_grad():
        together = rollout_lever(found, start_lever(scenes), tool)
    for k, what in enumerate(scenes):
        torch.testing.assert_close(rolled(found, what, 12), together[k], atol=1e-7, rtol=0)


def test_gradients_of_the_correction_are_those_of_finite_differences():
    """One step, at the contacts there are."""
    from pushgraph.network.body_step import step

    what = levered()
    tool = torch.from_numpy(tool_knots(what, 14))[None]
    state = start_lever([what])
    with torch.no_grad():
        for k in range(26):
            state = step(state, tool[:, k], tool[:, k + 1], FRAME / 2)

    def moved(wrench: torch.Tensor) -> torch.Tensor:
        return step(state, tool[:, 26], tool[:, 27], FRAME / 2, wrench).velocity

    wrench = torch.full((1, 6), 1e-3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(moved, wrench, eps=1e-4, atol=1e-3, rtol=1e-2)
