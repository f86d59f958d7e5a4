"""Polygons through the house: contact, joints, files, prediction, pictures."""

from pathlib import Path

import numpy as np
import pytest
from scenes import body

from pushgraph import pose
from pushgraph.body import Body, Joint
from pushgraph.errors import BeliefError, SceneError
from pushgraph.physics import PhysicsPredictor
from pushgraph.regulator import BeliefRegulator
from pushgraph.scene import Scene
from pushgraph.scene_parts import in_parts
from pushgraph.shape import Cuboid, Polygon
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.viewer.picture import save_picture

L = Polygon(points=((0, 0), (0.1, 0), (0.1, 0.03), (0.03, 0.03), (0.03, 0.12), (0, 0.12)))
DRAWN = Polygon(points=((0.03, 0), (0.17, 0), (0.17, 0.1), (0.03, 0.1)))  # a cuboid, its origin beside it
SAME = Cuboid(size=(0.14, 0.1))


def drawn(name: str, x: float, y: float, yaw: float):
    """As `SAME` at this place, but drawn as an outline."""
    place = pose.compose(np.array([x, y, yaw]), np.array([-0.1, -0.05, 0.0]))
    return body(name, *place[:2].tolist(), shape=DRAWN, yaw=yaw)


def test_contact_of_a_drawn_cuboid_is_that_of_the_cuboid() -> None:
    others = (body("cup", 0.2, 0.03), body("lid", 0.0, 0.12, Cuboid(size=(0.1, 0.04)), 0.2))
    as_cuboid = Scene(bodies=(body("box", 0, 0, SAME, 0.3), *others))
    as_polygon = Scene(bodies=(drawn("box", 0, 0, 0.3), *others))
    pairs = [(0, 1), (0, 2), (1, 2)]
    one, other = as_cuboid.contacts(pairs), as_polygon.contacts(pairs)
    assert other.gap == pytest.approx(one.gap, abs=1e-9)
    assert other.normal == pytest.approx(one.normal, abs=1e-9)
    world = [
        pose.transform(scene.poses_world_from_body[0], touch.points_a[0])
        for scene, touch in ((as_cuboid, one), (as_polygon, other))
    ]
    assert world[1] == pytest.approx(world[0], abs=1e-9)
    at = np.array([[0.2, -0.2, 0.0], [-0.2, 0.0, 0.0]])
    gaps = [scene.tool_gaps(at, scene.poses_world_from_body) for scene in (as_cuboid, as_polygon)]
    assert gaps[1] == pytest.approx(gaps[0], abs=1e-9)


def test_overlap_is_judged_by_the_outline() -> None:
    Scene(bodies=(body("hook", 0, 0, L), body("cup", 0.092, 0.092)))  # within the hook's arms
    with pytest.raises(SceneError, match="'hook' and 'cup'.*overlap"):
        Scene(bodies=(body("hook", 0, 0, L), body("cup", 0.06, 0.07)))


def test_a_polygon_scene_is_read_back_bit_for_bit() -> None:
    scene = Scene(bodies=(body("hook", 0, 0, L).replace(support=((0, 0), (0.1, 0), (0, 0.1))), body("cup", 0.2, 0.2)))
    assert Scene.from_json(scene.to_json()) == scene


def test_bad_points_in_a_file_are_named() -> None:
    text = Scene(bodies=(body("hook", 0, 0, L),)).to_json().replace("0.12", "-0.12")
    with pytest.raises(SceneError, match=r"bodies\[0\] 'hook': shape.points: the outline crosses"):
        Scene.from_json(text)


