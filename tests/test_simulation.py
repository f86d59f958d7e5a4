"""The simulator against theory, and the paper's table of joints."""

import math

import numpy as np
import pytest
from exact_shapes import mean_radius

from pushgraph.body import Body, Joint
from pushgraph.errors import SimulationError
from pushgraph.pose import compose, inverse, relative, transform
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.motion import ToolMotion, plan_tool
from pushgraph.simulation.own_frame import OwnFrame
from pushgraph.simulation.planar import PlanarSimulation, simulate
from pushgraph.simulation.planar_model import TIMESTEP, build
from pushgraph.tool import Part, Push, Tool

GRAVITY = 9.81


def body(name: str, x: float, y: float, shape=None, yaw: float = 0.0, mass: float = 0.5) -> Body:
    return Body(name=name, shape=shape or Cylinder(diameter=0.12), pose_world_from_body=(x, y, yaw), mass=mass)


def two_touching(kind: str, mass: float = 0.5, y: float = 0.0, gap: float = 0.0, **fields) -> Scene:
    """The scene of the paper's Table 1: the robot pushes between two touching objects."""
    joints = () if kind == "none" else (Joint(kind=kind, parent="upper", child="lower"),)
    bodies = (body("upper", 0.0, 0.06 + gap / 2, mass=mass), body("lower", 0.0, -0.06 - gap / 2, mass=mass))
    push = Push(start=(-0.2, y), direction=0.0, distance=0.3)
    return Scene(bodies=bodies, joints=joints, pushes=(push,), **fields)


