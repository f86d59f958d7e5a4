"""Pushes of what is joined or fixed, whose outcome geometry says."""

import math
from itertools import permutations

import numpy as np
import pytest
from scenes import body, mirrored, moved_by

from pushgraph.body import Joint
from pushgraph.plausibility import remarks
from pushgraph.pose import compose, relative, transform
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import Track

THIN = Tool.round(0.02)
LARGE = Table(size=(6, 6))


def reordered(scene: Scene, bodies, joints=None, swapped: bool = False) -> Scene:
    """The same scene with its bodies and joints in another order, also by name, and parents and children swapped."""
    names = {scene.names[k]: f"{place} {scene.names[k]}" for place, k in enumerate(bodies)}
    new = scene.replace(
        bodies=tuple(scene.bodies[k].replace(name=names[scene.names[k]]) for k in bodies),
        joints=tuple(
            scene.joints[k].replace(parent=names[scene.joints[k].parent], child=names[scene.joints[k].child])
            for k in joints or range(len(scene.joints))
        ),
        rigid_groups=tuple(tuple(names[name] for name in group) for group in scene.rigid_groups),
    )
    if not swapped:
        return new

    def other_way(joint: Joint) -> Joint:
        limits = None if joint.limits is None else (-joint.limits[1], -joint.limits[0])
        if joint.kind == "prismatic":  # its axis leads from parent to child
            return joint.replace(
                parent=joint.child, child=joint.parent, axis=(-joint.axis[0], -joint.axis[1]), limits=joint.limits
            )
        return joint.replace(parent=joint.child, child=joint.parent, limits=limits)

    return new.replace(joints=tuple(map(other_way, new.joints)))


def of(track: Track, name: str) -> np.ndarray:
    """Poses of a body over the track, whatever number stands before its name."""
    return track.poses[:, 1 + [known.split()[-1] for known in track.scene.names].index(name.split()[-1])]


def gape(track: Track) -> float:
    """How far apart (m) the two anchors of any hinge ever are."""
    worst = 0.0
    for joint in track.scene.joints:
        if joint.kind == "revolute":
            anchor = track.scene.joint_frame(joint).anchor
            ends = []
            for name in (joint.parent, joint.child):
                poses = of(track, name)
                ends.append(transform(poses, transform_back(poses[0], anchor)))
            worst = max(worst, float(np.hypot(*(ends[0] - ends[1]).T).max()))
    return worst