def test_a_polygon_is_predicted_as_the_group_of_its_parts() -> None:
    push = (Push(start=(-0.2, 0.02), end=(0.0, 0.02)),)
    cup = body("cup", 0.16, 0.03)
    as_cuboid = Scene(bodies=(body("box", 0, 0, SAME, 0.3), cup), pushes=push)
    as_polygon = Scene(bodies=(drawn("box", 0, 0, 0.3), cup), pushes=push)
    one, other = PhysicsPredictor.load().predict_many([as_cuboid, as_polygon])
    assert other.scene == as_polygon
    moved = pose.compose(one.poses[:, 1], np.array([-0.1, -0.05, 0.0]))
    assert other.poses[:, 1] == pytest.approx(moved, abs=1e-4)
    assert other.poses[:, 2] == pytest.approx(one.poses[:, 2], abs=1e-4)


def test_a_hook_moves_as_one_piece_with_its_joint() -> None:
    scene = Scene(
        bodies=(body("hook", 0, 0, L, mass=1.0), body("cup", 0.17, 0.01), body("lid", 0.3, 0.3, SAME, mass=None)),
        joints=(Joint(kind="revolute", parent="cup", child="hook", anchor=(0.105, 0.01)),),
        pushes=(Push(start=(-0.1, 0.08), end=(0.0, 0.08)),),
    )
    apart = in_parts(scene)
    assert len(apart.scene.bodies) == 4
    assert apart.scene.rigid_groups == (("0", "1"),)
    masses = [one.mass for one in apart.scene.bodies]
    assert sum(masses[:2]) == pytest.approx(1.0)
    assert masses[3] is None
    (joint,) = apart.scene.joints
    assert joint.anchor == (0.105, 0.01)
    assert joint.parent == "2"
    assert apart.body_poses(apart.scene.poses_world_from_body) == pytest.approx(scene.poses_world_from_body)
    (track,) = PhysicsPredictor.load().predict_many([scene])
    assert track.poses.shape[1] == 4
    assert np.isfinite(track.poses).all()
    assert np.abs(track.poses[0, 1:] - scene.poses_world_from_body).max() < 1e-9
    assert np.hypot(*(track.poses[-1, 1] - track.poses[0, 1])[:2]) > 0.005


def test_scenes_without_polygons_are_left_as_they_are() -> None:
    scene = Scene(bodies=(body("cup", 0, 0),))
    assert in_parts(scene).scene is scene


def test_joints_are_not_learnt_of_polygons() -> None:
    with pytest.raises(BeliefError, match="body 'hook': a polygon; joints are learnt of cylinders and cuboids only"):
        BeliefRegulator(Scene(bodies=(body("hook", 0, 0, L), body("cup", 0.2, 0.2))))


def test_a_polygon_is_drawn(tmp_path: Path) -> None:
    scene = Scene(bodies=(body("hook", 0, 0, L),), pushes=(Push(start=(-0.1, 0.0), end=(-0.09, 0.0)),))
    track = PhysicsPredictor.load().predict(scene)
    save_picture(track, tmp_path / "hook.png")
    assert (tmp_path / "hook.png").stat().st_size > 1000


@pytest.mark.parametrize("reach", [0.005, 0.05])
def test_an_outline_presses_where_its_support_says(reach: float) -> None:
    corner = Polygon(
        points=((-0.06, -0.06), (0.06, -0.06), (0.06, -0.02), (-0.02, -0.02), (-0.02, 0.06), (-0.06, 0.06))
    )
    points = tuple(
        (corner.centroid[0] + x * reach, corner.centroid[1] + y * reach)
        for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1))
    )
    body = Body(name="corner", shape=corner, pose_world_from_body=(0.0, 0.0, 0.3), mass=0.8, support=points)
    push = Push(start=(0.03, -0.15), end=(0.03, 0.05), speed=0.03)
    scene = Scene(bodies=(body,), tool=Tool.round(0.01), pushes=(push,)).with_nominal_values()
    predicted, true = PhysicsPredictor.load().predict(scene).poses[-1, 1], simulate(scene).poses[-1, 1]
    np.testing.assert_allclose(predicted[:2], true[:2], atol=0.0035)
    assert abs(predicted[2] - true[2]) < 0.02
