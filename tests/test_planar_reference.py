"""The planar reference against what can be worked out by hand."""

import math

import numpy as np
import pytest
from exact_shapes import mean_radius, mean_squared_radius
from planar_reference import GRAVITY, pressure, reference_ends
from random_pushes import KINDS, START_GAP, TRAVEL, kind_of, random_pushes
from scenes import body

from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.motion import ToolMotion
from pushgraph.tool import Part, Push, Tool

FAR_AWAY = Push(start=(1.0, 1.0), direction=0.0, distance=0.0, speed=0.5)
"""A tool that stands still for as long as it rests after a push."""


COARSE = 5e-4
"""Step (m) of tests that need no better than a tenth of a millimetre."""


def motion(scene: Scene, **options) -> np.ndarray:
    """Change of the first body's pose (mm, mm, degrees)."""
    (end,) = reference_ends([scene], **{"step": COARSE, **options})
    return (end - scene.poses_world_from_body)[0] * (1e3, 1e3, math.degrees(1))


def flat_push(degrees: float, speed: float) -> Scene:
    """A plate 8 cm wide pushes the end of a box, 15 cm far, at an angle to the face."""
    angle = math.radians(degrees)
    return Scene(
        bodies=(body("box", 0.06, 0.0, Cuboid(size=(0.10, 0.08))),),
        tool=Tool(parts=(Part(shape=Cuboid(size=(0.02, 0.08))),)),
        pushes=(Push(start=(0.0, 0.0), direction=angle, distance=0.15, speed=speed),),
    )


@pytest.mark.parametrize("shape", [Cylinder(diameter=0.12), Cuboid(size=(0.16, 0.08)), Cuboid(size=(0.2, 0.02))])
def test_samples_of_a_shape_keep_its_moments(shape) -> None:
    patch = pressure(Scene(bodies=(body("a", 0.1, 0.2, shape, yaw=0.7),)))
    assert patch.weights.sum() == pytest.approx(0.5)
    assert patch.centre == pytest.approx([0.1, 0.2], abs=1e-9)
    assert patch.squared_gyration == pytest.approx(mean_squared_radius(shape), rel=1e-9)
    distance = np.hypot(*(patch.points - patch.centre).T)
    assert patch.weights @ distance / 0.5 == pytest.approx(mean_radius(shape), rel=2e-3)


def test_overlapping_parts_share_what_both_cover() -> None:
    # Two bars of 6 x 2 cm crossed: the middle square, a third of each, counts half for each.
    cross = Scene(
        bodies=(body("a", 0, 0, Cuboid(size=(0.06, 0.02))), body("b", 0, 0, Cuboid(size=(0.02, 0.06)))),
        rigid_groups=(("a", "b"),),
    )
    patch = pressure(cross, samples=2000)
    middle = (np.abs(patch.points) < 0.01).all(-1)
    # 1.0 kg over the union of five squares.
    assert patch.weights[middle].sum() == pytest.approx(1 / 5, rel=0.03)


@pytest.mark.parametrize("shape", [Cylinder(diameter=0.12), Cuboid(size=(0.16, 0.08))])
def test_a_puck_slides_as_far_as_coulomb_lets_it(shape) -> None:
    scene = Scene(bodies=(body("puck", 0, 0, shape, yaw=0.3),), table=Table(friction=0.45), pushes=(FAR_AWAY,))
    speed, angle = 0.5, 0.4
    twists = np.array([[speed * math.cos(angle), speed * math.sin(angle), 0.0]])
    moved = motion(scene, step=2e-4, twists=twists)
    distance = 1e3 * speed**2 / (2 * 0.45 * GRAVITY)
    assert moved == pytest.approx([distance * math.cos(angle), distance * math.sin(angle), 0.0], rel=0.01, abs=1e-6)


def test_a_disc_spins_down_by_the_torque_of_its_patch() -> None:
    # Torque mu m g 2R/3 on a moment of inertia m R^2 / 2.
    spin, radius = 8.0, 0.06
    scene = Scene(bodies=(body("puck", 0, 0, Cylinder(diameter=2 * radius)),), pushes=(FAR_AWAY,))
    turned = motion(scene, step=2e-4, twists=np.array([[0.0, 0.0, spin]]))
    angle = spin**2 * radius / 2 / (2 * 0.45 * GRAVITY * 2 / 3)
    assert turned == pytest.approx([0.0, 0.0, math.degrees(angle)], rel=0.01, abs=1e-6)