def transform_back(pose_world_from_body: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point of the world in the frame of a body."""
    return relative(pose_world_from_body, np.array([*point, 0.0]))[:2]


# Loops -----------------------------------------------------------------------------------------------------------


def four_bar(push: Push | None = None, **fields) -> Scene:
    """A ring of four hinged bars, 16 cm from hinge to hinge."""
    flat, upright, at = Cuboid(size=(0.13, 0.02)), Cuboid(size=(0.02, 0.13)), 0.08
    bars = (
        body("bottom", 0, -at, flat, mass=0.3),
        body("right", at, 0, upright, mass=0.3),
        body("top", 0, at, flat, mass=0.3),
        body("left", -at, 0, upright, mass=0.3),
    )
    corners = [(at, -at), (at, at), (-at, at), (-at, -at)]
    joints = tuple(
        Joint(kind="revolute", parent=bars[k].name, child=bars[(k + 1) % 4].name, anchor=corners[k]) for k in range(4)
    )
    push = push or Push(start=(-0.12, 0.03), end=(0.0, 0.03), speed=0.1)
    return Scene(bodies=bars, joints=joints, tool=THIN, pushes=(push,), **fields)


@pytest.mark.parametrize(
    "push",
    [
        Push(start=(-0.12, 0.03), end=(0.0, 0.03), speed=0.1),
        Push(start=(0.02, -0.12), end=(0.05, 0.0), speed=0.02),
    ],
)
def test_a_ring_of_four_bars_moves_the_same_wherever_the_loop_is_cut(push: Push) -> None:
    scene = four_bar(push)
    whole = simulate(scene)
    assert np.abs(moved_by(whole)[:, 2]).max() > 5
    for number, order in enumerate(permutations(range(4))):
        other = simulate(reordered(scene, order, np.roll(range(4), number).tolist(), swapped=number % 2 == 1))
        assert gape(other) < 0.5e-3
        for name in scene.names:
            assert np.abs(of(other, name) - of(whole, name))[:, :2].max() <= 2e-3, (order, name)


def test_a_ring_turned_and_mirrored_moves_as_the_ring() -> None:
    scene, motion = four_bar(), np.array([0.3, -0.2, 1.1])
    here = simulate(scene).poses
    assert np.abs(compose(motion, here) - simulate(scene.moved(motion)).poses)[..., :2].max() <= 0.3e-3
    assert np.abs(here * [1, -1, -1] - simulate(mirrored(scene)).poses)[..., :2].max() <= 0.01e-3


@pytest.mark.parametrize("held", ["bottom", "top"])
def test_a_ring_with_a_fixed_bar_stays_a_parallelogram(held: str) -> None:
    scene = four_bar(Push(start=(-0.12, 0.03 if held == "bottom" else -0.03), direction=0.0, distance=0.05))
    scene = scene.replace(bodies=tuple(b.replace(fixed=b.name == held) for b in scene.bodies))
    for order in ((0, 1, 2, 3), (2, 3, 0, 1), (3, 0, 2, 1)):
        track = simulate(reordered(scene, order))
        assert np.ptp(of(track, held), axis=0).max() == 0
        assert gape(track) < 0.5e-3
        assert abs(of(track, "left")[-1, 2]) > math.radians(8)
        assert of(track, "left")[-1, 2] == pytest.approx(of(track, "right")[-1, 2], abs=math.radians(0.3))
        other = "top" if held == "bottom" else "bottom"
        assert np.abs(of(track, other)[:, 2]).max() < math.radians(0.3)


def slider_crank() -> Scene:
    """A crank of 10 cm on a fixed post, a rod of 25 cm, and a slider on the post's x axis."""
    end = math.sqrt(0.25**2 - 0.1**2)
    bodies = (
        body("post", 0, -0.03, Cylinder(diameter=0.02), mass=None).replace(fixed=True),
        body("crank", 0, 0.05, Cuboid(size=(0.02, 0.07)), mass=0.2),
        body("rod", end / 2, 0.05, Cuboid(size=(0.20, 0.016)), math.atan2(-0.1, end), mass=0.3),
        body("slider", end + 0.045, 0, Cuboid(size=(0.04, 0.04)), mass=0.4),
    )
    joints = (
        Joint(kind="revolute", parent="post", child="crank", anchor=(0, 0)),
        Joint(kind="revolute", parent="crank", child="rod", anchor=(0, 0.1)),
        Joint(kind="revolute", parent="rod", child="slider", anchor=(end, 0)),
        Joint(kind="prismatic", parent="post", child="slider", axis=(1, 0), limits=(-0.1, 0.2)),
    )
    push = Push(start=(-0.03, 0.07), end=(0.03, 0.07), speed=0.05)
    return Scene(bodies=bodies, joints=joints, tool=THIN, pushes=(push,))


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1), (1, 3, 0, 2)])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_slider_crank_moves_as_its_geometry_says(order, swapped: bool) -> None:
    track = simulate(reordered(slider_crank(), order, order, swapped))
    angle = math.pi / 2 + of(track, "crank")[:, 2]
    x = 0.1 * np.cos(angle) + np.sqrt(0.25**2 - (0.1 * np.sin(angle)) ** 2)
    slider = of(track, "slider")
    assert angle[-1] < math.radians(70)
    assert np.abs(slider[:, 0] - slider[0, 0] - (x - x[0])).max() < 0.5e-3
    assert np.abs(slider[:, 1]).max() < 0.2e-3
    assert np.abs(slider[:, 2]).max() < math.radians(0.1)
    assert np.ptp(of(track, "post"), axis=0).max() == 0


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_a_loop_of_three_sliders_is_a_wedge(order) -> None:
    """B slides on a carriage that runs along x, and in a slot at 45 degrees: pushed along x, it goes along both."""
    square = Cuboid(size=(0.08, 0.08))
    bodies = (
        body("frame", -0.2, -0.25, square).replace(fixed=True),
        body("a", 0, -0.15, square),
        body("b", 0, 0, square),
    )
    joints = (
        Joint(kind="prismatic", parent="frame", child="a", axis=(1, 0), limits=(-0.1, 0.1)),
        Joint(kind="prismatic", parent="a", child="b", axis=(0, 1), limits=(-0.1, 0.1)),
        Joint(kind="prismatic", parent="frame", child="b", axis=(1, 1), limits=(-0.15, 0.15)),
    )
    push = Push(start=(-0.06, 0.03), end=(0.0, 0.03), speed=0.05)
    track = simulate(reordered(Scene(bodies=bodies, joints=joints, tool=THIN, pushes=(push,)), order))
    for name, right in (("a", (50, 0, 0)), ("b", (50, 50, 0)), ("frame", (0, 0, 0))):
        moved = (of(track, name)[-1] - of(track, name)[0]) * [1e3, 1e3, 180 / math.pi]
        assert moved[:2] == pytest.approx(right[:2], abs=0.5)
        assert moved[2] == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
