"""Scenes: what is valid, what the errors say, JSON in and out."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scenes import body, workshop

from pushgraph import pose
from pushgraph.body import Body, Joint
from pushgraph.errors import SceneError
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.tool import Part, Push, Tool


def test_json_reads_back_bit_for_bit() -> None:
    scene = workshop()
    assert Scene.from_json(scene.to_json()) == scene
    assert Scene.from_json(scene.to_json(indent=None)) == scene
    third = scene.moved((0.1, 0.2, 1 / 3))
    assert Scene.from_json(third.to_json()) == third


def test_unknown_values_survive_json() -> None:
    scene = workshop().replace(table=Table(friction=None), side_friction=None, unknown_pairs=(("lid", "cup"),))
    scene = scene.replace(bodies=tuple(b.replace(mass=None, yaw_known=False) for b in scene.bodies))
    assert Scene.from_json(scene.to_json()) == scene


def test_the_published_schema_is_the_code_s() -> None:
    published = json.loads((Path(__file__).parents[1] / "docs" / "scene.schema.json").read_text())
    assert published == Scene.model_json_schema(), "docs/scene.schema.json is stale: run make schema"


def test_scenes_are_immutable() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        workshop().bodies[0].mass = 3.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Cylinder(diameter=-0.1), r"diameter: Input should be greater than or equal to 0.001, got -0.1"),
        (lambda: Cuboid(size=(0.1, math.nan)), r"size\[1\]: Input should be a finite number, got nan"),
        (lambda: body("a", math.inf, 0), r"body.* 'a'|pose_world_from_body\[0\]: Input should be"),
        (lambda: body("a", 0, 0, mass=0.0), r"mass: Input should be greater than or equal to 0.001, got 0.0"),
        (lambda: body("robot", 0, 0), r"name: 'robot' is the end-effector's name"),
        (lambda: body("cup ", 0, 0), r"name: String should match pattern"),
        (lambda: body("", 0, 0), r"name: String should match pattern"),
        (
            lambda: Joint(kind="ball", parent="a", child="b"),
            r"kind: Input should be 'fixed', 'revolute' or 'prismatic'",
        ),
        (lambda: Joint(kind="fixed", parent="a", child="a"), r"joins 'a' to itself"),
        (lambda: Joint(kind="fixed", parent="a", child="b", axis=(1, 0)), r"axis: only a prismatic joint"),
        (lambda: Joint(kind="prismatic", parent="a", child="b", axis=(0, 0)), r"axis: must be a direction"),
        (lambda: Joint(kind="fixed", parent="a", child="b", limits=(0, 1)), r"limits: a fixed joint has none"),
        (lambda: Joint(kind="revolute", parent="a", child="b", limits=(1, 2)), r"limits: must be \[lowest <= 0"),
        (lambda: Joint(kind="revolute", parent="a", child="b", limits=(0, 0)), r"with lowest < highest"),
        (lambda: Push(start=(0, 0)), r"needs either end, or direction and distance"),
        (lambda: Push(start=(0, 0), end=(1, 0), direction=0.0), r"needs either end, or direction and distance"),
        (lambda: Push(start=(0, 0), direction=0.0), r"needs either end, or direction and distance"),
        (lambda: Push(start=(0, 0), end=(1, 0), path=[(0, 1)]), r"either end, or direction and distance, or path"),
        (lambda: Push(start=(0, 0), path=[]), r"path: Tuple should have at least 1 item"),
        (lambda: Push(start=(0, 0), path=[(0, 1), (1,)]), r"path\[1\]: Tuple should have at least 2 items"),
        (lambda: Push(start=(0, 0), path=[(0, 1, 0, 0)]), r"path\[0\]: Tuple should have at most 3 items"),
        (lambda: Push(start=(0, 0), path=[(0, math.nan)]), r"path\[0\]\[1\]: Input should be a finite number"),
        (lambda: Push(start=(0, 0), path=[(0, 1)] * 10_001), r"path: Tuple should have at most 10000 items"),
        (lambda: Push(start=(0, 0), path=[(0, 1, 1)], rotation=1), r"rotation: belongs to straight pushes"),
        (lambda: Push(start=(0, 0), end=(0, 1), times=[1]), r"times: belong to the way-points of a path"),
        (lambda: Push(start=(0, 0), path=[(0, 1)], times=[1, 2]), r"one for each of the 1 way-points .*, got 2"),
        (lambda: Push(start=(0, 0), path=[(0, 1), (0, 2)], times=[1, 1]), r"times\[1\]: must rise, got 1 s after 1 s"),
        (lambda: Push(start=(0, 0), path=[(0, 1)], times=[0]), r"times\[0\]: Input should be greater than 0"),
        (lambda: Push(start=(0, 0), end=(0, 1), rest=61), r"rest: Input should be less than or equal to 60"),
        (lambda: Push(start=(0, 0), end=(0, 1), force_limit=0), r"force_limit: Input should be greater than or equal"),
        (lambda: Push(start=(0, 0), end=(1, 0), speed=0), r"speed: Input should be greater than or equal to 0.001"),
        (lambda: Tool(parts=()), r"parts: Tuple should have at least 1 item"),
        (lambda: Scene(bodies=()), r"bodies: Tuple should have at least 1 item"),
        (lambda: Scene(bodies=(body("a", 0, 0),), gravity=1), r"gravity: unknown field"),
        (lambda: Scene(bodies=(body("a", 0, 0), body("a", 1, 0))), r"the name 'a' is used 2 times"),
        (
            lambda: Scene(bodies=(body("a", 1.2, 0),)),
            r"body 'a': pose_world_from_body: the centre stands off the table",
        ),
        (
            lambda: Scene(bodies=(body("a", 0, 0), body("b", 0.1, 0))),
            r"bodies 'a' and 'b': pose_world_from_body: they overlap by 20.0 mm; at most 1 mm",
        ),
        (
            lambda: workshop().replace(joints=(Joint(kind="fixed", parent="plate", child="nut"),)),
            r"joints\[0\].child: no body 'nut'; valid: plate, lid, cup, handle",
        ),
        (
            lambda: workshop().replace(
                joints=(
                    Joint(kind="fixed", parent="plate", child="lid"),
                    Joint(kind="revolute", parent="lid", child="plate"),
                )
            ),
            r"joints\[1\]: 'lid' and 'plate' are joined already",
        ),
        (
            lambda: workshop().replace(joints=(Joint(kind="fixed", parent="cup", child="handle"),)),
            r"joints\[0\]: a rigid group holds both",
        ),
        (
            lambda: workshop().replace(pushes=(Push(start=(-0.5, 0), end=(0.5, 0), speed=0.001),)),
            r"pushes\[0\]: takes 1000 s at this speed; at most 600 s",
        ),
        (
            lambda: workshop().replace(pushes=(Push(start=(-0.4, 0), path=[(-0.4, 0), (-0.4, 0.5)], times=[1, 1.2]),)),
            r"pushes\[0\].path\[1\]: reached at 2.5 m/s by its times .*; at most 2 m/s",
        ),
        (
            lambda: workshop().replace(pushes=(Push(start=(-0.4, 0), path=[(-0.4, 0, 6.2)], times=[0.1]),)),
            r"pushes\[0\].path\[0\]: reached at 3.1 m/s by its times \(rotation counts at the tool's reach",
        ),
        (lambda: workshop().replace(unknown_pairs=(("cup", "nut"),)), r"unknown_pairs\[0\]: no body 'nut'"),
        (lambda: workshop().replace(unknown_pairs=(("plate", "lid"),)), r"unknown_pairs\[0\]: .*known to be joined"),
        (lambda: workshop().replace(rigid_groups=(("cup", "nut"),)), r"rigid_groups\[0\]: no body 'nut'"),
        (lambda: workshop().replace(rigid_groups=(("cup", "handle"), ("cup", "lid"))), r"'cup' stands twice"),
        (
            lambda: workshop().replace(pushes=(Push(start=(0, 0), end=(0.1, 0)),)),
            r"pushes\[0\].start: the tool would come down on body 'plate'",
        ),
    ],
)
def test_what_does_not_fit_is_named(build, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        build()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"mass": 0.3',
            '"mass": -0.3',
            r"scene.json: bodies\[1\] 'lid': mass: Input should be greater than or equal to 0.001, got -0.3",
        ),
        ('"mass": 0.3', '"mass": NaN', r"bodies\[1\] 'lid': mass: Input should be a finite number"),
        ('"mass": 0.3', '"mass": "0.3"', r"bodies\[1\] 'lid': mass: Input should be a valid number, got '0.3'"),
        ('"mass": 0.3', '"mass": true', r"bodies\[1\] 'lid': mass: Input should be a valid number"),
        ('"diameter": 0.12', '"diameter": 1e999', r"bodies\[2\] 'cup': shape.diameter: Input should be"),
        ('"kind": "cylinder"', '"kind": "ball"', r"bodies\[2\] 'cup': shape: Input tag 'ball'.*'cylinder', 'cuboid'"),
        ('"size"', '"sizes"', r"bodies\[0\] 'plate': shape.size: Field required"),
        ('"version": 1', '"version": 2', r"version 2 of the scene format, newer than this pushgraph reads \(1\)"),
        ('"version": 1', '"version": "1"', r'"version" must be 1'),
        ("pushgraph.scene", "pushgraph.track", r'"format" must be "pushgraph.scene"'),
        ('"bodies"', '"bodies', r"scene.json: not valid JSON.*line"),
        ('"mass": 0.3', '"mass": -5, "mass": 0.3', r"scene.json: .*'mass' stands twice in one object"),
    ],
)
def test_a_file_with_a_fault_is_refused_by_body_and_field(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = workshop().to_json()
    assert old in text
    path = tmp_path / "scene.json"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SceneError, match=message):
        Scene.load(path)


@pytest.mark.parametrize("text", ["", "[]", "3", "null", '"scene"', "{}", "[" * 100_000, "\x00", '{"format": 1}'])
def test_what_is_no_scene_is_refused(text: str) -> None:
    with pytest.raises(SceneError):
        Scene.from_json(text)


def test_overlap_inside_a_rigid_group_and_a_millimetre_elsewhere_are_legal() -> None:
    workshop()
    Scene(bodies=(body("a", 0, 0), body("b", 0.1192, 0)))


def test_joint_frame_follows_from_the_geometry() -> None:
    scene = Scene(
        bodies=(body("a", 0, 0), body("b", 0.14, 0)), joints=(Joint(kind="prismatic", parent="a", child="b"),)
    )
    anchor, axis, limits = scene.joint_frame(scene.joints[0])
    np.testing.assert_allclose(anchor, [0.07, 0])
    np.testing.assert_allclose(axis, [1, 0])
    np.testing.assert_allclose(limits, [-0.02, 0.08])
    hinge = Joint(kind="revolute", parent="b", child="a", anchor=(0.1, 0.2), limits=(-0.1, 0.2))
    anchor, _, limits = scene.joint_frame(hinge)
    np.testing.assert_allclose(anchor, [0.1, 0.2])
    assert limits == (-0.1, 0.2)
    assert scene.joint_frame(hinge.replace(limits=None)).limits == (-math.pi / 2, math.pi / 2)


def test_moving_a_scene_moves_everything_in_it() -> None:
    winding = Push(start=(-0.3, 0.1), path=[(-0.3, 0.2), (-0.2, 0.3, 0.5), (0.1, 0.3)], yaw=0.2)
    scene, motion = workshop().replace(pushes=(*workshop().pushes, winding)), np.array([3.0, -2.0, 0.7])
    moved = scene.moved(motion)
    np.testing.assert_allclose(moved.poses_world_from_body, pose.compose(motion, scene.poses_world_from_body))
    before, after = scene.joint_frame(scene.joints[0]), moved.joint_frame(moved.joints[0])
    np.testing.assert_allclose(after.anchor, pose.transform(motion, before.anchor))
    np.testing.assert_allclose(after.axis, pose.rotate(before.axis, 0.7))
    for old, new in zip(scene.pushes, moved.pushes, strict=True):
        np.testing.assert_allclose(new.displacement, pose.rotate(np.array(old.displacement), 0.7))
        np.testing.assert_allclose(new.waypoints, pose.compose(motion, old.waypoints))
    assert moved.table.holds(np.array([[3.0, -2.0]])).all()


def test_tool_reach_is_that_of_its_farthest_corner() -> None:
    tool = Tool(parts=(Part(shape=Cuboid(size=(0.06, 0.08)), pose_tool_from_part=(-0.3, 0.0, 0.2)),))
    assert tool.reach == pytest.approx(0.35)
    assert Tool.round(0.1).reach == pytest.approx(0.05)


def test_a_body_needs_no_mass() -> None:
    assert Body(name="a", shape=Cylinder(diameter=0.1), pose_world_from_body=(0, 0, 0)).mass is None


def test_way_points_without_yaw_keep_the_yaw_before_them() -> None:
    push = Push(start=(0, 0), yaw=0.1, path=[(0, 1), (1, 1, 0.5), (1, 0)])
    np.testing.assert_array_equal(push.waypoints, [(0, 0, 0.1), (0, 1, 0.1), (1, 1, 0.5), (1, 0, 0.5)])
    tool = Tool.round(0.2)
    np.testing.assert_allclose(push.lengths(tool), [1, 1.04, 1])
    assert push.path_length(tool) == pytest.approx(3.04)
    assert push.displacement == (1, 0)


def test_a_straight_push_is_a_path_of_one_way_point() -> None:
    push = Push(start=(0.1, 0.2), direction=math.pi / 2, distance=0.3, yaw=0.1, rotation=-1.0)
    np.testing.assert_allclose(push.waypoints, [(0.1, 0.2, 0.1), (0.1, 0.5, -0.9)])
    assert push.path_length(Tool.round(0.2)) == pytest.approx(0.4)


def test_a_fault_in_a_list_is_not_also_called_a_list_too_short() -> None:
    with pytest.raises(SceneError) as error:
        Push(start=(0, 0), path=[(0, "a")])
    assert str(error.value).count("\n") == 0


def hinged(yaw: float, size=(0.1, 0.1), gap: float = 0.0, offset: float = 0.0) -> Scene:
    """A box on the right of another, turned about the middle of its left face, hinged somewhere in between."""
    centre = np.array([0.05 + gap, offset]) + pose.rotate(np.array([size[0] / 2, 0.0]), np.float64(yaw))
    bodies = (
        body("a", 0, 0, Cuboid(size=(0.1, 0.1))).replace(fixed=True),
        body("b", *centre.tolist(), Cuboid(size=size), yaw=yaw).replace(fixed=True),
    )
    return Scene(bodies=bodies)


def anchor(scene: Scene, parent: str = "a", child: str = "b") -> np.ndarray:
    return scene.joint_frame(Joint(kind="revolute", parent=parent, child=child)).anchor


def test_a_hinge_between_flush_faces_sits_in_the_middle_of_where_they_face() -> None:
    np.testing.assert_allclose(anchor(hinged(0.0)), [0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(anchor(hinged(0.0, gap=0.01)), [0.055, 0.0], atol=1e-12)
    np.testing.assert_allclose(anchor(hinged(0.0, offset=0.04)), [0.05, 0.02], atol=1e-12)
    np.testing.assert_allclose(anchor(hinged(0.0, size=(0.1, 0.04), offset=0.01)), [0.05, 0.01], atol=1e-12)


def test_the_anchor_of_a_hinge_moves_little_as_a_box_turns_by_little() -> None:
    yaws = np.arange(-0.4, 0.4, 0.001)
    anchors = np.array([anchor(hinged(float(yaw), gap=0.03)) for yaw in yaws])
    steps = np.hypot(*np.diff(anchors, axis=0).T)
    assert steps.max() < 1e-3
    assert np.abs(np.diff(steps)).max() < 1e-4  # and evenly
    np.testing.assert_allclose(anchors[-1], anchor(hinged(0.399, gap=0.03)))
    assert abs(anchors[0, 1]) > 0.04  # the corner, once the faces have turned away from each other


@pytest.mark.parametrize("yaw", [0.0, 1e-3, -0.02, 0.05, 0.3])
def test_the_anchor_of_a_hinge_is_that_of_the_pair_wherever_the_scene_lies(yaw: float) -> None:
    scene, motion = hinged(yaw, gap=0.01, offset=0.013), np.array([0.4, -0.3, 2.1])
    np.testing.assert_allclose(anchor(scene, "b", "a"), anchor(scene), atol=1e-9)
    np.testing.assert_allclose(anchor(scene.moved(motion)), pose.transform(motion, anchor(scene)), atol=1e-9)


def wall(name: str, x: float, y: float, **fields) -> Body:
    return body(name, x, y, Cuboid(size=(0.1, 0.6)), mass=None).replace(fixed=True, **fields)


def test_fixed_bodies_may_overlap_each_other_and_stand_off_the_table() -> None:
    scene = Scene(bodies=(wall("left", 1.0, 0), wall("corner", 1.02, 0.3), body("a", 0, 0)))
    np.testing.assert_array_equal(scene.immovable, [True, True, False])
    assert Scene.from_json(scene.to_json()) == scene
    with pytest.raises(SceneError, match=r"bodies 'left' and 'a': .* overlap by"):
        scene.replace(bodies=(*scene.bodies[:2], body("a", 0.9, 0)))


def test_a_rigid_group_with_a_fixed_body_is_fixed() -> None:
    bodies = (wall("left", 0, 0), body("peg", 1.5, 0), body("a", 0.5, 0))
    scene = Scene(bodies=bodies, rigid_groups=(("left", "peg"),))
    np.testing.assert_array_equal(scene.immovable, [True, True, False])
    with pytest.raises(SceneError, match=r"joints\[1\]: neither 'peg' nor 'door' can move, being fixed or of one"):
        Scene(
            bodies=(*bodies, wall("door", 0, 0.7)),
            rigid_groups=(("left", "peg"),),
            joints=(
                Joint(kind="revolute", parent="peg", child="a"),
                Joint(kind="revolute", parent="peg", child="door"),
            ),
        )


def test_joints_may_close_a_loop() -> None:
    ends = (("plate", "lid"), ("lid", "cup"), ("cup", "plate"))
    joints = tuple(Joint(kind="revolute", parent=a, child=b) for a, b in ends)
    assert len(workshop().replace(joints=joints).joints) == 3
