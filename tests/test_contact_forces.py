"""Forces at contacts and joints, as the prediction solves them and as MuJoCo does."""

import math

import numpy as np
import pytest
from scenes import body

from pushgraph.errors import PredictionError
from pushgraph.forces import ContactForces
from pushgraph.physics import PhysicsPredictor, load
from pushgraph.predicted_forces import predict_with_forces
from pushgraph.scene import Scene, Table
from pushgraph.shape import Cuboid, Polygon
from pushgraph.simulation.planar import simulate
from pushgraph.simulation.sensed_forces import simulate_with_forces
from pushgraph.tool import Push, Tool
from pushgraph.track import FRAME

GRAVITY = 9.81


@pytest.fixture(scope="module")
def predictor() -> PhysicsPredictor:
    return load()


def row(**push) -> Scene:
    """Two boxes in a row that are pushed straight, 0.5 and 0.3 kg."""
    bodies = (body("a", 0.0, 0.0, Cuboid(size=(0.1, 0.1))), body("b", 0.1, 0.0, Cuboid(size=(0.1, 0.1)), mass=0.3))
    made = Push(start=(-0.1, 0.0), end=(0.1, 0.0), speed=0.1, **push)
    return Scene(bodies=bodies, pushes=(made,), tool=Tool.round(0.05), table=Table(friction=0.4), side_friction=0.2)


def test_what_is_pushed_straight_and_evenly_needs_its_friction_on_the_table(predictor: PhysicsPredictor) -> None:
    track, forces = predict_with_forces(predictor, row())
    assert np.array_equal(track.poses, predictor.predict_many([row()])[0].poses)
    frames = len(track.times)
    tool, first, second = (forces.on(node, frames) for node in range(3))
    slides = np.gradient(track.poses[:, 2, 0]) / FRAME > 0.0999
    slides[:-1] &= slides[1:]
    slides[np.argmax(slides) : np.argmax(slides) + 3] = False
    assert slides.sum() > 10
    np.testing.assert_allclose(tool[slides], [[-0.4 * 0.8 * GRAVITY, 0.0]] * slides.sum(), rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(first[slides, 0], 0.4 * 0.5 * GRAVITY, rtol=2e-4)
    np.testing.assert_allclose(second[slides, 0], 0.4 * 0.3 * GRAVITY, rtol=2e-4)


def test_forces_of_a_pair_are_equal_and_opposite_and_push_apart(predictor: PhysicsPredictor) -> None:
    track, forces = predict_with_forces(predictor, row())
    total = sum(forces.on(node, len(track.times)) for node in range(3))
    np.testing.assert_allclose(total, 0.0, atol=1e-12)
    at = forces.at(len(track.times) // 2)
    apart = track.poses[at.frame, at.second, 0] - track.poses[at.frame, at.first, 0]
    assert len(at.frame) >= 3
    assert (apart * at.forces[:, 0] >= 0).all()
    assert not at.joint.any()


def test_what_starts_takes_its_momentum_on_top_of_friction(predictor: PhysicsPredictor) -> None:
    """From rest to an even 0.1 m/s: the impulse is the momentum, and friction for as long as it moved."""
    track, forces = predict_with_forces(predictor, row())
    force = forces.on(2, len(track.times))[:, 0]
    x = track.poses[:, 2, 0]
    starts, even = int(np.argmax(x > x[0] + 1e-7)), int(np.argmax(x > x[0] + 0.05))
    moved = (x[even] - x[0]) / 0.1
    friction = 0.4 * 0.3 * GRAVITY
    impulse = force[starts : even + 1].sum() * FRAME - friction * moved
    assert impulse == pytest.approx(0.3 * 0.1, rel=0.1)


def test_a_force_limit_is_not_passed(predictor: PhysicsPredictor) -> None:
    track, forces = predict_with_forces(predictor, row(force_limit=2.0))
    assert np.hypot(*forces.on(0, len(track.times)).T).max() == pytest.approx(2.0, rel=1e-3)


def linked() -> Scene:
    """A plate with a hinged lid, a polygon beside it."""
    angle = Polygon(points=((0.0, 0.0), (0.1, 0.0), (0.1, 0.03), (0.03, 0.03), (0.03, 0.1), (0.0, 0.1)))
    scene = Scene(
        bodies=(
            body("plate", 0.0, 0.0, Cuboid(size=(0.14, 0.10))),
            body("lid", 0.0, 0.103, Cuboid(size=(0.14, 0.10)), mass=0.3),
            body("angle", 0.085, -0.04, angle),
        ),
        pushes=(Push(start=(-0.12, 0.1), end=(0.03, 0.1)),),
        tool=Tool.round(0.03),
    )
    return scene.replace(joints=({"kind": "revolute", "parent": "plate", "child": "lid", "anchor": (0.0, 0.0515)},))


def test_forces_at_hinges_and_polygons_balance_the_tool_s_as_the_simulation_has_it(predictor: PhysicsPredictor) -> None:
    track, forces = predict_with_forces(predictor, linked())
    frames = len(track.times)
    assert set(np.unique((forces.first, forces.second))) == {0, 1, 2, 3}
    assert np.hypot(*forces.forces[forces.joint].T).max() > 0.5
    simulated = simulate(linked())
    assert len(simulated.times) == frames
    tool = forces.on(0, frames)
    there = np.hypot(*simulated.wrench[:, :2].T) > 0.1
    off = np.hypot(*(tool - simulated.wrench[:, :2])[there].T)
    assert np.median(off) < 0.1 * np.median(np.hypot(*tool[there].T))


def test_simulated_forces_on_the_tool_add_up_to_its_wrench_and_change_nothing() -> None:
    scene = linked().moved(np.array([0.3, -0.2, 1.0]))
    track, forces = simulate_with_forces(scene)
    assert np.array_equal(track.poses, simulate(scene).poses)
    np.testing.assert_allclose(forces.on(0, len(track.times)), track.wrench[:, :2], atol=1e-9)
    touching = forces.at(int(np.argmax(np.hypot(*track.wrench[:, :2].T))))
    reach = [math.inf if node == 0 else scene.bodies[node - 1].shape.reach for node in touching.second]
    away = np.hypot(*(touching.points - track.poses[touching.frame, touching.second, :2]).T)
    assert (away < np.array(reach) + 0.005).all()


def test_nothing_touches_and_no_forces_are_known_of_other_networks(predictor: PhysicsPredictor) -> None:
    nothing = row().replace(pushes=(Push(start=(-0.2, -0.2), end=(-0.2, -0.3)),))
    for found in (predict_with_forces(predictor, nothing)[1], simulate_with_forces(nothing)[1]):
        assert isinstance(found, ContactForces)
        assert np.abs(found.forces).sum() < 1e-3
        assert np.abs(found.on(1, 3)).max() < 1e-3
    assert len(predict_with_forces(predictor, row().replace(pushes=()))[1].frame) == 0
    with pytest.raises(PredictionError, match="motions only"):
        predict_with_forces(load("propnet"), nothing)