def test_a_slider_between_two_fixed_walls_slides_without_a_turn(order) -> None:
    wall = Cuboid(size=(0.3, 0.02))
    bodies = (
        body("car", 0, 0, Cuboid(size=(0.1, 0.1)), mass=0.5),
        body("near", 0, -0.06, wall, mass=None).replace(fixed=True),
        body("far", 0, 0.06, wall, mass=None).replace(fixed=True),
    )
    joints = tuple(
        Joint(kind="prismatic", parent=name, child="car", axis=(1, 0), limits=(-0.1, 0.05)) for name in ("near", "far")
    )
    push = Push(start=(-0.07, 0.03), direction=0, distance=0.05)
    track = simulate(reordered(Scene(bodies=bodies, joints=joints, tool=THIN, pushes=(push,)), order))
    moved = (of(track, "car")[-1] - of(track, "car")[0]) * [1e3, 1e3, 180 / math.pi]
    assert moved == pytest.approx((40, 0, 0), abs=0.2)
    assert remarks(track) == []


@pytest.mark.parametrize("play", [0.0, 1e-3])
@pytest.mark.parametrize("turn", [0.0, 0.6])
def test_a_box_in_a_corridor_of_fixed_walls_goes_where_it_is_pushed(play: float, turn: float) -> None:
    wall, half = Cuboid(size=(0.5, 0.02)), (0.1 + play) / 2 + 0.01
    bodies = (
        body("box", -0.15, 0, Cuboid(size=(0.1, 0.1))),
        body("near", 0, -half, wall, mass=None).replace(fixed=True),
        body("far", 0, half, wall, mass=None).replace(fixed=True),
    )
    scene = Scene(bodies=bodies, tool=THIN, pushes=(Push(start=(-0.23, 0.03), direction=0, distance=0.22),))
    track = simulate(scene.moved(np.array([0.1, 0.0, turn])))
    moved = relative(track.poses[0, 1], track.poses[-1, 1])
    assert moved[0] == pytest.approx(0.2, abs=1.5e-3)
    assert abs(moved[1]) < play + 0.5e-3
    assert track.scene.pair_gaps([(0, 1), (0, 2)], track.poses[:, 1:]).min() > -0.5e-3


# Limits ----------------------------------------------------------------------------------------------------------


def door(limits=(-0.15, 0.3), mass: float | None = 5.0, push: Push | None = None) -> Scene:
    """A door that stands half open; without a mass, its cabinet is fixed."""
    hinge, yaw = np.array([-0.18, 0.04]), -0.5
    x, y = hinge + transform(np.array([0, 0, yaw]), np.array([0.18, 0.0]))
    bodies = (
        body("cabinet", 0, 0.16, Cuboid(size=(0.4, 0.2)), mass=mass).replace(fixed=mass is None),
        body("door", x, y, Cuboid(size=(0.36, 0.02)), yaw, mass=0.5),
    )
    joint = Joint(kind="revolute", parent="cabinet", child="door", anchor=tuple(hinge.tolist()), limits=limits)
    push = push or Push(start=(0.13, -0.06), end=(0.05, -0.3), speed=0.1)
    return Scene(bodies=bodies, joints=(joint,), tool=THIN, pushes=(push,), table=LARGE)


def opening(track: Track) -> np.ndarray:
    """How far the door has turned from its start, relative to the cabinet (degrees)."""
    turned = of(track, "door")[:, 2] - of(track, "cabinet")[:, 2]
    return np.degrees(turned - turned[0])


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (0.5, 1.0, 2.0)])
@pytest.mark.parametrize(("limits", "mass"), [((-0.15, 0.3), 5.0), ((-0.15, 0.3), 50.0), ((-0.05, 0.0), 5.0)])
def test_a_hinge_stops_at_its_limit(limits, mass: float, motion, swapped: bool) -> None:
    scene = reordered(door(limits, mass), (1, 0) if swapped else (0, 1), swapped=swapped).moved(np.array(motion))
    track = simulate(scene)
    assert np.degrees(limits[0]) == pytest.approx(opening(track)[-1], abs=0.1)
    assert opening(track).min() >= np.degrees(limits[0]) - 0.1
    assert gape(track) < 1e-6


