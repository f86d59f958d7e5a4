"""The image-based predictor: what it draws, against exact distances, and laws that hold for any weights."""

import math

import numpy as np
import pytest
import torch
from scenes import body
from shapely import Point, affinity, box

from pushgraph.body import Joint
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.state import controls, start
from pushgraph.graph.surroundings import BLUR, CHANNELS, NARROW, PIXELS, WIDE, Surroundings, surroundings
from pushgraph.network.image_dynamics import ImageDynamics
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene
from pushgraph.shape import Cuboid
from pushgraph.tool import Push

STEP = 0.006


def three_bodies() -> Scene:
    """A box that is hinged to another and pushed towards a cup, so that all of them are told apart."""
    return Scene(
        bodies=(
            body("box", 0.0, 0.0, Cuboid(size=(0.08, 0.06)), yaw=0.4),
            body("lid", -0.07, 0.06, Cuboid(size=(0.06, 0.06)), yaw=0.1),
            body("cup", 0.11, 0.02),
        ),
        joints=(Joint(kind="revolute", parent="box", child="lid", anchor=(-0.04, 0.035)),),
        pushes=(Push(start=(-0.02, -0.11), end=(0.05, 0.1), speed=0.1),),
    )


def seen_by_all(scene: Scene, tool: tuple[float, float] = (-0.02, -0.09)) -> Surroundings:
    scenes = batch_scenes([scene])
    poses = torch.tensor([[b.pose_world_from_body for b in scene.bodies]], dtype=torch.float64)
    way = torch.tensor([[[*tool, 0.0], [tool[0], tool[1] + STEP, 0.0]]], dtype=torch.float64)
    return surroundings(start(scenes, poses), controls(way, torch.ones(1, 2, dtype=torch.bool))[0])


@pytest.fixture(scope="module")
def image() -> PhysicsPredictor:
    torch.manual_seed(0)
    return PhysicsPredictor(ImageDynamics(hidden=16, steps=3).eval().requires_grad_(False))


def pixel_centres(half: float) -> np.ndarray:
    line = (np.arange(PIXELS) + 0.5) * 2 * half / PIXELS - half
    return np.stack(np.meshgrid(line, line), -1)


def signed_distance(shape, points: np.ndarray) -> np.ndarray:
    flat = [Point(p) for p in points.reshape(-1, 2)]
    outside = [shape.distance(p) or -shape.exterior.distance(p) for p in flat]
    return np.array(outside).reshape(points.shape[:-1])


@pytest.mark.parametrize(("size", "half"), [("narrow", NARROW), ("wide", WIDE)])
def test_images_hold_exact_distances_in_the_body_s_own_frame(size, half) -> None:
    seen = seen_by_all(three_bodies())
    yaw = 0.4
    grid = pixel_centres(half)

    def from_world(shape):
        return affinity.rotate(shape, -yaw, origin=(0, 0), use_radians=True)

    lid = affinity.translate(affinity.rotate(box(-0.03, -0.03, 0.03, 0.03), 0.1, use_radians=True), -0.07, 0.06)
    cup = Point(0.11, 0.02).buffer(0.06, quad_segs=256)
    finger = Point(-0.02, -0.09).buffer(three_bodies().tool.reach, quad_segs=256)
    expected = {
        "own": box(-0.04, -0.03, 0.04, 0.03),
        "revolute": from_world(lid),
        "none": from_world(cup),
        "tool": from_world(finger),
    }
    for name, shape in expected.items():
        drawn = seen.images[0, CHANNELS.index(f"{size}_{name}")].numpy()
        shade = 1 - np.clip(signed_distance(shape, grid) / (BLUR * half), -1, 1)
        np.testing.assert_allclose(drawn, shade, atol=2e-4, err_msg=name)
    assert not seen.images[0, CHANNELS.index(f"{size}_fixed")].any()


def test_the_control_is_drawn_where_the_tool_is_in_the_body_s_frame() -> None:
    seen = seen_by_all(three_bodies())
    x, y = (seen.images[0, CHANNELS.index(f"narrow_control_{axis}")] for axis in "xy")
    inside = seen.images[0, CHANNELS.index("narrow_tool")] == 2.0
    assert bool(inside.any())
    torch.testing.assert_close(x[inside], torch.full_like(x[inside], math.sin(0.4)))
    torch.testing.assert_close(y[inside], torch.full_like(y[inside], math.cos(0.4)))
    torch.testing.assert_close(seen.length, torch.full((3,), STEP))


def test_nothing_is_drawn_and_nothing_moves_where_the_tool_rests(image) -> None:
    scene = three_bodies()
    scenes = batch_scenes([scene])
    poses = torch.tensor([[b.pose_world_from_body for b in scene.bodies]], dtype=torch.float64)
    way = torch.tensor([[[0.0, -0.1, 0.0], [0.0, -0.05, 0.0]]], dtype=torch.float64)
    control = controls(way, torch.zeros(1, 2, dtype=torch.bool))[0]
    assert len(surroundings(start(scenes, poses), control).slot) == 0
    assert not image.dynamics(start(scenes, poses), control).motion.any()


def test_predictions_move_with_the_scene(image) -> None:
    scene = three_bodies()
    moved = scene.moved((0.7, -0.4, 2.1))
    here, there = image.predict(scene).poses, image.predict(moved).poses
    cos, sin = math.cos(2.1), math.sin(2.1)
    turn = np.array([[cos, -sin], [sin, cos]])
    np.testing.assert_allclose(here[..., :2] @ turn.T + [0.7, -0.4], there[..., :2], atol=1e-5)
    np.testing.assert_allclose(here[:, 1:, 2] + 2.1, there[:, 1:, 2], atol=1e-5)
    assert np.abs(here[-1, 1:] - here[0, 1:]).max() > 1e-4


def test_the_order_of_bodies_does_not_matter(image) -> None:
    scene = three_bodies()
    order = [2, 0, 1]
    shuffled = scene.replace(bodies=tuple(scene.bodies[k] for k in order))
    first, second = image.predict(scene).poses[:, 1:], image.predict(shuffled).poses[:, 1:]
    np.testing.assert_allclose(first[:, order], second, atol=1e-6)


def test_rigid_groups_stay_rigid(image) -> None:
    scene = three_bodies()
    glued = scene.replace(joints=(), rigid_groups=(("box", "lid"),))
    poses = image.predict(glued).poses[:, 1:3]
    distance = np.linalg.norm(poses[:, 0, :2] - poses[:, 1, :2], axis=-1)
    np.testing.assert_allclose(distance, distance[0], atol=1e-9)
    np.testing.assert_allclose(poses[:, 1, 2] - poses[:, 0, 2], -0.3, atol=1e-9)
