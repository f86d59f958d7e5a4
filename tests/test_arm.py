"""The arm: kinematics in closed form and by inverse kinematics agree, limits hold, and it pushes as the tool alone."""

import json
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scenes import body

from pushgraph.arm import NEAREST, Arm
from pushgraph.errors import ArmError, SceneError
from pushgraph.joint_trajectory import JointTrajectory
from pushgraph.scene import Scene
from pushgraph.shape import Cylinder
from pushgraph.simulation.arm import ArmSimulation, simulate_with_arm
from pushgraph.simulation.arm_model import ACCELERATION_LIMIT, ANGLE_LIMITS, SPEED_LIMITS, TOOL_SITE, build_arm
from pushgraph.simulation.arm_path import SAMPLE, SAMPLES_PER_FRAME, along_push
from pushgraph.simulation.arm_planning import ArmPlanner, InverseKinematics, trajectory_of
from pushgraph.simulation.arm_surface import ArmSurface
from pushgraph.simulation.motion import ToolMotion
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push
from pushgraph.track import LIFTED
from pushgraph.viewer.arm_animation import save_arm_animation


def one_cup(*pushes: Push, arm: Arm = Arm(), **fields) -> Scene:  # noqa: B008
    return Scene(bodies=(body("cup", -0.2, 0.0),), pushes=pushes, arm=arm, **fields)


AWAY = Push(start=(0.0, 0.0), end=(-0.25, 0.02), speed=0.2)