def thrown(scene: Scene, twist: tuple[float, float, float], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Pose changes and twists of a lone piece after each step, thrown with this twist, by the simulator's own model."""
    import mujoco

    model = build(scene).mujoco
    data = mujoco.MjData(model)
    data.qvel[:3] = twist
    start, poses, twists = data.qpos[:3].copy(), [], []
    for _ in range(steps):
        mujoco.mj_step(model, data)
        poses.append(data.qpos[:3] - start)
        twists.append(data.qvel[:3].copy())
    return np.array(poses), np.array(twists)


THROWN = {
    "disc": (body("a", 0, 0, Cylinder(diameter=0.12)),),
    "box": (body("a", 0, 0, Cuboid(size=(0.16, 0.08)), yaw=0.3),),
    "bar": (body("a", 0.2, 0, Cuboid(size=(0.3, 0.03)), yaw=1.0, mass=8.0),),
    "small box": (body("a", 0, 0, Cuboid(size=(0.012, 0.01)), mass=0.005),),
    "L": (
        body("a", 0, 0, Cuboid(size=(0.2, 0.04)), mass=0.5),
        body("b", 0.08, 0.06, Cuboid(size=(0.04, 0.08)), mass=0.2),
    ),
    "on three feet": (
        body("a", 0, 0, Cylinder(diameter=0.12)).replace(support=((0.05, 0.0), (-0.03, 0.04), (-0.03, -0.04))),
    ),
}


@pytest.mark.parametrize("friction", [0.05, 0.45, 1.5])
@pytest.mark.parametrize("form", list(THROWN))
@pytest.mark.parametrize("degrees", [0, 33])
def test_what_slides_free_decelerates_by_friction_times_gravity(form: str, friction: float, degrees: float) -> None:
    bodies, angle = THROWN[form], math.radians(degrees)
    groups = (tuple(b.name for b in bodies),) if len(bodies) > 1 else ()
    scene = Scene(bodies=bodies, rigid_groups=groups, table=Table(friction=friction))
    direction = np.array([math.cos(angle), math.sin(angle)])
    _, twists = thrown(scene, (*(0.5 * direction), 0.0), steps=8)
    deceleration = (0.5 - twists[:, :2] @ direction) / (TIMESTEP * np.arange(1, 9))
    assert deceleration == pytest.approx(friction * GRAVITY, rel=0.01)
    assert np.abs(twists[:, :2] @ np.array([-direction[1], direction[0]])).max() < 1e-6
    assert np.abs(twists[:, 2]).max() < 1e-2


@pytest.mark.parametrize("form", ["disc", "box", "bar"])
def test_a_thrown_body_comes_to_rest_after_the_distance_of_coulomb_s_law(form: str) -> None:
    speed = 0.5
    poses, twists = thrown(Scene(bodies=THROWN[form]), (speed, 0.0, 0.0), steps=60)
    # A step moves the body by its speed at the step's end: on the whole it falls short by half a step.
    short = speed * TIMESTEP / 2
    assert poses[-1, 0] == pytest.approx(speed**2 / (2 * 0.45 * GRAVITY) - short, rel=0.01)
    assert np.abs(twists[-1]).max() < 1e-6


@pytest.mark.parametrize("shape", [Cylinder(diameter=0.12), Cuboid(size=(0.16, 0.08)), Cuboid(size=(0.24, 0.03))])
def test_spin_matches_the_torque_of_the_whole_patch(shape) -> None:
    spin = 8.0
    _, twists = thrown(Scene(bodies=(body("a", 0, 0, shape),)), (0, 0, spin), steps=5)
    half_x, half_y, radius = shape.core
    inertia_per_mass = radius**2 / 2 if radius else (half_x**2 + half_y**2) / 3
    deceleration = (spin - twists[-1, 2]) / (5 * TIMESTEP)
    assert deceleration == pytest.approx(0.45 * GRAVITY * mean_radius(shape) / inertia_per_mass, rel=0.05)


@pytest.mark.parametrize("shape", [Cylinder(diameter=0.12), Cuboid(size=(0.16, 0.08)), Cuboid(size=(0.1, 0.1))])
def test_mean_radius_matches_quadrature(shape) -> None:
    half_x, half_y, radius = shape.core
    reach_x, reach_y = (radius, radius) if radius else (half_x, half_y)
    x, y = np.meshgrid(np.linspace(-reach_x, reach_x, 2001), np.linspace(-reach_y, reach_y, 2001))
    distance = np.hypot(x, y)
    inside = distance <= radius if radius else np.ones_like(distance, dtype=bool)
    assert mean_radius(shape) == pytest.approx(distance[inside].mean(), rel=2e-3)


@pytest.mark.parametrize("kind", ["none", "fixed", "prismatic", "revolute"])
def test_masses_times_20_leave_the_track_of_two_objects(kind: str) -> None:
    light, heavy = (simulate(two_touching(kind, mass, y=-0.01)) for mass in (0.2, 4.0))
    assert np.abs(light.poses[:, 1:, :2] - light.poses[0, 1:, :2]).max() > 0.05
    assert np.abs(light.poses - heavy.poses)[..., :2].max() < 1e-4


@pytest.mark.parametrize("mass", [0.2, 1.0])
def test_masses_times_20_leave_the_track_of_one_object(mass: float) -> None:
    def track(mass: float) -> np.ndarray:
        box = body("a", 0, 0, Cuboid(size=(0.16, 0.08)), yaw=0.4, mass=mass)
        return simulate(Scene(bodies=(box,), pushes=(Push(start=(-0.2, 0.02), end=(0.1, 0.02)),))).poses

    assert np.abs(track(mass) - track(20 * mass))[..., :2].max() < 1e-4


def test_table_1_none_the_objects_part() -> None:
    track = simulate(two_touching("none"))
    apart = track.poses[:, 1, :2] - track.poses[:, 2, :2]
    distance = np.hypot(*apart.T)
    assert distance[0] == pytest.approx(0.12)
    assert distance[-1] > 0.2
    assert track.poses[-1, 1, 1] > 0.08
    assert track.poses[-1, 2, 1] < -0.08


def test_table_1_fixed_the_objects_move_together_with_the_end_effector() -> None:
    track = simulate(two_touching("fixed"))
    between = relative(track.poses[:, 1], track.poses[:, 2])
    assert np.abs(between - between[0]).max() < 1e-9
    assert (track.poses[-1, 1:, 0] > 0.15).all()


def test_table_1_prismatic_the_lower_slides_along_the_line_of_centres() -> None:
    track = simulate(two_touching("prismatic", y=-0.03))
    between = relative(track.poses[:, 1], track.poses[:, 2])
    assert np.abs(between[:, 0]).max() < 1e-9
    assert np.abs(between[:, 2]).max() < 1e-9
    assert between[:, 1].min() < -0.15
    assert between[:, 1].min() >= -0.12 - 0.08 - 1e-3
    assert between[:, 1].max() <= -0.12 + 1e-3


def test_table_1_revolute_the_lower_turns_about_the_upper() -> None:
    # Discs hinged where they touch cannot turn; a gap of 1 cm lets them turn by 2 acos(6.0 / 6.5) = 0.79 rad.
    scene = two_touching("revolute", y=-0.1, gap=0.01)
    track = simulate(scene)
    anchor = scene.joint_frame(scene.joints[0]).anchor
    ends = [transform(track.poses[:, node], transform(inverse(track.poses[0, node]), anchor)[None]) for node in (1, 2)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-9
    turned = track.poses[:, 2, 2] - track.poses[:, 1, 2]
    assert turned[-1] > 0.5
    assert turned.max() < 0.79 + 0.02


def test_joint_limits_hold_whichever_end_the_tree_starts_from() -> None:
    def spread(parent: str, child: str) -> np.ndarray:
        slider = Joint(kind="prismatic", parent=parent, child=child, axis=(0, 1), limits=(-0.05, 0.01))
        scene = two_touching("none", y=0.0).replace(joints=(slider,))
        return np.ptp(simulate(scene).poses[:, 1:, 1] @ np.array([1, -1]))

    # The lower parts from the upper along -y: as the child by its lower limit, as the parent by its upper.
    assert spread("upper", "lower") == pytest.approx(0.05, abs=2e-3)
    assert spread("lower", "upper") == pytest.approx(0.01, abs=2e-3)


def test_bodies_hardly_overlap() -> None:
    from pushgraph.dataset.summary import penetration

    shapes = [Cylinder(diameter=0.1), Cuboid(size=(0.1, 0.14))]
    bodies = tuple(body(f"b{k}", 0.15 * (k % 3), 0.15 * (k // 3), shapes[k % 2], mass=0.2 + 0.1 * k) for k in range(9))
    pushes = (Push(start=(-0.25, 0.15), end=(0.1, 0.15)), Push(start=(0.15, -0.3), end=(0.15, 0.0)))
    simulation = PlanarSimulation(Scene(bodies=bodies, pushes=pushes))
    for push in pushes:
        simulation.push(push)
    assert penetration(simulation.track()).max() < 1e-3


def test_tool_follows_a_trapezoid_below_the_speed_and_one_metre_per_second_squared() -> None:
    push = Push(start=(0.1, 0.2), direction=math.pi / 2, distance=0.3, speed=0.25, yaw=0.5, rotation=1.0)
    tool = Tool(parts=(Part(shape=Cuboid(size=(0.1, 0.02)), pose_tool_from_part=(-0.1, 0.0, 0.0)),))
    motion = ToolMotion(push, tool)
    times = np.linspace(-0.1, motion.duration + 0.1, 4001)
    poses = np.array([motion.pose(time) for time in times])
    np.testing.assert_allclose(poses[0], [0.1, 0.2, 0.5])
    np.testing.assert_allclose(poses[-1], [0.1, 0.5, 1.5], atol=1e-12)
    corner = transform(poses, np.array([-0.15, 0.01]))
    speed = np.hypot(*np.diff(corner, axis=0).T) / np.diff(times)
    assert speed.max() <= 0.25 + 1e-6
    acceleration = np.diff(np.hypot(*np.diff(poses[:, :2], axis=0).T) / np.diff(times)) / np.diff(times)[1:]
    assert np.abs(acceleration).max() < 1.0 + 1e-6


WINDING = [(0.3, 0.0), (0.3, 0.0), (0.3, 0.2, 1.0), (0.1, 0.3, 1.5), (0.1, 0.3, 0.2)]


def test_tool_follows_one_trapezoid_along_a_whole_polyline() -> None:
    push, tool = Push(start=(0, 0), path=WINDING, speed=0.25), Tool.round(0.1)
    motion = ToolMotion(push, tool)
    length = 0.3 + (0.2 + 0.05) + (math.hypot(0.2, 0.1) + 0.025) + 1.3 * 0.05
    assert motion.duration == pytest.approx(length / 0.25 + 0.25)
    times = np.linspace(-0.1, motion.duration + 0.1, 20001)
    poses = motion.poses(times)
    np.testing.assert_array_equal(poses[0], push.waypoints[0])
    np.testing.assert_array_equal(poses[-1], push.waypoints[-1])
    change = np.abs(np.diff(poses, axis=0))
    steps = np.hypot(*change[:, :2].T) + 0.05 * change[:, 2]
    assert steps.sum() == pytest.approx(length, abs=1e-4)
    speed = steps / np.diff(times)
    assert speed.max() == pytest.approx(0.25, abs=1e-6)
    acceleration = np.abs(np.diff(speed) / np.diff(times)[1:])
    but_across_corners = np.sort(acceleration)[:-10]
    assert but_across_corners.max() == pytest.approx(1.0, abs=1e-6)
    for corner in push.waypoints:  # it goes through each, and does not stop there
        assert np.abs(poses - corner).max(-1).min() < 1e-4
    steady = speed[(times[1:] > 0.3) & (times[1:] < motion.duration - 0.3)]
    assert (steady > 0.24).mean() > 0.999  # all but the steps across corners


def test_way_points_on_a_line_do_not_change_a_straight_push() -> None:
    straight = Push(start=(0.1, 0.2), end=(0.5, 0.5), speed=0.3)
    dotted = Push(start=(0.1, 0.2), path=[(0.14, 0.23), (0.3, 0.35), (0.3, 0.35), (0.5, 0.5)], speed=0.3)
    tool = Tool.round(0.1)
    (before, _), (after, _) = (plan_tool([push], tool) for push in (straight, dotted))
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_tool_is_at_each_way_point_at_its_time_and_goes_evenly_between_them() -> None:
    times = (0.5, 0.8, 2.0, 3.0, 3.1234)
    push = Push(start=(0, 0), yaw=-0.3, path=WINDING, times=times, rest=0.0)
    motion = ToolMotion(push, Tool.round(0.1))
    assert motion.duration == 3.1234
    assert motion.frames == 63
    np.testing.assert_array_equal(motion.poses(np.array([0.0, *times])), push.waypoints)
    np.testing.assert_allclose(motion.pose(1.4), (push.waypoints[2] + push.waypoints[3]) / 2)
    np.testing.assert_array_equal(motion.pose(99.0), push.waypoints[-1])


@pytest.mark.parametrize("times", [None, (0.5, 0.8, 2.0, 3.0, 3.1234)])
def test_a_path_in_a_turned_scene_is_the_turned_path(times) -> None:
    push = Push(start=(0, 0), yaw=-0.3, path=WINDING, times=times, speed=0.1)
    scene, motion = Scene(bodies=(body("a", 0.8, 0.8),), pushes=(push,)), np.array([1.0, -2.0, 2.5])
    moved = scene.moved(motion)
    (before, _), (after, _) = (plan_tool(one.pushes, one.tool) for one in (scene, moved))
    np.testing.assert_allclose(after, compose(motion, before), atol=1e-12)


@pytest.mark.parametrize("rest", [0.0, 0.2, 1.3])
def test_the_tool_rests_as_long_as_the_push_says(rest: float) -> None:
    push = Push(start=(0, 0), end=(0.3, 0), speed=0.2, rest=rest)
    assert ToolMotion(push, Tool.round(0.1)).frames == math.ceil((0.3 / 0.2 + 0.2 + rest) / 0.05 - 1e-9)
    poses, _ = plan_tool([push], Tool.round(0.1))
    assert (poses[:, 0] == 0.3).sum() == round(rest / 0.05) + 1


def test_a_rotating_composite_tool_sweeps_its_part_exactly() -> None:
    hammer = Tool(
        parts=(
            Part(shape=Cylinder(diameter=0.04)),
            Part(shape=Cuboid(size=(0.2, 0.02)), pose_tool_from_part=(0.12, 0.0, 0.0)),
        )
    )
    scene = Scene(bodies=(body("a", 0.15, 0.08),), tool=hammer, pushes=(Push(start=(0, 0), end=(0, 0), rotation=1.2),))
    track = simulate(scene)
    assert np.abs(track.poses[:, 0, :2]).max() == 0
    assert track.poses[-1, 0, 2] == pytest.approx(1.2)
    assert np.hypot(*(track.poses[-1, 1, :2] - track.poses[0, 1, :2])) > 0.05


def test_pushes_are_marked_and_the_tool_is_lifted_between_them() -> None:
    scene = Scene(
        bodies=(body("a", 0.5, 0.5),), pushes=(Push(start=(0, 0), end=(0.1, 0)), Push(start=(0, 0.2), end=(0.1, 0.2)))
    )
    track = simulate(scene)
    assert np.allclose(np.diff(track.times), 0.05)
    assert track.push_start.sum() == 2
    lifted = np.flatnonzero(~track.down)
    assert len(lifted) == 2
    np.testing.assert_array_equal(track.poses[lifted[0], 0], track.poses[lifted[0] - 1, 0])
    np.testing.assert_array_equal(track.poses[lifted[1], 0], track.poses[lifted[1] + 1, 0])
    rest = track.poses[lifted[0] - 4 : lifted[0], 0]
    assert np.ptp(rest, axis=0).max() == 0


def test_coasting_objects_stay_with_the_pusher_as_it_stops() -> None:
    track = simulate(Scene(bodies=(body("a", 0, 0),), pushes=(Push(start=(-0.2, 0), end=(0.1, 0), speed=0.3),)))
    assert track.poses[-1, 1, 0] - track.poses[-1, 0, 0] == pytest.approx(0.11, abs=2e-3)


def test_rerunning_a_track_s_scene_gives_the_same_bits() -> None:
    track = simulate(two_touching("revolute", y=0.013))
    again = simulate(Scene.from_json(track.scene.to_json()))
    assert again.poses.tobytes() == track.poses.tobytes()


def test_a_rigid_group_moves_as_one_and_its_parts_may_overlap() -> None:
    bodies = (body("a", 0, 0, Cuboid(size=(0.2, 0.04))), body("b", 0.08, 0.05, Cuboid(size=(0.04, 0.14))))
    scene = Scene(bodies=bodies, rigid_groups=(("a", "b"),), pushes=(Push(start=(-0.2, 0.0), end=(0.1, 0.0)),))
    track = simulate(scene)
    between = relative(track.poses[:, 1], track.poses[:, 2])
    assert np.abs(between - between[0]).max() < 1e-9
    assert track.poses[-1, 1, 0] > 0.1


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (
            Scene(bodies=(Body(name="a", shape=Cylinder(diameter=0.1), pose_world_from_body=(0, 0, 0)),)),
            "mass of body 'a'",
        ),
        (two_touching("none", table=Table(friction=None)), "table.friction"),
        (
            two_touching("none").replace(
                pushes=(Push(start=(-0.2, 0), end=(0.1, 0)), Push(start=(0.1, 0.1), end=(0.2, 0.1)))
            ),
            r"pushes\[1\].start: the tool would come down on body 'upper'",
        ),
    ],
)
def test_what_the_simulator_cannot_run_is_refused(scene: Scene, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate(scene)


def test_unknown_values_become_nominal_on_request() -> None:
    scene = two_touching("none", table=Table(friction=None), side_friction=None)
    known = scene.replace(bodies=tuple(b.replace(mass=None) for b in scene.bodies)).with_nominal_values()
    assert known.table.friction == 0.45
    assert known.side_friction == 0.25
    assert {b.mass for b in known.bodies} == {0.6}
    simulate(known)


def test_a_push_of_whole_frames_has_as_many_in_the_own_frame_of_a_scene() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        x, y, angle = rng.uniform(-1, 1, 3)
        end = (x + 0.2 * math.cos(angle), y + 0.2 * math.sin(angle))
        scene = Scene(bodies=(body("cup", *rng.uniform(-0.5, 0.5, 2), yaw=rng.uniform(-3, 3)),))
        push = Push(start=(x, y), end=end, speed=0.1)
        seen = OwnFrame(scene).push(push)
        assert ToolMotion(push, scene.tool).frames == ToolMotion(seen, scene.tool).frames == 46
