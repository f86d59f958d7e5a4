"""A table with a grain: friction that depends on the direction of the slide, in the simulator and in the solve."""

import math

import numpy as np
import pytest
import torch
from scenes import body, flat_tool

from pushgraph import pose
from pushgraph.graph.contact_graph import GRAVITY, friction_metric
from pushgraph.graph.scene_batch import batch_scenes
from pushgraph.graph.tool_wrench import wrench_on_tool
from pushgraph.physics import PhysicsPredictor
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool

FRICTION, ANISOTROPY = 0.3, 0.25


def force_that_slides(angle_to_grain: float, mass: float) -> tuple[float, float]:
    """Force (N) that slides a body along the unit vector n, along n and to its left: mu m g M n / sqrt(n . M n), M
    being the square of the matrix that is 1 + a along the grain and 1 - a across it."""
    along, across = (1 + ANISOTROPY) ** 2, (1 - ANISOTROPY) ** 2
    n = np.array([math.cos(angle_to_grain), math.sin(angle_to_grain)])
    in_grain = FRICTION * mass * GRAVITY * n * [along, across] / math.sqrt(n @ (n * [along, across]))
    return float(in_grain @ n), float(in_grain @ [-n[1], n[0]])


def pushed_box(grain: float) -> Scene:
    """A box that sticks to the flat tool that pushes it along x."""
    box = body("box", 0.0, 0.0, Cuboid(size=(0.1, 0.1)), mass=0.8)
    push = Push(start=(-0.0601, 0.0), end=(0.05, 0.0), speed=0.05)
    table = Table(size=(4, 4), friction=FRICTION, anisotropy=ANISOTROPY, grain=grain)
    return Scene(bodies=(box,), table=table, pushes=(push,), tool=flat_tool(0.02, 0.2), side_friction=1.5)


def shoved_puck(table: Table) -> Scene:
    """A puck that a tool lets go within one frame, along x."""
    puck = body("puck", 0.0, 0.0, Cylinder(diameter=0.06))
    push = Push(start=(-0.085, 0.0), path=[(0.115, 0.0), (0.11, 0.0)], times=[0.5, 0.55], rest=3.0)
    return Scene(bodies=(puck,), table=table, pushes=(push,), tool=Tool.round(0.1))


@pytest.fixture(scope="module")
def laws() -> PhysicsPredictor:
    return PhysicsPredictor.load()


@pytest.mark.parametrize("grain", [0.0, 0.5, math.pi / 2, -1.1])
def test_the_force_that_slides_a_box_is_that_of_the_direction(grain: float) -> None:
    track = simulate(pushed_box(grain))
    along, left = force_that_slides(-grain, 0.8)
    force = -track.wrench[10:30].mean(0)[:2]
    assert np.abs(track.poses[:, 1, 1]).max() < 1e-4  # it sticks, and slides along x
    np.testing.assert_allclose(force, [along, left], atol=0.01 * along)


@pytest.mark.parametrize("grain", [0.0, 0.5, -1.1])
def test_a_sensor_s_force_is_computed_alike(grain: float) -> None:
    scene = pushed_box(grain)
    motion = torch.tensor([[[2.5e-3, 0.0, 0.0]] + [[0.0, 0.0, 0.0]]])
    scenes = batch_scenes([scene])
    poses = torch.zeros(1, 2, 3, dtype=torch.float64)
    tool, blur = torch.tensor([[-0.06, 0.0, 0.0]]).double(), torch.zeros(1).double()
    wrench = wrench_on_tool(scenes, poses, motion.double(), motion.double(), tool, blur).wrench[0]
    np.testing.assert_allclose(-wrench[:2], force_that_slides(-grain, 0.8), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(("grain", "factor"), [(0.0, 1 + ANISOTROPY), (math.pi / 2, 1 - ANISOTROPY), (math.pi, 1.25)])
def test_along_and_across_the_grain_all_goes_as_on_a_table_of_that_friction(grain: float, factor: float, laws) -> None:
    size = (6, 6)
    grained = shoved_puck(Table(size=size, friction=FRICTION, anisotropy=ANISOTROPY, grain=grain))
    even = shoved_puck(Table(size=size, friction=FRICTION * factor))
    for run in (simulate, laws.predict):
        ends = [run(scene).poses[-1, 1] for scene in (grained, even)]
        assert ends[0][0] > 0.2
        np.testing.assert_allclose(*ends, atol=2e-3)


def test_a_table_turned_by_half_a_turn_is_the_same_and_a_world_that_is_turned_goes_with_it(laws) -> None:
    box = body("box", 0.0, 0.0, Cuboid(size=(0.12, 0.06)), yaw=0.3)
    table = Table(size=(4, 4), friction=FRICTION, anisotropy=ANISOTROPY, grain=0.7)
    push = Push(start=(-0.12, 0.015), end=(0.1, 0.03), speed=0.1)
    scene = Scene(bodies=(box,), table=table, pushes=(push,))
    motion = np.array([0.4, -0.3, 2.1])
    for run, exact in ((simulate, 1e-9), (laws.predict, 1e-4)):
        track = run(scene)
        opposite = run(scene.replace(table=table.replace(grain=0.7 + math.pi)))
        moved = run(scene.moved(motion))
        np.testing.assert_allclose(opposite.poses, track.poses, atol=exact)
        np.testing.assert_allclose(pose.relative(motion, moved.poses[:, 1]), track.poses[:, 1], atol=exact)
        even = run(scene.replace(table=table.replace(anisotropy=0.0)))
        assert np.abs(even.poses[-1, 1] - track.poses[-1, 1]).max() > 2e-3


@pytest.mark.parametrize("seed", range(6))
def test_the_solve_goes_where_the_simulator_does(seed: int, laws) -> None:
    rng = np.random.default_rng(seed)
    bodies = (
        body("box", 0.0, 0.0, Cuboid(size=(0.12, 0.07)), yaw=float(rng.uniform(-0.3, 0.3))),
        body("disc", 0.13, float(rng.uniform(-0.04, 0.04)), Cylinder(diameter=0.08)),
    )
    table = Table(size=(4, 4), friction=FRICTION, anisotropy=0.4, grain=float(rng.uniform(0, math.pi)))
    push = Push(start=(-0.12, float(rng.uniform(-0.02, 0.02))), end=(0.05, 0.0), speed=0.1)
    scene = Scene(bodies=bodies, table=table, pushes=(push,))
    even = scene.replace(table=table.replace(anisotropy=0.0))
    simulated, predicted, without = simulate(scene), laws.predict(scene), simulate(even)
    off, effect = (np.abs(t.poses[-1, 1:, :2] - simulated.poses[-1, 1:, :2]).max() for t in (predicted, without))
    assert off < 2e-3
    assert effect > 2 * off


def test_the_metric_is_the_square_of_what_stretches_along_the_grain() -> None:
    angle, a = 0.6, 0.3
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    stretched = turn @ np.diag([1 + a, 1 - a]) @ turn.T
    xx, xy, yy = friction_metric(a * torch.tensor([[math.cos(2 * angle), math.sin(2 * angle)]]))[:, 0].tolist()
    np.testing.assert_allclose([[xx, xy], [xy, yy]], stretched @ stretched, atol=1e-6)