def random_poses(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    angle, distance = rng.uniform(-math.pi, math.pi, count), rng.uniform(0.1, 1.5, count)
    x, y, _ = Arm().pose_world_from_base
    return np.column_stack((x + distance * np.cos(angle), y + distance * np.sin(angle), rng.uniform(-6, 6, count)))


def test_closed_form_angles_bring_the_model_s_tool_to_every_pose_within_reach() -> None:
    scene = one_cup()
    model = build_arm(scene)
    data = mujoco.MjData(model.mujoco)
    poses = random_poses(300)
    reached = scene.arm.reaches(poses)
    assert 100 < reached.sum() < 280
    for lift in (0.0, 0.15):
        for pose, angles in zip(poses[reached], scene.arm.joint_angles(poses[reached], lift), strict=True):
            data.qpos[:] = angles
            mujoco.mj_kinematics(model.mujoco, data)
            site = data.site(TOOL_SITE)
            np.testing.assert_allclose(site.xpos, [*pose[:2], model.pushing_height + lift], atol=1e-9)
            heading = [math.cos(pose[2]), math.sin(pose[2]), 0.0]
            np.testing.assert_allclose(site.xmat.reshape(3, 3)[:, 0], heading, atol=1e-9)
            np.testing.assert_allclose(site.xmat.reshape(3, 3)[:, 2], [0, 0, -1], atol=1e-9)


def test_what_is_in_reach_is_what_inverse_kinematics_finds() -> None:
    scene = one_cup()
    kinematics = InverseKinematics(build_arm(scene))
    poses = random_poses(150) * [1, 1, 0.3]
    poses = poses[scene.arm.distances(poses) >= NEAREST]
    x, y, _ = scene.arm.pose_world_from_base
    for pose, reached in zip(poses, scene.arm.reaches(poses), strict=True):
        # From a place in reach towards the pose, in small steps, as along a path.
        bearing = math.atan2(pose[1] - y, pose[0] - x)
        begin = np.array([x + 0.7 * math.cos(bearing), y + 0.7 * math.sin(bearing), pose[2]])
        angles = scene.arm.joint_angles(begin, scene.arm.lift)
        for share in np.linspace(0, 1, 12):
            angles = kinematics.solve(angles, begin + share * (pose - begin), scene.arm.lift)
            if angles is None:
                break
        assert (angles is not None) == reached
        if reached:
            np.testing.assert_allclose(angles, scene.arm.joint_angles(pose, scene.arm.lift), atol=1e-4)


def test_a_stretched_arm_reaches_as_far_as_it_says() -> None:
    arm = Arm(pose_world_from_base=(0.0, 0.0, 0.0))
    edge = np.array([[arm.farthest - 1e-6, 0.0, 0.0], [arm.farthest + 1e-6, 0.0, 0.0]])
    assert arm.reaches(edge).tolist() == [True, False]
    level = arm.replace(base_height=arm.flange_height + 0.0922 - 0.1273 + arm.lift / 2)
    height = arm.lift / 2
    by_hand = math.hypot(math.sqrt((0.612 + 0.5723) ** 2 - height**2) + 0.1157, 0.163941)
    assert level.farthest == pytest.approx(by_hand)


def test_the_default_place_reaches_every_way_of_three_pushes_of_20_cm_from_the_origin() -> None:
    steps = 0.2 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    corners = [a + b + c for a in steps for b in steps for c in steps]
    poses = np.array([[x * s, y * s, 0.0] for x, y in corners for s in np.linspace(0, 1, 20)])
    assert Arm().reaches(poses).all()


def test_every_point_of_a_trajectory_is_within_the_limits_and_follows_the_one_before() -> None:
    scene = one_cup(
        Push(start=(0.0, 0.0), path=((-0.2, 0.1), (-0.2, 0.3), (0.0, 0.3, 2.0)), speed=0.1),
        Push(start=(-0.5, -0.3), end=(-0.3, -0.2), yaw=3.0, speed=0.3),
    )
    planner = ArmPlanner(scene)
    found = trajectory_of(planner.model.joint_names, [planner.plan(push) for push in scene.pushes])
    assert (np.abs(found.positions) <= ANGLE_LIMITS).all()
    assert (np.abs(found.velocities) <= SPEED_LIMITS).all()
    assert (np.abs(found.accelerations) <= ACCELERATION_LIMIT).all()
    np.testing.assert_allclose(np.diff(found.times), SAMPLE, atol=1e-9)
    step = np.diff(found.positions, axis=0)
    mean = (found.velocities[1:] + found.velocities[:-1]) / 2 * SAMPLE
    assert np.abs(step - mean).max() < ACCELERATION_LIMIT * SAMPLE**2
    assert np.abs(found.velocities[[0, -1]]).max() == 0


def test_a_push_near_the_end_of_reach_is_slowed_and_one_with_times_refused() -> None:
    base = Arm().pose_world_from_base

    def place(distance: float) -> tuple[float, float]:
        return base[0] - distance * math.cos(0.3), base[1] + distance * math.sin(0.3)

    out = Push(start=place(1.0), end=place(1.29), speed=0.3)
    scene = one_cup()
    plan = ArmPlanner(scene).plan(out)
    assert plan.down.frames > along_push(ToolMotion(out, scene.tool)).lift.size // SAMPLES_PER_FRAME
    fast = Push(start=place(0.5), path=(place(0.8), place(0.5)), times=(0.6, 1.2))
    with pytest.raises(ArmError, match=r"pushes\[0\]: .*acceleration limit of \w+_joint: .* at most 5.00 are valid"):
        ArmPlanner(scene).plan(fast)
    with pytest.raises(ArmError, match=r"pushes\[0\]: .*speed limit of \w+_joint"):
        ArmPlanner(scene).plan(Push(start=place(0.35), path=((base[0] - 0.34, base[1] - 0.1),), times=(0.2,)))


@pytest.mark.parametrize(
    ("push", "arm", "message"),
    [
        (
            Push(start=(-0.9, 0.0), end=(-0.5, 0.0)),
            Arm(),
            r"pushes\[0\]: the tool at \(-0.900, 0.000\).*out of .*reach",
        ),
        (Push(start=(0.0, 0.0), end=(0.5, -0.4)), Arm(), r"pushes\[0\]: .* from 0.33 to 1.30 m are valid"),
        (AWAY.replace(force_limit=3.0), Arm(), r"pushes\[0\].force_limit: the arm is controlled by position"),
        (AWAY, Arm(lift=0.1), r"arm.lift: 0.1 m do not clear body 'cup'"),
        (AWAY, Arm(base_height=-0.3), r"on the way to its start: .* upper arm would touch the table"),
    ],
)
def test_what_the_arm_cannot_do_is_said_before_it_moves(push: Push, arm: Arm, message: str) -> None:
    with pytest.raises(ArmError, match=message):
        simulate_with_arm(one_cup(push, arm=arm))
    with pytest.raises(ArmError, match="has none"):
        simulate_with_arm(one_cup())


def test_the_arm_pushes_as_the_tool_alone_and_its_tool_is_where_its_joints_say() -> None:
    scene = one_cup(AWAY, Push(start=(-0.1, -0.25), end=(-0.2, -0.05)))
    done = simulate_with_arm(scene)
    alone = simulate(scene)
    np.testing.assert_allclose(done.track.poses[-1, 1:, :2], alone.poses[-1, 1:, :2], atol=1e-3)
    assert np.hypot(*(alone.poses[-1] - alone.poses[0])[1, :2]) > 0.1
    model = build_arm(scene)
    data = mujoco.MjData(model.mujoco)
    for angles, tool in zip(done.joint_positions, done.track.poses[:, 0], strict=True):
        data.qpos[:] = angles
        mujoco.mj_kinematics(model.mujoco, data)
        np.testing.assert_allclose(data.site(TOOL_SITE).xpos[:2], tool[:2], atol=1e-9)
    told = done.trajectory.positions[::SAMPLES_PER_FRAME]
    lag = np.abs(done.joint_positions - told)
    assert 1e-4 < lag.max() < 0.01
    assert done.track.push[0] == LIFTED
    assert done.track.times[-1] == pytest.approx(done.trajectory.times[-1])


def test_a_heavier_load_holds_the_arm_back_more() -> None:
    def lag(mass: float) -> float:
        scene = one_cup(AWAY).replace(bodies=(body("cup", -0.2, 0.0, mass=mass),))
        done = simulate_with_arm(scene)
        middle = int(np.flatnonzero(done.track.down)[20])
        told = along_push(ToolMotion(AWAY, scene.tool)).poses[20 * SAMPLES_PER_FRAME]
        return float(np.hypot(*(told - done.track.poses[middle, 0])[:2]))

    assert lag(10.0) > lag(1.0) > lag(0.1)
    assert lag(0.1) < 1e-4


def test_pushes_chosen_as_it_goes_are_those_of_a_scene(tmp_path: Path) -> None:
    scene = one_cup(AWAY, Push(start=(-0.1, -0.25), end=(-0.2, -0.1)))
    simulation = ArmSimulation(scene.replace(pushes=()))
    for push in scene.pushes:
        simulation.push(push)
    done, whole = simulation.execution(), simulate_with_arm(scene)
    assert done.track.poses.tobytes() == whole.track.poses.tobytes()
    whole.trajectory.save(tmp_path / "joints.json")
    assert JointTrajectory.load(tmp_path / "joints.json") == done.trajectory
    read = json.loads((tmp_path / "joints.json").read_text())
    assert read["joint_names"][0] == "shoulder_pan_joint"
    assert set(read["points"][0]) == {"positions", "velocities", "accelerations", "time_from_start"}
    assert set(read["points"][0]["time_from_start"]) == {"sec", "nanosec"}


def test_a_scene_carries_its_arm_along_and_names_its_faults() -> None:
    scene = one_cup(AWAY)
    moved = scene.moved(np.array([1.0, 2.0, 0.5]))
    assert Scene.from_json(moved.to_json()) == moved
    poses = random_poses(50)
    assert (moved.arm.reaches(np.array([[1.0, 2.0, 0.5]])) == scene.arm.reaches(np.zeros((1, 3)))).all()
    assert scene.arm.moved(np.zeros(3)).reaches(poses).tolist() == scene.arm.reaches(poses).tolist()
    with pytest.raises(SceneError, match=r"arm.*flange_height"):
        Scene.from_json(scene.to_json().replace('"flange_height": 0.3', '"flange_height": 9'))


def test_rounding_keeps_the_ends_and_cuts_a_right_angle_by_2_mm() -> None:
    push = Push(start=(0.1, 0.2), path=((0.3, 0.2), (0.3, 0.4)), speed=0.1)
    path = along_push(ToolMotion(push, one_cup().tool))
    np.testing.assert_array_equal(path.poses[0], [0.1, 0.2, 0.0])
    np.testing.assert_allclose(path.poses[-1], [0.3, 0.4, 0.0], atol=1e-12)
    cut = np.hypot(*(path.poses[:, :2] - [0.3, 0.2]).T).min()
    assert cut == pytest.approx(0.1 * math.sqrt(2) * 0.1 / 8, rel=0.02)


def test_the_arm_is_drawn_where_it_is(tmp_path: Path) -> None:
    scene = one_cup(Push(start=(0.0, 0.0), end=(-0.02, 0.0)))
    surface = ArmSurface(scene)
    angles = scene.arm.joint_angles(np.array([-0.1, 0.1, 0.4]), 0.1)
    corners = surface.at(angles)
    assert surface.lift(angles) == pytest.approx(0.1)
    lowest = corners.reshape(-1, 3)[corners[..., 2].argmin()]
    np.testing.assert_allclose(lowest, [-0.1, 0.1, 0.15], atol=0.031)
    save_arm_animation(simulate_with_arm(scene), tmp_path / "arm.gif")
    assert (tmp_path / "arm.gif").stat().st_size > 10_000


def test_a_low_base_pushes_tall_bodies_only_as_high_as_its_forearm() -> None:
    tall = Scene(
        bodies=(body("post", -0.2, 0.0, Cylinder(diameter=0.1, height=0.32)),), pushes=(AWAY,), arm=Arm(lift=0.35)
    )
    with pytest.raises(ArmError, match="would touch the table or what stands on it"):
        simulate_with_arm(tall)
