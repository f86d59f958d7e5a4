"""Pushes whose outcome physics, geometry or the simulator says, predicted."""

import math

import numpy as np
import pytest
from predictors import no_correction
from scenes import body, moved_by
from test_mechanism_cases import at_the_wall, door, drawer, four_bar, opening
from test_pushing_cases import (
    assert_near,
    overlap,
    pushed_bar,
    pushed_disc,
    pushed_flat,
    pushed_puck,
    pushed_tee,
    row,
)

from pushgraph.errors import PredictionError
from pushgraph.physics import PhysicsPredictor
from pushgraph.plausibility import remarks
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Cylinder
from pushgraph.simulation.planar import simulate
from pushgraph.tool import Push, Tool
from pushgraph.track import Track


@pytest.fixture(scope="module")
def laws() -> PhysicsPredictor:
    return no_correction()


def assert_as_simulated(scene: Scene, laws: PhysicsPredictor, millimetres: float, degrees: float) -> Track:
    predicted = laws.predict(scene)
    for moved, right in zip(moved_by(predicted), moved_by(simulate(scene)), strict=True):
        assert_near(moved, right, millimetres, degrees)
    return predicted


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("degrees", [5, 10, -8])
def test_a_flat_face_within_the_friction_cone_sticks(degrees: float, speed: float, laws) -> None:
    angle = math.radians(degrees)
    moved = moved_by(laws.predict(pushed_flat(degrees, speed)))[0]
    assert_near(moved, (150 * math.cos(angle), 150 * math.sin(angle), 0), 1.5, 0.5)


@pytest.mark.parametrize(("degrees", "side"), [(20, 0.25), (10, 0.0)])
def test_a_flat_face_beyond_the_friction_cone_slips(degrees: float, side: float, laws) -> None:
    assert_as_simulated(pushed_flat(degrees, 0.1, side), laws, 2.0, 1.0)


@pytest.mark.parametrize(("diameter", "y"), [(0.1, 0.02), (0.1, 0.035), (0.06, 0.015), (0.12, -0.03)])
def test_discs_pushed_off_centre(diameter: float, y: float, laws) -> None:
    assert_as_simulated(pushed_disc(diameter, y), laws, 3.0, 4.0)


@pytest.mark.parametrize(("cells", "copies"), [(1, 1), (10, 1), (7, 1), (1, 3)])
def test_a_bar_of_any_cells_moves_as_the_bar(cells: int, copies: int, laws) -> None:
    moved = moved_by(laws.predict(pushed_bar(cells, copies)))
    right = moved_by(simulate(pushed_bar()))[0]
    if cells == 1:
        assert_near(moved[0], right, 2.5, 3.0)
    assert moved[:, 2] == pytest.approx(np.full(len(moved), right[2]), abs=3.0)


def test_a_tee(laws) -> None:
    assert_as_simulated(pushed_tee(Push(start=(0.08, -0.09), direction=math.pi / 2, distance=0.08)), laws, 3.0, 3.0)


@pytest.mark.parametrize("count", [6, 15, 20])
def test_each_box_of_a_row_moves_by_the_stroke_less_the_gaps_before_it(count: int, laws) -> None:
    scene = row(count, Cuboid(size=(0.05, 0.05)))
    track = assert_as_simulated(scene, laws, 1.0, 0.2)
    assert overlap(track) <= 0.5e-3


@pytest.mark.parametrize("start", [-0.291, -0.2, -0.1234, -0.04])
def test_a_plate_of_5_mm_stays_before_a_flat_tool(start: float, laws) -> None:
    scene = pushed_flat(0, 0.2, size=(0.005, 0.08))
    push = Push(start=(start, 0.0), end=(0.1, 0.0), speed=0.4)
    assert_as_simulated(scene.replace(pushes=(push,)), laws, 2.0, 0.5)


@pytest.mark.parametrize(("friction", "right"), [(0.05, 369.84), (0.2, 240), (2.0, 240)])
def test_a_puck_slides_by_coulomb_s_law(friction: float, right: float, laws) -> None:
    moved = moved_by(laws.predict(pushed_puck(friction, rest=3.0)))[0]
    assert_near(moved, (right, 0, 0), 5.0, 0.1)


def crate(*pushes: Push, shape=None, mass: float = 0.5) -> Scene:
    """A crate, a cylinder of 10 cm by default, and a probe."""
    shape = shape or Cylinder(diameter=0.1)
    return Scene(bodies=(body("crate", 0.0, 0.0, shape, mass=mass),), tool=Tool.round(0.03), pushes=pushes)