def test_a_hinge_stops_at_its_other_limit() -> None:
    track = simulate(door((-0.5, 0.1), push=Push(start=(0.05, -0.13), end=(0.1, 0.1), speed=0.1)))
    assert opening(track)[-1] == pytest.approx(np.degrees(0.1), abs=0.1)


@pytest.mark.parametrize("distance", [0.03, 0.06, 0.1])
def test_a_door_on_a_fixed_frame_turns_as_its_geometry_says(distance: float) -> None:
    """The tool's centre keeps the distance radius + half thickness from the door's middle line."""
    push = Push(start=(0.1, -0.08), direction=-math.pi / 2, distance=distance, speed=0.05)
    scene = door((-1.0, 0.5), None, push)
    track = simulate(scene)
    x, y = track.poses[-1, 0, :2] - np.array([-0.18, 0.04])
    angle = math.atan2(y, x) - math.asin((0.01 + 0.01) / math.hypot(x, y))
    assert np.ptp(of(track, "cabinet"), axis=0).max() == 0
    assert np.degrees(of(track, "door")[-1, 2]) == pytest.approx(min(np.degrees(angle), -28.65), abs=0.3)


def drawer(mass: float | None = 5.0, limit: float = 0.08) -> Scene:
    """A drawer with a handle of two bars, pulled by it; without a mass, its cabinet is fixed."""
    bodies = (
        body("cabinet", 0, 0.2, Cuboid(size=(0.3, 0.2)), mass=mass).replace(fixed=mass is None),
        body("drawer", 0, 0.04, Cuboid(size=(0.2, 0.1)), mass=0.8),
        body("lip", 0.13, -0.03, Cuboid(size=(0.08, 0.02)), mass=0.1),
        body("bar", 0.06, -0.03, Cuboid(size=(0.06, 0.02)), mass=0.1),
    )
    joint = Joint(kind="prismatic", parent="cabinet", child="drawer", axis=(0, -1), limits=(0, limit))
    return Scene(
        bodies=bodies,
        joints=(joint,),
        rigid_groups=(("drawer", "lip", "bar"),),
        tool=THIN,
        pushes=(Push(start=(0.13, 0.0), end=(0.13, -0.15), speed=0.1),),
        table=LARGE,
    )


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("turn", [0.0, 2.2])
@pytest.mark.parametrize(("mass", "limit"), [(5.0, 0.08), (50.0, 0.08), (50.0, 0.03)])
def test_a_slider_stops_at_its_limit_without_play(mass: float, limit: float, turn: float, swapped: bool) -> None:
    scene = reordered(drawer(mass, limit), (3, 1, 2, 0) if swapped else (0, 1, 2, 3), swapped=swapped)
    track = simulate(scene.moved(np.array([0.2, 0.1, turn])))
    between = relative(of(track, "cabinet"), of(track, "drawer"))
    slid = (between - between[0]) * [1e3, 1e3, 180 / math.pi]
    assert slid[-1, 1] == pytest.approx(-1e3 * limit, abs=0.2)
    assert slid[:, 1].min() >= -1e3 * limit - 0.2
    assert np.abs(slid[:, 0]).max() <= 0.2
    assert np.abs(slid[:, 2]).max() <= 0.1


@pytest.mark.parametrize("scene", [drawer(), drawer(50.0), door(), four_bar(), slider_crank()])
def test_mirror_images_of_mechanisms_have_mirrored_answers(scene: Scene) -> None:
    here, there = simulate(scene).poses, simulate(mirrored(scene)).poses
    assert np.abs(here * [1, -1, -1] - there)[..., :2].max() <= 0.01e-3


# What is fixed ---------------------------------------------------------------------------------------------------


def at_the_wall(force_limit: float | None, how: str = "fixed", turn: float = 0.0, speed: float = 0.1) -> Scene:
    """A crate is pushed against a wall that is fixed itself, or of one piece with something fixed."""
    wall = body("wall", 0.16, 0, Cuboid(size=(0.02, 0.6)), mass=None if how == "fixed" else 1.0)
    bodies = [body("crate", 0, 0, Cuboid(size=(0.1, 0.1))), wall.replace(fixed=how == "fixed")]
    if how != "fixed":
        bodies.append(body("rock", 0.4, 0, mass=None).replace(fixed=True))
    push = Push(start=(-0.1, 0), end=(0.15, 0), speed=speed, force_limit=force_limit)
    scene = Scene(
        bodies=tuple(bodies),
        joints=(Joint(kind="fixed", parent="wall", child="rock"),) if how == "joint" else (),
        rigid_groups=(("rock", "wall"),) if how == "group" else (),
        tool=Tool.round(0.03),
        pushes=(push,),
        table=LARGE,
    )
    return scene.moved(np.array([0.0, 0.0, turn]))