def test_a_flat_face_within_the_friction_cone_sticks_at_every_speed() -> None:
    pushes = [(degrees, speed) for degrees in (5, 10) for speed in (0.02, 0.1, 0.2)]
    scenes = [flat_push(*push) for push in pushes]
    for (degrees, _), scene, end in zip(pushes, scenes, reference_ends(scenes, step=COARSE), strict=True):
        angle = math.radians(degrees)
        moved = (end - scene.poses_world_from_body)[0]
        assert moved == pytest.approx([0.15 * math.cos(angle), 0.15 * math.sin(angle), 0.0], abs=5e-5)


def test_a_flat_face_without_friction_slips() -> None:
    scene = flat_push(10, 0.02).replace(side_friction=0.0)
    assert motion(scene) == pytest.approx([150 * math.cos(math.radians(10)), 0.0, 0.0], abs=0.1)


def test_a_disc_pushed_off_centre_turns_by_uniform_pressure() -> None:
    scene = Scene(
        bodies=(body("disc", 0, 0, Cylinder(diameter=0.10)),),
        tool=Tool.round(0.02),
        pushes=(Push(start=(-0.07, 0.02), end=(0.05, 0.02), speed=0.03),),
    )
    x, y, yaw = motion(scene)
    # Quasi-static limit surface of uniform pressure; an ellipsoid would give (75.7, -34.2) mm and -41.3 degrees.
    assert math.hypot(x - 68.7, y + 37.0) < 1.0
    assert yaw == pytest.approx(-51.3, abs=1.5)


def test_a_bar_moves_the_same_as_one_body_and_as_ten() -> None:
    push = Push(start=(0.09, -0.06), end=(0.09, 0.06), speed=0.05)
    rod = body("rod", 0, 0, Cuboid(size=(0.20, 0.02)), mass=5.0)
    one = Scene(bodies=(rod,), tool=Tool.round(0.06), pushes=(push,))
    cells = tuple(body(f"cell{k}", 0.02 * k - 0.09, 0, Cuboid(size=(0.02, 0.02))) for k in range(10))
    ten = one.replace(bodies=cells, rigid_groups=(tuple(cell.name for cell in cells),))
    (end,), ends = reference_ends([one, ten], step=COARSE)
    assert end * (1e3, 1e3, math.degrees(1)) == pytest.approx([-8.5, 30.0, 39.8], abs=0.2)
    assert ends[:, :2].mean(0) == pytest.approx(end[:2], abs=1e-4)
    assert ends[:, 2] == pytest.approx(end[2], abs=1e-3)


@pytest.mark.parametrize("shape", [Cylinder(diameter=0.12), Cuboid(size=(0.10, 0.08))])
def test_a_push_through_the_centre_turns_nothing(shape) -> None:
    half = shape.core[0] + shape.core[2]
    push = Push(start=(-half - 0.011, 0.0), direction=0.0, distance=0.061, speed=0.02)
    scene = Scene(bodies=(body("a", 0, 0, shape),), tool=Tool.round(0.02), pushes=(push,))
    assert motion(scene) == pytest.approx([60.0, 0.0, 0.0], abs=0.05)


def test_masses_cancel_and_pushes_side_by_side_do_not_mix() -> None:
    scenes = random_pushes(4, seed=3)
    heavy = [scene.replace(bodies=tuple(b.replace(mass=20 * b.mass) for b in scene.bodies)) for scene in scenes]
    together = reference_ends([*scenes, *heavy], step=1e-3)
    for light, twin in zip(together[:4], together[4:], strict=True):
        assert twin == pytest.approx(light, abs=1e-6)


def test_halving_the_step_halves_the_error() -> None:
    scenes = random_pushes(4, seed=5)
    coarse, middle, fine = (np.concatenate(reference_ends(scenes, step=step)) for step in (8e-4, 4e-4, 2e-4))
    first, second = (np.abs(a - b)[:, :2].mean() for a, b in ((coarse, middle), (middle, fine)))
    assert second < 0.7 * first
    assert np.abs(middle - fine)[:, :2].max() < 2e-4


def test_random_pushes_are_what_they_say() -> None:
    scenes = random_pushes(40, seed=0)
    assert scenes == random_pushes(40, seed=0)
    assert {kind_of(scene) for scene in scenes} == set(KINDS)
    for scene in scenes:
        (push,) = scene.pushes
        motion_of_tool = ToolMotion(push, scene.tool)
        start = motion_of_tool.pose(0.0)
        gap = scene.tool_gaps(start[None], scene.poses_world_from_body).min()
        assert gap == pytest.approx(START_GAP, abs=1e-5)
        touch = start + [*(np.array(push.displacement) * (1 - TRAVEL / push.distance)), 0.0]
        assert scene.tool_gaps(touch[None], scene.poses_world_from_body).min() == pytest.approx(0.0, abs=1e-5)