@pytest.mark.parametrize("shape", [Cuboid(size=(0.1, 0.1)), Cylinder(diameter=0.1), Cuboid(size=(0.1, 0.03))])
def test_a_push_that_starts_in_touch_through_the_centre_turns_nothing(shape, laws) -> None:
    scene = crate(Push(start=(-0.065, 0.0), end=(0.05, 0.0)), shape=shape)
    moved = moved_by(laws.predict(scene))[0]
    assert abs(moved[1]) < 0.1
    assert abs(moved[2]) < 0.5


def test_a_ring_of_four_bars(laws) -> None:
    assert_as_simulated(four_bar(), laws, 5.0, 3.0)


@pytest.mark.parametrize(("limits", "mass"), [((-0.15, 0.3), 5.0), ((-0.15, 0.3), 50.0), ((-0.05, 0.0), 5.0)])
def test_a_hinge_stops_at_its_limit(limits: tuple[float, float], mass: float, laws) -> None:
    turned = opening(laws.predict(door(limits, mass)))
    assert turned[-1] == pytest.approx(math.degrees(limits[0]), abs=0.1)
    assert turned.min() > math.degrees(limits[0]) - 0.1


@pytest.mark.parametrize("mass", [5.0, 50.0])
def test_a_slider_stops_at_its_limit(mass: float, laws) -> None:
    assert_as_simulated(drawer(mass), laws, 3.0, 1.0)


@pytest.mark.parametrize("limit", [20.0, 60.0])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_crate_and_a_robot_with_a_force_limit_stop_at_a_wall(limit: float, turn: float, laws) -> None:
    scene = at_the_wall(limit, turn=turn)
    predicted, simulated = laws.predict(scene), simulate(scene)
    np.testing.assert_allclose(predicted.poses[-1, :, :2], simulated.poses[-1, :, :2], atol=2e-3)
    # The tool has stopped on its way of 25 cm.
    assert np.linalg.norm(predicted.poses[-1, 0, :2] - predicted.poses[0, 0, :2]) < 0.15


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_a_pusher_weaker_than_friction_stalls(limit: float, laws) -> None:
    scene = crate(Push(start=(-0.1, 0.0), end=(0.1, 0.0), force_limit=limit), mass=2.0)
    predicted = laws.predict(scene)
    assert np.linalg.norm(moved_by(predicted)[0][:2]) < 5.0
    assert predicted.poses[-1, 0, 0] == pytest.approx(simulate(scene).poses[-1, 0, 0], abs=5e-3)


def test_a_force_limit_that_is_not_reached_changes_little(laws) -> None:
    free, limited = (
        Scene(
            bodies=(body("a", 0.0, 0.0), body("b", 0.13, 0.03)),
            pushes=(Push(start=(-0.2, 0.0), end=(0.05, 0.0), force_limit=limit),),
        )
        for limit in (None, 200.0)
    )
    np.testing.assert_allclose(laws.predict(limited).poses[-1], laws.predict(free).poses[-1], atol=1.5e-3)


def test_a_held_back_tool_goes_on_with_the_next_push_where_that_begins(laws) -> None:
    stalled = at_the_wall(20.0)
    away = Push(start=(0.0, -0.4), end=(0.0, -0.3))
    track = laws.predict(stalled.replace(pushes=(*stalled.pushes, away)))
    first = track.poses[np.flatnonzero(track.push == 1)[0], 0]
    np.testing.assert_allclose(first[:2], away.start, atol=1e-9)
    np.testing.assert_allclose(track.poses[-1, 0, :2], away.end, atol=1e-9)


def test_what_leaves_the_table_is_remarked_and_pushes_into_bodies_are_refused(laws) -> None:
    leaves = crate(Push(start=(-0.2, 0.0), end=(0.2, 0.0))).replace(table=Table(size=(0.4, 0.4)))
    assert any("crate" in remark for remark in remarks(laws.predict(leaves)))
    scene = crate()
    inside = scene.replace(pushes=(Push(start=(-0.2, 0.0), end=(0.1, 0.0)), Push(start=(0.17, 0.0), end=(0.3, 0.0))))
    with pytest.raises(PredictionError, match=r"pushes\[1\].start: the tool would come down on body 'crate'"):
        laws.predict(inside)