@pytest.mark.parametrize(
    ("limit", "how", "turn"),
    [(10.0, "fixed", 0.0), (3.0, "fixed", 0.0), (100.0, "fixed", 0.0), (10.0, "group", 0.5), (10.0, "joint", 2.0)],
)
def test_a_crate_and_a_robot_with_a_force_limit_stop_at_a_wall(limit: float, how: str, turn: float) -> None:
    track = simulate(at_the_wall(limit, how, turn))
    robot, crate = (relative(np.array([0, 0, turn]), of_node) for of_node in (track.poses[-1, 0], track.poses[-1, 1]))
    assert crate == pytest.approx((0.1, 0, 0), abs=1e-3)
    assert robot == pytest.approx((0.035, 0, 0), abs=1e-3)
    assert np.ptp(track.poses[:, 2:], axis=0).max() == 0
    assert np.hypot(*track.wrench[:, :2].T).max() <= 1.05 * limit
    (said,) = remarks(track)
    assert "it stalls at its force_limit" in said


def test_without_a_force_limit_the_crate_is_said_to_be_crushed() -> None:
    track = simulate(at_the_wall(None))
    assert track.poses[-1, 0, 0] == pytest.approx(0.15)
    assert "'crate' is crushed between the tool and 'wall'" in remarks(track)[0]


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_a_pusher_weaker_than_friction_stalls_at_the_first_touch(limit: float) -> None:
    track = simulate(at_the_wall(limit, speed=0.2))
    assert np.abs(moved_by(track)[0]).max() < 3.0
    assert track.poses[-1, 0, 0] == pytest.approx(-0.065, abs=3e-3)
    assert np.hypot(*track.wrench[-20:, :2].T).max() <= 1.05 * limit
    assert "stalls" in remarks(track)[0]


def test_a_robot_that_stalls_at_a_fixed_body_does_not_move_it() -> None:
    post = body("post", 0, 0, mass=None).replace(fixed=True)
    scene = Scene(bodies=(post,), tool=THIN, pushes=(Push(start=(-0.2, 0.02), end=(0.2, 0.02), force_limit=5),))
    track = simulate(scene)
    assert np.ptp(track.poses[:, 1:], axis=0).max() == 0
    assert track.scene.tool_gaps(track.poses[:, 0], track.poses[:, 1:]).min() > -1e-3


def test_what_is_jointed_to_something_fixed_turns_about_it() -> None:
    post = body("post", 0, 0, Cylinder(diameter=0.02), mass=None).replace(fixed=True)
    bodies = (post, body("arm", 0.12, 0, Cuboid(size=(0.2, 0.02))))
    joint = Joint(kind="revolute", parent="arm", child="post", anchor=(0, 0))
    track = simulate(
        Scene(bodies=bodies, joints=(joint,), tool=THIN, pushes=(Push(start=(0.15, -0.05), end=(0.15, 0.05)),))
    )
    assert np.ptp(of(track, "post"), axis=0).max() == 0
    assert np.hypot(*of(track, "arm")[:, :2].T) == pytest.approx(0.12, abs=1e-6)
    angle = math.atan2(0.05, 0.15) + math.asin(0.02 / math.hypot(0.05, 0.15))
    assert of(track, "arm")[-1, 2] == pytest.approx(angle, abs=math.radians(0.3))


def test_a_joint_between_two_bodies_that_cannot_move_is_of_no_matter() -> None:
    bodies = (
        body("a", 0, 0, mass=None).replace(fixed=True),
        body("b", 0.2, 0, mass=None),
        body("c", 0.4, 0, mass=None).replace(fixed=True),
    )
    joints = (Joint(kind="fixed", parent="a", child="b"), Joint(kind="revolute", parent="b", child="c"))
    push = Push(start=(0, -0.2), end=(0, -0.1))
    track = simulate(Scene(bodies=bodies, joints=joints, tool=THIN, pushes=(push,)))
    assert np.ptp(track.poses[:, 1:], axis=0).max() == 0
